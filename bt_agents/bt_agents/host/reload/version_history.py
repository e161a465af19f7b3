# SPDX-License-Identifier: Apache-2.0
"""The good versions of one agent's file, and how the agent stands."""

from __future__ import annotations

from dataclasses import dataclass, field

from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec

KEPT = 50
"""Good versions of an agent that can be rolled back to."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Version:
    """One good version of an agent.

    Attributes:
        number: Counts up from 1.
        file: Text and agent.
        cause: Why there is this version, in words.
        change: What differs from the version before, in words.
        stamp: When it was read [s].
    """

    number: int
    file: AgentFile
    cause: str
    change: str
    stamp: float

    @property
    def agent(self) -> AgentSpec:
        """The agent."""
        assert self.file.agent is not None
        return self.file.agent


@dataclass(frozen=True, kw_only=True)
class AgentStatus:
    """How an agent stands.

    Attributes:
        version: Number of the version in force.
        waiting: True when another one comes into force at the end of its run.
        removal_reason: Why it goes at the end of its run; empty when it stays.
        problems: Why its file is not in force, one line each; empty when it is.
    """

    version: int
    waiting: bool
    removal_reason: str
    problems: tuple[str, ...]


@dataclass(kw_only=True, slots=True)
class VersionHistory:
    """The versions of one agent.

    Attributes:
        current: The one in force.
        seen: Its file as it was read last.
        kept: Those that can be rolled back to, oldest first.
        waiting: The one that comes into force at the end of its run; None for none.
        removal_reason: Why it goes at the end of its run; empty when it stays.
        problems: Why its file is not in force, one line each; empty when it is.
    """

    current: Version
    seen: AgentFile
    kept: list[Version] = field(default_factory=list)
    waiting: Version | None = None
    removal_reason: str = ""
    problems: tuple[str, ...] = ()

    @property
    def newest(self) -> Version:
        """The one that waits, else the one in force."""
        return self.waiting or self.current

    def keep(self, version: Version) -> Version:
        """Put a version on the shelf; the oldest goes, but never the one in force."""
        self.kept.append(version)
        while len(self.kept) > KEPT:
            oldest = next(one for one in self.kept if one is not self.current)
            self.kept.remove(oldest)
        return version


def first_versions(file: AgentFile, stamp: float) -> VersionHistory:
    """Return the versions of an agent that is new here.

    Args:
        file: What its file says.
        stamp: When it was read [s].
    """
    version = Version(number=1, file=file, cause=file.cause, change="", stamp=stamp)
    return VersionHistory(current=version, seen=file, kept=[version])
