# SPDX-License-Identifier: Apache-2.0
"""Decides per agent which version of its file is in force, which one waits, and what is kept."""

from __future__ import annotations

from collections import OrderedDict

from bt_agents.host.reload.changes import compare
from bt_agents.host.reload.reload_actions import ReloadAction, ReloadEffect
from bt_agents.host.reload.version_history import (
    AgentStatus,
    Version,
    VersionHistory,
    first_versions,
)
from bt_agents_core.errors import Refused
from bt_agents_language.diagnostics.renderers import as_hinted_lines
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.files.folder_reader import Trees

_DEPARTED_KEPT = 100


class AgentVersions:
    """The versions of all agents of a host.

    Args:
        trees: The folder as it was read at the start.
        stamp: When that was [s].

    Attributes:
        trees: The folder as it was taken last.
    """

    def __init__(self, trees: Trees, stamp: float) -> None:
        self.trees = trees
        self._good = _good(trees)
        self._space = trees.scene.space
        self._shelves: dict[str, VersionHistory] = {}
        self._departed: OrderedDict[str, VersionHistory] = OrderedDict()
        for name, file in self._good.items():
            self._shelves[name] = first_versions(file, stamp)

    def take(self, trees: Trees) -> list[str]:
        """Take the folder as it is now; return the agents that are to be settled, in order."""
        self.trees = trees
        self._good = _good(trees)
        gone = [name for name in self._shelves if name not in self._good]
        affected = [name for name in gone if self._is_news(name)]
        for name, file in self._good.items():
            shelf = self._shelves.get(name)
            if shelf is None or shelf.seen is not file or shelf.problems or shelf.removal_reason:
                affected.append(name)
        return affected

    def settle(self, name: str, running: str, stamp: float) -> ReloadEffect | None:
        """Decide what becomes of an agent; None when nothing changes.

        Args:
            name: The agent.
            running: The agent whose tree runs; empty for none.
            stamp: Now [s].
        """
        shelf, file = self._shelves.get(name), self._good.get(name)
        if file is None:
            return self._without(name, shelf, running) if shelf is not None else None
        if shelf is None:
            return self._add(name, file, stamp)
        return self._renew(name, shelf, file, running, stamp)

    def ended(self, name: str) -> ReloadEffect | None:
        """Decide what becomes of an agent whose run has ended; None when nothing waits for it."""
        shelf = self._shelves.get(name)
        if shelf is None:
            return None
        if shelf.removal_reason:
            return self._remove(name, shelf, shelf.removal_reason)
        if shelf.waiting is None:
            return None
        shelf.current, shelf.waiting = shelf.waiting, None
        return self._in_force(name, shelf.current, ReloadAction.REPLACE_TREE)

    def failed(self, effect: ReloadEffect, error: str) -> ReloadEffect:
        """Take back a version that could not be brought into force; return what to tell.

        It is tried again when the folder is read the next time.

        Args:
            effect: What could not be done.
            error: Why, in words.
        """
        name = effect.name
        shelf = self._shelves.get(name)
        words = f"{effect.words}; this failed: {error}"
        if shelf is not None and effect.act is ReloadAction.ADD:
            del self._shelves[name]
            if len(shelf.kept) > 1:
                self._departed[name] = shelf
            words = f"{name}: version {shelf.current.number} could not be added: {error}"
        elif shelf is not None and effect.agent is not None:
            number = shelf.current.number
            shelf.kept.remove(shelf.current)
            shelf.current = shelf.kept[-1]
            words = (
                f"{name}: version {number} could not be brought into force, version "
                f"{shelf.current.number} stays: {error}"
            )
            shelf.problems = (words,)
        return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words, bad=True)

    def standing(self, name: str) -> AgentStatus:
        """Return how an agent stands."""
        shelf = self._shelves[name]
        return AgentStatus(
            version=shelf.current.number,
            waiting=shelf.waiting is not None,
            removal_reason=shelf.removal_reason,
            problems=shelf.problems,
        )

    def waits(self, name: str) -> str:
        """Return what waits for the end of the run of an agent, in words; empty for nothing."""
        shelf = self._shelves.get(name)
        if shelf is None:
            return ""
        if shelf.waiting is not None:
            return f"version {shelf.waiting.number} of {name} waits"
        return f"{name} leaves" if shelf.removal_reason else ""

    def names(self) -> tuple[str, ...]:
        """Return the names of all agents that have a version in force."""
        return tuple(self._shelves)

    def versions(self, name: str) -> tuple[Version, ...]:
        """Return the versions of an agent that are kept, oldest first.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        return tuple(self._shelf(name).kept)

    def file(self, name: str) -> AgentFile:
        """Return the file of an agent as it was read last."""
        return self._shelf(name).seen

    def wanted(self, name: str, number: int) -> Version:
        """Return the version that a roll back asks for.

        Args:
            name: The agent.
            number: Its version; 0 for the one before the current.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``UNKNOWN_VERSION``, ``SAME_VERSION``, or ``NO_FILE``.
        """
        shelf = self._shelf(name)
        if shelf.removal_reason:
            raise Refused(
                "NO_FILE",
                f"{name} leaves at the end of its run ({shelf.removal_reason}); put it back",
            )
        known = [one.number for one in shelf.kept]
        if number == 0:
            number = max((n for n in known if n < shelf.current.number), default=0)
            if not number:
                raise Refused(
                    "UNKNOWN_VERSION",
                    f"{name} has no version before {shelf.current.number}; nothing has changed "
                    "since the start of the host",
                )
        version = next((one for one in shelf.kept if one.number == number), None)
        if version is None:
            raise Refused(
                "UNKNOWN_VERSION",
                f"{name} has no version {number}; there are {', '.join(map(str, known))}",
            )
        newest = shelf.newest
        if (version.file.text, version.agent) == (newest.file.text, newest.agent):
            if newest is not version:
                raise Refused(
                    "SAME_VERSION", f"version {number} of {name} says the same as {newest.number}"
                )
            if not shelf.problems and shelf.seen.text == version.file.text:
                waits = "waits already" if shelf.waiting else "is in force already"
                raise Refused("SAME_VERSION", f"version {number} of {name} {waits}")
        return version

    def roll_back(
        self, name: str, version: Version, file: AgentFile | None, running: str, stamp: float
    ) -> ReloadEffect:
        """Make an earlier version the newest.

        Args:
            name: The agent.
            version: See :meth:`wanted`.
            file: Its file, written with this version; None when it could not be written.
            running: The agent whose tree runs; empty for none.
            stamp: Now [s].

        Raises:
            Refused: As in :meth:`wanted`; the agent may have changed since then.
        """
        self.wanted(name, version.number)
        shelf = self._shelf(name)
        if file is not None:
            shelf.seen, shelf.problems = file, ()
            self._good[name] = file
        if version is shelf.newest:
            words = f"{name}: version {version.number} stays"
            return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words)
        file = file or version.file
        return self._newer(name, shelf, file, f"roll back to {version.number}", running, stamp)

    def _shelf(self, name: str) -> VersionHistory:
        if name not in self._shelves:
            known = ", ".join(sorted(self._shelves)) or "none"
            raise Refused("UNKNOWN_AGENT", f"no agent '{name}' here; there are: {known}")
        return self._shelves[name]

    def _is_news(self, name: str) -> bool:
        """Return whether it is new how an agent stands that has no good file."""
        shelf = self._shelves[name]
        problems = self._problems(name)
        return problems != shelf.problems if problems else not shelf.removal_reason

    def _problems(self, name: str) -> tuple[str, ...]:
        """Return what is wrong with the file that an agent comes from; empty when it is gone."""
        holder = self.trees.holders.get(name)
        for file in self.trees.files:
            if file.file == holder and file.error is not None:
                return as_hinted_lines(file.error.diagnostics)
        return ()

    def _without(self, name: str, shelf: VersionHistory, running: str) -> ReloadEffect | None:
        problems = self._problems(name)
        if problems:
            shelf.problems = problems
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            stays = f"version {shelf.current.number} stays in force"
            if shelf.waiting is not None:
                stays = f"version {shelf.waiting.number} still waits for the end of its run"
            words = f"{name}: {shelf.seen.file.name} is broken, {stays}: {problems[0]}{more}"
            return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words, bad=True)
        reason = self._why_gone(name, shelf)
        if name != running:
            return self._remove(name, shelf, reason)
        shelf.removal_reason, shelf.waiting = reason, None
        shelf.problems = (reason,)
        words = f"{name}: {reason}; it leaves at the end of its run"
        return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words)

    def _why_gone(self, name: str, shelf: VersionHistory) -> str:
        file = shelf.seen.file
        now = next((one for one in self.trees.files if one.file == file), None)
        if now is None:
            return f"its file {file} is gone"
        if now.agent is not None and now.agent.name != name:
            return f"{file.name} calls it '{now.agent.name}' now"
        return f"it has none of the tags {', '.join(self.trees.tags)} any more"

    def _remove(self, name: str, shelf: VersionHistory, reason: str) -> ReloadEffect:
        del self._shelves[name]
        shelf.removal_reason, shelf.problems = "", ()
        self._departed[name] = shelf
        while len(self._departed) > _DEPARTED_KEPT:
            self._departed.popitem(last=False)
        return ReloadEffect(act=ReloadAction.REMOVE, name=name, words=f"{name}: removed, {reason}")

    def _add(self, name: str, file: AgentFile, stamp: float) -> ReloadEffect:
        shelf = self._departed.pop(name, None)
        if shelf is None:
            shelf = first_versions(file, stamp)
            words = f"{name}: new agent from {file.file.name}, version 1 in force"
        else:
            shelf.seen = file
            if not _same(shelf.current.file, file):
                shelf.current = self._version(shelf, file, "file is back", stamp)
            words = f"{name}: back again, version {shelf.current.number} in force"
        self._shelves[name] = shelf
        return ReloadEffect(
            act=ReloadAction.ADD, name=name, agent=shelf.current.agent, words=words
        )

    def _renew(
        self, name: str, shelf: VersionHistory, file: AgentFile, running: str, stamp: float
    ) -> ReloadEffect | None:
        mended = bool(shelf.problems)
        shelf.seen, shelf.problems, shelf.removal_reason = file, (), ""
        if _same(shelf.newest.file, file):
            if not mended:
                return None
            words = f"{name}: {file.file.name} is good again, version {shelf.newest.number} stays"
            return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words)
        if shelf.waiting is not None and _same(shelf.current.file, file):
            dropped, shelf.waiting = shelf.waiting, None
            words = (
                f"{name}: version {shelf.current.number} stays in force, {dropped.number} does "
                "not wait any more"
            )
            return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words)
        return self._newer(name, shelf, file, file.cause, running, stamp)

    def _newer(
        self,
        name: str,
        shelf: VersionHistory,
        file: AgentFile,
        cause: str,
        running: str,
        stamp: float,
    ) -> ReloadEffect:
        version = self._version(shelf, file, cause, stamp)
        structure = compare(shelf.current.file, file, self._space).structure
        if structure and name == running:
            shelf.waiting = version
            words = (
                f"{name}: version {version.number} waits for the end of its run ({version.change})"
            )
            return ReloadEffect(act=ReloadAction.REPORT, name=name, words=words)
        shelf.current, shelf.waiting = version, None
        return self._in_force(
            name, version, ReloadAction.REPLACE_TREE if structure else ReloadAction.UPDATE_VALUES
        )

    def _version(
        self, shelf: VersionHistory, file: AgentFile, cause: str, stamp: float
    ) -> Version:
        change = compare(shelf.newest.file, file, self._space).words
        number = shelf.kept[-1].number + 1
        return shelf.keep(
            Version(number=number, file=file, cause=cause, change=change, stamp=stamp)
        )

    def _in_force(self, name: str, version: Version, act: ReloadAction) -> ReloadEffect:
        words = f"{name}: version {version.number} in force ({version.change})"
        return ReloadEffect(act=act, name=name, agent=version.agent, words=words)


def _good(trees: Trees) -> dict[str, AgentFile]:
    """Return the files of the wanted agents by name."""
    wanted = {agent.name for agent in trees.agents}
    return {
        file.agent.name: file
        for file in trees.files
        if file.agent is not None and file.agent.name in wanted
    }


def _same(one: AgentFile, other: AgentFile) -> bool:
    return one is other or (one.text, one.agent) == (other.text, other.agent)
