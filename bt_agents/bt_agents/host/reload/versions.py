# SPDX-License-Identifier: Apache-2.0
"""State machine of agent versions: changed files in, effects on agents out."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from bt_agents.host.reload.changes import change_text, changes_tree
from bt_agents.host.reload.version_history import (
    FileProblem,
    Version,
    VersionHistory,
    file_problems,
    new_history,
)
from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.errors import Refused
from bt_agents_language.diagnostics.collection import merged
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.specs import AgentSpec

_MAX_REMOVED = 100


class ReloadAction(Enum):
    """Action on an agent after a change of files."""

    ADD = "add"
    REMOVE = "remove"
    REPLACE_TREE = "replace"
    """The next run gets the new tree."""
    UPDATE_VALUES = "update"
    """The tree is the same; other values are set at once, even during a run."""
    REPORT = "report"
    """Nothing changes; it is only reported."""


@dataclass(frozen=True, kw_only=True)
class ReloadEffect:
    """Effect of a change of files on one agent, with a text for people.

    It has a specification if there is one to put into force, and is an error if it needs a fix by
    a person.
    """

    action: ReloadAction
    name: str
    text: str
    agent: AgentSpec | None = None
    is_error: bool = False


class AgentVersions:
    """Versions of all agents of a host.

    Attributes:
        trees: Last reading of the trees folder.
        texts: Texts of the scene, skills and libraries in force; for broken skills, the last good
            ones.
        histories: Name of an agent → its versions, for agents with a version in force.
    """

    def __init__(self, trees: Trees, stamp: float) -> None:
        self.trees = trees
        self.texts = trees.texts
        self._good_files = _good_files(trees)
        self._space = trees.scene.space
        self.histories: dict[str, VersionHistory] = {}
        self._removed: OrderedDict[str, VersionHistory] = OrderedDict()
        for name, file in self._good_files.items():
            self.histories[name] = new_history(file, stamp, self.texts)

    def update(self, trees: Trees) -> list[str]:
        """Store a new reading of the folder; return the agents to settle, in order."""
        self.trees = trees
        self.texts = self._texts_in_force(trees)
        self._good_files = _good_files(trees)
        gone = [name for name in self.histories if name not in self._good_files]
        affected = [name for name in gone if self._is_new(name)]
        for name, file in self._good_files.items():
            history = self.histories.get(name)
            if (
                history is None
                or history.last_read is not file
                or history.problems
                or history.removal_reason
            ):
                affected.append(name)
        return affected

    def settle(self, name: str, running: str, stamp: float) -> ReloadEffect | None:
        """Return the effect of the last reading on an agent; None if nothing changes.

        A change of the ``running`` agent's tree (empty for none) waits for the end of its run.
        """
        history, file = self.histories.get(name), self._good_files.get(name)
        if file is None:
            return self._without_good_file(name, history, running) if history is not None else None
        if history is None:
            return self._add(name, file, stamp)
        return self._update(name, history, file, running, stamp)

    def run_ended(self, name: str) -> ReloadEffect | None:
        """Return the effect that waited for the end of an agent's run; None without one."""
        history = self.histories.get(name)
        if history is None:
            return None
        if history.removal_reason:
            return self._remove(name, history, history.removal_reason)
        if history.waiting is None:
            return None
        history.current, history.waiting = history.waiting, None
        return self._bring_into_force(history.current, ReloadAction.REPLACE_TREE)

    def failed(self, effect: ReloadEffect, error: str) -> ReloadEffect:
        """Withdraw a version that could not be put into force; return what to report instead.

        The next reading of the folder tries it again.
        """
        name = effect.name
        history = self.histories.get(name)
        text = f"{effect.text}; this failed: {error}"
        if history is not None and effect.action is ReloadAction.ADD:
            del self.histories[name]
            if len(history.versions) > 1:
                self._removed[name] = history
            text = f"{name}: version {history.current.number} could not be added: {error}"
        elif history is not None and effect.agent is not None:
            number = history.current.number
            history.versions.remove(history.current)
            history.current = history.versions[-1]
            reason = (
                f"version {number} could not be brought into force, version "
                f"{history.current.number} stays: {error}"
            )
            text = f"{name}: {reason}"
            history.problems = (FileProblem(agent=name, message=reason),)
        return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text, is_error=True)

    def waiting_text(self, name: str) -> str:
        """Return in words what waits for the end of an agent's run; empty for nothing."""
        history = self.histories.get(name)
        if history is None:
            return ""
        if history.waiting is not None:
            return f"version {history.waiting.number} of {name} waits"
        return f"{name} leaves" if history.removal_reason else ""

    def folder_problems(self) -> list[FileProblem]:
        """Return the problems in the folder that need a fix by a person."""
        agents = {file: name for name, file in self.trees.holders.items()}
        problems: list[FileProblem] = []
        of_texts: list[Diagnostic] = []
        for broken in self.trees.broken:
            own = [one for one in broken.error.diagnostics if not one.inserted]
            problems += file_problems(own, agents.get(broken.file, ""))
            of_texts += [one for one in broken.error.diagnostics if one.inserted]
        problems += file_problems(merged(of_texts))
        return [*problems, *(FileProblem(message=text) for text in self.trees.problems)]

    def history(self, name: str) -> VersionHistory:
        """Return the versions of an agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        if name not in self.histories:
            known = ", ".join(sorted(self.histories)) or "none"
            raise Refused("UNKNOWN_AGENT", f"no agent '{name}' here; there are: {known}")
        return self.histories[name]

    def find(self, name: str, number: int) -> Version:
        """Return a version to roll back to.

        The number 0 means the version before the current one; while the file is broken, it means
        the newest good version, which restores the file.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``UNKNOWN_VERSION``, ``SAME_VERSION``, or ``NO_FILE``.
        """
        history = self.history(name)
        if history.removal_reason:
            raise Refused(
                "NO_FILE",
                f"{name} leaves at the end of its run ({history.removal_reason}); put it back",
            )
        known = [one.number for one in history.versions]
        if number == 0 and history.problems:
            number = history.newest.number
        elif number == 0:
            number = max((n for n in known if n < history.current.number), default=0)
            if not number:
                raise Refused(
                    "UNKNOWN_VERSION",
                    f"{name} has no version before {history.current.number}; nothing has changed "
                    "since the start of the host",
                )
        version = next((one for one in history.versions if one.number == number), None)
        if version is None:
            raise Refused(
                "UNKNOWN_VERSION",
                f"{name} has no version {number}; there are {', '.join(map(str, known))}",
            )
        newest = history.newest
        if (version.file.text, version.agent) == (newest.file.text, newest.agent):
            if newest is not version:
                raise Refused(
                    "SAME_VERSION", f"version {number} of {name} says the same as {newest.number}"
                )
            if not history.problems and history.last_read.text == version.file.text:
                waits = "waits already" if history.waiting else "is in force already"
                raise Refused("SAME_VERSION", f"version {number} of {name} {waits}")
        return version

    def roll_back(
        self, name: str, version: Version, file: AgentFile | None, running: str, stamp: float
    ) -> ReloadEffect:
        """Make an earlier version the newest; see :meth:`find` and :meth:`settle`.

        ``file`` is the agent's file, written with this version; None if the write failed.

        Raises:
            Refused: As in :meth:`find`; the agent may have changed meanwhile.
        """
        self.find(name, version.number)
        history = self.history(name)
        if file is not None:
            history.last_read, history.problems = file, ()
            self._good_files[name] = file
        if version is history.newest:
            text = f"{name}: version {version.number} stays"
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        cause = f"roll back to {version.number}"
        return self._add_version(
            history, file or version.file, cause, running, stamp, restored=version
        )

    def is_as_read(self, name: str) -> bool:
        """Return whether the version in force equals its file, read with the current texts."""
        current = self.histories[name].current
        return self._good_files.get(name) is current.file and not current.restored

    def texts_apart(self, name: str) -> Mapping[Path, str | None]:
        """Return the texts that the version in force was read with; empty if they are in force.

        They include the texts of its libraries and of all skills.
        """
        version = self.histories[name].current
        if self.is_as_read(name):
            return {}
        skills, imports = self.trees.folder / "skills", version.file.imports

        def of_agent(texts: Mapping[Path, str | None]) -> Mapping[Path, str | None]:
            return {
                path: text
                for path, text in texts.items()
                if path.parent == skills
                or path.relative_to(self.trees.folder).as_posix() in imports
            }

        own = of_agent(version.texts)
        return own if own != of_agent(self.texts) else {}

    def _texts_in_force(self, trees: Trees) -> Mapping[Path, str | None]:
        skills = trees.folder / "skills"
        if all(broken.file != skills for broken in trees.broken):
            return trees.texts
        others = {path: text for path, text in trees.texts.items() if path.parent != skills}
        good = {path: text for path, text in self.texts.items() if path.parent == skills}
        return {**others, **good}

    def _is_new(self, name: str) -> bool:
        """Return whether the status of an agent without a good file has changed."""
        history = self.histories[name]
        problems = self._problems(name)
        return problems != history.problems if problems else not history.removal_reason

    def _problems(self, name: str) -> tuple[FileProblem, ...]:
        """Return the errors of an agent's file; none if it is gone."""
        holder = self.trees.holders.get(name)
        for file in self.trees.files:
            if file.file == holder and file.error is not None:
                return file_problems(file.error.diagnostics, name)
        return ()

    def _without_good_file(
        self, name: str, history: VersionHistory, running: str
    ) -> ReloadEffect | None:
        problems = self._problems(name)
        if problems:
            history.problems = problems
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            stays = f"version {history.current.number} stays in force"
            if history.waiting is not None:
                stays = f"version {history.waiting.number} still waits for the end of its run"
            file = history.last_read.file.name
            text = f"{name}: {file} is broken, {stays}: {problems[0].message}{more}"
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text, is_error=True)
        reason = self._removal_reason(name, history)
        if name != running:
            return self._remove(name, history, reason)
        history.removal_reason, history.waiting = reason, None
        history.problems = (FileProblem(agent=name, message=reason),)
        text = f"{name}: {reason}; it leaves at the end of its run"
        return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)

    def _removal_reason(self, name: str, history: VersionHistory) -> str:
        file = history.last_read.file
        now = next((one for one in self.trees.files if one.file == file), None)
        if now is None:
            return f"its file {file} is gone"
        if now.agent is not None and now.agent.name != name:
            return f"{file.name} calls it '{now.agent.name}' now"
        return f"it has none of the tags {', '.join(self.trees.tags)} any more"

    def _remove(self, name: str, history: VersionHistory, reason: str) -> ReloadEffect:
        del self.histories[name]
        history.removal_reason, history.problems = "", ()
        self._removed[name] = history
        while len(self._removed) > _MAX_REMOVED:
            self._removed.popitem(last=False)
        return ReloadEffect(
            action=ReloadAction.REMOVE, name=name, text=f"{name}: removed, {reason}"
        )

    def _add(self, name: str, file: AgentFile, stamp: float) -> ReloadEffect:
        history = self._removed.pop(name, None)
        if history is None:
            history = new_history(file, stamp, self.texts)
            text = f"{name}: new agent from {file.file.name}, version 1 in force"
        else:
            history.last_read = file
            if not _same(history.current.file, file):
                history.current = self._new_version(history, file, "file is back", stamp)
            text = f"{name}: back again, version {history.current.number} in force"
        self.histories[name] = history
        return ReloadEffect(
            action=ReloadAction.ADD, name=name, agent=history.current.agent, text=text
        )

    def _update(
        self, name: str, history: VersionHistory, file: AgentFile, running: str, stamp: float
    ) -> ReloadEffect | None:
        had_problems = bool(history.problems)
        history.last_read, history.problems, history.removal_reason = file, (), ""
        if _same(history.newest.file, file):
            if not had_problems:
                return None
            text = f"{name}: {file.file.name} is good again, version {history.newest.number} stays"
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        if history.waiting is not None and _same(history.current.file, file):
            dropped, history.waiting = history.waiting, None
            text = (
                f"{name}: version {history.current.number} stays in force, {dropped.number} does "
                "not wait any more"
            )
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        return self._add_version(history, file, file.cause, running, stamp)

    def _add_version(
        self,
        history: VersionHistory,
        file: AgentFile,
        cause: str,
        running: str,
        stamp: float,
        restored: Version | None = None,
    ) -> ReloadEffect:
        version = self._new_version(history, file, cause, stamp, restored)
        name = version.agent.name
        has_other_tree = changes_tree(history.current.file, file)
        if has_other_tree and name == running:
            history.waiting = version
            text = (
                f"{name}: version {version.number} waits for the end of its run ({version.change})"
            )
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        history.current, history.waiting = version, None
        action = ReloadAction.REPLACE_TREE if has_other_tree else ReloadAction.UPDATE_VALUES
        return self._bring_into_force(version, action)

    def _new_version(
        self,
        history: VersionHistory,
        file: AgentFile,
        cause: str,
        stamp: float,
        restored: Version | None = None,
    ) -> Version:
        return history.add(
            Version(
                number=history.versions[-1].number + 1,
                file=file,
                cause=cause,
                change=change_text(history.newest.file, file, self._space),
                stamp=stamp,
                texts=self.texts if restored is None else restored.texts,
                restored=restored is not None,
            )
        )

    def _bring_into_force(self, version: Version, action: ReloadAction) -> ReloadEffect:
        agent = version.agent
        text = f"{agent.name}: version {version.number} in force ({version.change})"
        return ReloadEffect(action=action, name=agent.name, agent=agent, text=text)


def _good_files(trees: Trees) -> dict[str, AgentFile]:
    """Return the good files of this host's agents, by name."""
    wanted = {agent.name for agent in trees.agents}
    return {
        file.agent.name: file
        for file in trees.files
        if file.agent is not None and file.agent.name in wanted
    }


def _same(one: AgentFile, other: AgentFile) -> bool:
    return one is other or (one.text, one.agent) == (other.text, other.agent)
