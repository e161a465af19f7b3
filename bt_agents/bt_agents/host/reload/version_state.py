# SPDX-License-Identifier: Apache-2.0
"""State of one agent: its version in force, one that waits, and the problems of its file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_language.diagnostics.renderers import MAX_SHOWN, as_hinted_line, visible
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec


@dataclass(frozen=True, kw_only=True, slots=True)
class Version:
    """Good version of an agent.

    Attributes:
        number: Counts up from 1.
        change: Differences from the previous version, in words; empty for the first one.
    """

    number: int
    file: AgentFile
    change: str

    @property
    def agent(self) -> AgentSpec:
        """The agent of the file; a good version always has one."""
        assert self.file.agent is not None
        return self.file.agent


@dataclass(frozen=True, kw_only=True)
class FileProblem:
    """Reason why a file is not in force or an agent does not take part.

    Attributes:
        message: Description for people; for an error, with its place.
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
class VersionState:
    """Versions of one agent: the one in force, and a newer one that waits.

    Attributes:
        current: Version in force.
        last_read: The last reading of its file, good or broken.
        before: Version that was in force before; None for the first one.
        waiting: Version that comes into force when the agent's run ends; None for none.
        removal_reason: Why the agent is removed when its run ends; empty if it stays.
        problems: Why its file is not in force; empty if it is.
    """

    current: Version
    last_read: AgentFile
    before: Version | None = None
    waiting: Version | None = None
    removal_reason: str = ""
    problems: tuple[FileProblem, ...] = ()

    @property
    def newest(self) -> Version:
        """The waiting version, else the one in force."""
        return self.waiting or self.current

    def bring_into_force(self, version: Version) -> None:
        """Replace the version in force; none waits any more."""
        self.before, self.current, self.waiting = self.current, version, None

    def take_back(self) -> None:
        """Return to the version that was in force before."""
        assert self.before is not None
        self.current, self.before = self.before, None


def first_state(file: AgentFile) -> VersionState:
    """Return the state of a new agent, with one version from its good file."""
    return VersionState(current=Version(number=1, file=file, change=""), last_read=file)
