# SPDX-License-Identifier: Apache-2.0
"""Version history of one agent: the good versions of its file, and which is in force."""

from __future__ import annotations

from dataclasses import dataclass, field

from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec

MAX_VERSIONS = 50
"""Good versions of an agent that are stored for a roll back."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Version:
    """Good version of an agent, whose cause and change from the one before are texts.

    Numbers count up from 1; the stamp is the time of reading [s].
    """

    number: int
    file: AgentFile
    cause: str
    change: str
    stamp: float

    @property
    def agent(self) -> AgentSpec:
        """Agent of the file, which is a good one."""
        assert self.file.agent is not None
        return self.file.agent


@dataclass(kw_only=True, slots=True)
class VersionHistory:
    """Versions of one agent.

    Attributes:
        current: Version in force.
        last_read: Its file as it was read last, good or broken.
        versions: Those that can be rolled back to, oldest first.
        waiting: Version that comes into force at the end of its run; None for none.
        removal_reason: Why it is removed at the end of its run; empty when it stays.
        problems: Why its file is not in force, one line each; empty when it is.
    """

    current: Version
    last_read: AgentFile
    versions: list[Version] = field(default_factory=list)
    waiting: Version | None = None
    removal_reason: str = ""
    problems: tuple[str, ...] = ()

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


def new_history(file: AgentFile, stamp: float) -> VersionHistory:
    """Return the history of an agent that is new here, with one version from its good file."""
    version = Version(number=1, file=file, cause=file.cause, change="", stamp=stamp)
    return VersionHistory(current=version, last_read=file, versions=[version])
