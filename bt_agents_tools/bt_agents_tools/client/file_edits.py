# SPDX-License-Identifier: Apache-2.0
"""Edits of agents' files that make tuned values their defaults: preview and writing."""

from __future__ import annotations

import codecs
import difflib
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bt_agents.host.tuning.tunable import TunableKind, TunableParameter, shown_value
from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_tools.client.write_back import ParameterState, default_text, write_defaults
from bt_agents_tools.rehearsal.suite import broken_by, find_tests


@dataclass(frozen=True, kw_only=True)
class FileEdit:
    """New text of a file, with the resulting agent and a line for each changed value."""

    trees: Path
    path: Path
    before: str
    after: str
    agent: AgentSpec
    changes: tuple[str, ...]

    @property
    def diff(self) -> str:
        """The changes as a unified diff."""
        before, after = (text.splitlines(keepends=True) for text in (self.before, self.after))
        return "".join(difflib.unified_diff(before, after, str(self.path), str(self.path)))

    def write(self) -> None:
        """Write the file.

        Raises:
            BtAgentsError: It cannot be written.
        """
        try:
            mark = "\ufeff" if self.path.read_bytes().startswith(codecs.BOM_UTF8) else ""
            write_atomically(self.path, mark + self.after)
        except OSError as error:
            raise BtAgentsError(
                f"{self.path} cannot be written: {error.strerror or error}"
            ) from error


@dataclass(frozen=True, kw_only=True)
class ComparedTests:
    """Result of the agents' tests for edits: lines for people, and whether more would fail."""

    lines: tuple[str, ...]
    breaks: bool


def edits_of(
    host: str, folder: Path, states: Sequence[ParameterState], *, profile: bool
) -> list[FileEdit]:
    """Return the edits that make the values of a host the defaults of its files.

    Args:
        host: Name of the host, for people.
        folder: Its trees folder.
        states: Current values; values that equal those in the files are left out.
        profile: Whether to keep profiles, too.

    Raises:
        BtAgentsError: The folder or a file is missing or broken, or cannot be changed this way.
    """
    kinds = {TunableKind.TUNABLE, TunableKind.LEARNING_RATE}
    if profile:
        kinds.add(TunableKind.PROFILE)
    tuned: dict[str, list[ParameterState]] = {}
    for state in states:
        if state.parameter.kind in kinds and state.value != state.parameter.default:
            tuned.setdefault(state.parameter.agent, []).append(state)
    if not tuned:
        return []
    if not (folder / "scene.yaml").is_file():
        raise BtAgentsError(
            f"the trees folder '{folder}' of {host} is not on this machine; run this where it is"
        )
    trees = read_trees(folder)
    return [_edit(trees, agent, tuned[agent]) for agent in sorted(tuned)]


def compare_tests(edits: Sequence[FileEdit]) -> ComparedTests:
    """Return the tests of the agents that pass now and would fail after the edits."""
    results = [
        result
        for folder in sorted({edit.trees for edit in edits})
        for result in broken_by(
            find_tests([folder]), {e.agent.name: e.agent for e in edits if e.trees == folder}
        )
    ]
    lines = []
    for result in results:
        for case in result.cases:
            lines.append(f"passes now, would fail: {case.case.name}  in {result.file}")
            lines.append(f"    {case.failures[0].message}")
        if result.error is not None:
            lines.append(f"not run, as the file has errors: {result.file}")
    breaks = any(result.cases for result in results)
    if not breaks and any(result.agent is not None for result in results):
        names = ", ".join(sorted({edit.agent.name for edit in edits}))
        lines.append(f"tests of {names}: all that pass now would still pass")
    return ComparedTests(lines=tuple(lines), breaks=breaks)


def digest_of(edits: Sequence[FileEdit]) -> str:
    """Return a digest, equal for lists of edits that make the same changes in the same files."""
    parts = (f"{edit.path}\0{edit.before}\0{edit.after}\0" for edit in edits)
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def _edit(trees: Trees, agent: str, tuned: Sequence[ParameterState]) -> FileEdit:
    spec = next((one for one in trees.agents if one.name == agent), None)
    if spec is None:
        for broken in trees.broken:
            if re.search(rf"^agent:\s*{re.escape(agent)}\s*(#|$)", _text(broken.file), re.M):
                raise broken.error
        raise BtAgentsError(f"no file in '{trees.folder}' has the agent '{agent}' any more")
    source = read_source(Path(spec.file))

    def read(text: str) -> AgentSpec:
        return read_agent(Source(source.file, text), trees.symbols)

    after = write_defaults(source, tuned, trees.symbols.space, read)
    written = Source(source.file, after)
    return FileEdit(
        trees=trees.folder,
        path=Path(spec.file),
        before=source.text,
        after=after,
        agent=read(after),
        changes=tuple(
            f"{one.name}: {_default(source, one)} → {_default(written, one)}"
            for one in (override.parameter for override in tuned)
        ),
    )


def _default(source: Source, parameter: TunableParameter) -> str:
    """Return a default as a file spells it, or formatted if the file leaves it out."""
    text = default_text(source, parameter)
    return shown_value(parameter, parameter.default if text is None else text)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
