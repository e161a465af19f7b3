# SPDX-License-Identifier: Apache-2.0
"""Version history of one agent: the good versions of its file, and the one in force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_language.diagnostics.renderers import MAX_SHOWN, as_hinted_line, visible
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec

MAX_VERSIONS = 50
"""Most good versions of an agent stored for roll back."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Version:
    """Good version of an agent; its cause and its change from the previous one are texts.

    Attributes:
        number: Counts up from 1.
        stamp: Time of the reading [s].
        texts: Texts that it was read with, including skills and libraries.
        restored: Whether a roll back restored it, so that it was read with other texts.
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
        """The agent of the file; a good version always has one."""
        assert self.file.agent is not None
        return self.file.agent


@dataclass(frozen=True, kw_only=True)
class FileProblem:
    """Reason why a file is not in force or an agent does not take part.

    Attributes:
        message: Description for people; that of an error includes its place.
        agent: The affected agent; empty if it affects no single one.
        file: File with the error; empty if the error is in no line of a file.
        line: Line of the error, from 1; 0 without a file.
    """

    message: str
    agent: str = ""
    file: str = ""
    line: int = 0


def file_problems(diagnostics: Sequence[Diagnostic], agent: str = "") -> tuple[FileProblem, ...]:
    """Return the errors of a file, limited to a helpful number.

    Args:
        diagnostics: The errors.
        agent: The agent in the file; empty for none.
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
        last_read: The last reading of its file, good or broken.
        versions: Versions to roll back to, oldest first.
        waiting: Version that comes into force when the agent's run ends; None for none.
        removal_reason: Why the agent is removed when its run ends; empty if it stays.
        problems: Why its file is not in force; empty if it is.
    """

    current: Version
    last_read: AgentFile
    versions: list[Version] = field(default_factory=list)
    waiting: Version | None = None
    removal_reason: str = ""
    problems: tuple[FileProblem, ...] = ()

    @property
    def newest(self) -> Version:
        """The waiting version, else the one in force."""
        return self.waiting or self.current

    def add(self, version: Version) -> Version:
        """Add a version; drops the oldest beyond the limit, but never the one in force."""
        self.versions.append(version)
        while len(self.versions) > MAX_VERSIONS:
            oldest = next(one for one in self.versions if one is not self.current)
            self.versions.remove(oldest)
        return version


def new_history(file: AgentFile, stamp: float, texts: Mapping[Path, str | None]) -> VersionHistory:
    """Return the history of a new agent, with one version from its good file."""
    version = Version(number=1, file=file, cause=file.cause, change="", stamp=stamp, texts=texts)
    return VersionHistory(current=version, last_read=file, versions=[version])
