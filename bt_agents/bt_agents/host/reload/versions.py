# SPDX-License-Identifier: Apache-2.0
"""State machine of agent versions: changed files in, effects on agents out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from bt_agents.host.reload.changes import change_text, changes_tree
from bt_agents.host.reload.version_state import (
    FileProblem,
    Version,
    VersionState,
    file_problems,
    first_state,
)
from bt_agents_core.diagnostic import Diagnostic
from bt_agents_language.diagnostics.collection import merged
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.files.folder_reader import Trees, text_of
from bt_agents_language.files.market_reader import MARKET_FILE
from bt_agents_language.model.specs import AgentSpec


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
        states: Name of an agent → its versions, for agents with a version in force.
    """

    def __init__(self, trees: Trees) -> None:
        self.trees = trees
        self.texts = trees.texts
        self._good_files = _good_files(trees)
        self._space = trees.scene.space
        self.states: dict[str, VersionState] = {}
        for name, file in self._good_files.items():
            self.states[name] = first_state(file)

    def update(self, trees: Trees) -> list[str]:
        """Store a new reading of the folder; return the agents to settle, in order."""
        self.trees = trees
        self.texts = self._good_texts(trees)
        self._good_files = _good_files(trees)
        gone = [name for name in self.states if name not in self._good_files]
        affected = [name for name in gone if self._is_new(name)]
        for name, file in self._good_files.items():
            state = self.states.get(name)
            if (
                state is None
                or state.last_read is not file
                or state.problems
                or state.removal_reason
            ):
                affected.append(name)
        return affected

    def texts_in_force(self) -> dict[str, str]:
        """Return path relative to the trees folder → text; of a broken file the last good text."""
        folder = self.trees.folder
        files = [state.current.file for state in self.states.values()]
        market = folder / MARKET_FILE
        texts = [*self.texts.items(), *((one.file, one.text) for one in files)]
        found: dict[str, str] = {}
        for path, text in [*texts, (market, text_of(market))]:
            if text is not None:
                found.setdefault(path.relative_to(folder).as_posix(), text)
        return found

    def settle(self, name: str, running: str) -> ReloadEffect | None:
        """Return the effect of the last reading on an agent; None if nothing changes.

        A change of the ``running`` agent's tree (empty for none) waits for the end of its run.
        """
        state, file = self.states.get(name), self._good_files.get(name)
        if file is None:
            return self._without_good_file(name, state, running) if state is not None else None
        if state is None:
            return self._add(name, file)
        return self._update(name, state, file, running)

    def run_ended(self, name: str) -> ReloadEffect | None:
        """Return the effect that waited for the end of an agent's run; None without one."""
        state = self.states.get(name)
        if state is None:
            return None
        if state.removal_reason:
            return self._remove(name, state, state.removal_reason)
        if state.waiting is None:
            return None
        state.bring_into_force(state.waiting)
        return self._bring_into_force(state.current, ReloadAction.REPLACE_TREE)

    def failed(self, effect: ReloadEffect, error: str) -> ReloadEffect:
        """Withdraw a version that could not be put into force; return what to report instead.

        The next reading of the folder tries it again.
        """
        name = effect.name
        state = self.states.get(name)
        text = f"{effect.text}; this failed: {error}"
        if state is not None and effect.action is ReloadAction.ADD:
            del self.states[name]
            text = f"{name}: version {state.current.number} could not be added: {error}"
        elif state is not None and effect.agent is not None:
            number = state.current.number
            state.take_back()
            reason = (
                f"version {number} could not be brought into force, version "
                f"{state.current.number} stays: {error}"
            )
            text = f"{name}: {reason}"
            state.problems = (FileProblem(agent=name, message=reason),)
        return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text, is_error=True)

    def waiting_text(self, name: str) -> str:
        """Return in words what waits for the end of an agent's run; empty for nothing."""
        state = self.states.get(name)
        if state is None:
            return ""
        if state.waiting is not None:
            return f"version {state.waiting.number} of {name} waits"
        return f"{name} leaves" if state.removal_reason else ""

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

    def _good_texts(self, trees: Trees) -> Mapping[Path, str | None]:
        skills = trees.folder / "skills"
        if all(broken.file != skills for broken in trees.broken):
            return trees.texts
        others = {path: text for path, text in trees.texts.items() if path.parent != skills}
        good = {path: text for path, text in self.texts.items() if path.parent == skills}
        return {**others, **good}

    def _is_new(self, name: str) -> bool:
        """Return whether the status of an agent without a good file has changed."""
        state = self.states[name]
        problems = self._problems(name)
        return problems != state.problems if problems else not state.removal_reason

    def _problems(self, name: str) -> tuple[FileProblem, ...]:
        """Return the errors of an agent's file; none if it is gone."""
        holder = self.trees.holders.get(name)
        for file in self.trees.files:
            if file.file == holder and file.error is not None:
                return file_problems(file.error.diagnostics, name)
        return ()

    def _without_good_file(
        self, name: str, state: VersionState, running: str
    ) -> ReloadEffect | None:
        problems = self._problems(name)
        if problems:
            state.problems = problems
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            stays = f"version {state.current.number} stays in force"
            if state.waiting is not None:
                stays = f"version {state.waiting.number} still waits for the end of its run"
            file = state.last_read.file.name
            text = f"{name}: {file} is broken, {stays}: {problems[0].message}{more}"
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text, is_error=True)
        reason = self._removal_reason(name, state)
        if name != running:
            return self._remove(name, state, reason)
        state.removal_reason, state.waiting = reason, None
        state.problems = (FileProblem(agent=name, message=reason),)
        text = f"{name}: {reason}; it leaves at the end of its run"
        return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)

    def _removal_reason(self, name: str, state: VersionState) -> str:
        file = state.last_read.file
        now = next((one for one in self.trees.files if one.file == file), None)
        if now is None:
            return f"its file {file} is gone"
        if now.agent is not None and now.agent.name != name:
            return f"{file.name} calls it '{now.agent.name}' now"
        return f"it has none of the tags {', '.join(self.trees.tags)} any more"

    def _remove(self, name: str, state: VersionState, reason: str) -> ReloadEffect:
        del self.states[name]
        return ReloadEffect(
            action=ReloadAction.REMOVE, name=name, text=f"{name}: removed, {reason}"
        )

    def _add(self, name: str, file: AgentFile) -> ReloadEffect:
        state = self.states[name] = first_state(file)
        return ReloadEffect(
            action=ReloadAction.ADD,
            name=name,
            agent=state.current.agent,
            text=f"{name}: new agent from {file.file.name}, version 1 in force",
        )

    def _update(
        self, name: str, state: VersionState, file: AgentFile, running: str
    ) -> ReloadEffect | None:
        had_problems = bool(state.problems)
        state.last_read, state.problems, state.removal_reason = file, (), ""
        if _same(state.newest.file, file):
            if not had_problems:
                return None
            text = f"{name}: {file.file.name} is good again, version {state.newest.number} stays"
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        if state.waiting is not None and _same(state.current.file, file):
            dropped, state.waiting = state.waiting, None
            text = (
                f"{name}: version {state.current.number} stays in force, {dropped.number} does "
                "not wait any more"
            )
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        return self._add_version(state, file, running)

    def _add_version(self, state: VersionState, file: AgentFile, running: str) -> ReloadEffect:
        version = Version(
            number=state.newest.number + 1,
            file=file,
            change=change_text(state.newest.file, file, self._space),
        )
        name = version.agent.name
        has_other_tree = changes_tree(state.current.file, file)
        if has_other_tree and name == running:
            state.waiting = version
            text = (
                f"{name}: version {version.number} waits for the end of its run ({version.change})"
            )
            return ReloadEffect(action=ReloadAction.REPORT, name=name, text=text)
        state.bring_into_force(version)
        action = ReloadAction.REPLACE_TREE if has_other_tree else ReloadAction.UPDATE_VALUES
        return self._bring_into_force(version, action)

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
