# SPDX-License-Identifier: Apache-2.0
"""Version history of one agent: the good versions of its file, and which is in force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_language.diagnostics.renderers import MAX_SHOWN, as_hinted_line, visible
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec

MAX_VERSIONS = 50
"""Good versions of an agent that are stored for a roll back."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Version:
    """Good version of an agent, whose cause and change from the one before are texts.

    Attributes:
        number: Counts up from 1.
        stamp: Time of reading [s].
        texts: Texts of the skills and libraries that it was read with, among others.
        restored: Whether it was rolled back to, and so not read with the texts of its time.
    """

    number: int
    file: AgentFile
    cause: str
    change: str
    stamp: float
    texts: Mapping[Path, str | None]
    restored: bool = False

    @property
    def agent(self) -> AgentSpec:
        """Agent of the file, which is a good one."""
        assert self.file.agent is not None
        return self.file.agent


@dataclass(frozen=True, kw_only=True)
class FileProblem:
    """Reason why a file is not in force, or an agent does not take part.

    Attributes:
        message: Description for people, of an error with its place.
        agent: Agent that it concerns; empty when it concerns no single one.
        file: File with the error; empty when no line of a file is wrong.
        line: Line of the error, from 1; 0 without a file.
    """

    message: str
    agent: str = ""
    file: str = ""
    line: int = 0


def file_problems(diagnostics: Sequence[Diagnostic], agent: str = "") -> tuple[FileProblem, ...]:
    """Return the errors of a file, no more than help.

    Args:
        diagnostics: The errors.
        agent: Agent that the file holds; empty for none.
    """
    problems = [
        FileProblem(
            message=as_hinted_line(one),
            agent=agent,
            file=one.position.file,
            line=one.position.line,
        )
        for one in diagnostics[:MAX_SHOWN]
    ]
    if len(diagnostics) > MAX_SHOWN:
        more = f"… and {len(diagnostics) - MAX_SHOWN} or more other problems"
        problems.append(replace(problems[0], message=f"{visible(problems[0].file)}: {more}"))
    return tuple(problems)


@dataclass(kw_only=True, slots=True)
class VersionHistory:
    """Versions of one agent.

    Attributes:
        current: Version in force.
        last_read: Its file as it was read last, good or broken.
        versions: Those that can be rolled back to, oldest first.
        waiting: Version that comes into force at the end of its run; None for none.
        removal_reason: Why it is removed at the end of its run; empty when it stays.
        problems: Why its file is not in force; empty when it is.
    """

    current: Version
    last_read: AgentFile
    versions: list[Version] = field(default_factory=list)
    waiting: Version | None = None
    removal_reason: str = ""
    problems: tuple[FileProblem, ...] = ()

    @property
    def newest(self) -> Version:
        """Version that waits, else the one in force."""
        return self.waiting or self.current

    def add(self, version: Version) -> Version:
        """Add a version; the oldest is dropped, but never the one in force."""
        self.versions.append(version)
        while len(self.versions) > MAX_VERSIONS:
            oldest = next(one for one in self.versions if one is not self.current)
            self.versions.remove(oldest)
        return version


def new_history(file: AgentFile, stamp: float, texts: Mapping[Path, str | None]) -> VersionHistory:
    """Return the history of an agent that is new here, with one version from its good file."""
    version = Version(number=1, file=file, cause=file.cause, change="", stamp=stamp, texts=texts)
    return VersionHistory(current=version, last_read=file, versions=[version])
