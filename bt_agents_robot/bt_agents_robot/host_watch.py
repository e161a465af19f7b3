# SPDX-License-Identifier: Apache-2.0
"""Detection of goals of the robot that have lost their host; without ROS."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from bt_agents_core.liveness import extended_lease

MOST_HOSTS = 20
"""Maximum number of watched hosts; one more replaces a departed one, if any."""


@dataclass(eq=False, kw_only=True)
class _Host:
    """Host: its start, the ids of its open goals, and its last sign of life."""

    instance: str
    goals: frozenset[bytes]
    heard_at: float


class HostWatch:
    """Watch over the hosts of performed goals; all times are on the steady clock [s].

    A goal that no host has named, such as one from a command line, cannot lose its host.

    Attributes:
        lease_s: Longest allowed silence of a host.
    """

    def __init__(self, lease_s: float, now: float) -> None:
        self.lease_s = lease_s
        self._hosts: dict[str, _Host] = {}
        self._orphans: frozenset[bytes] = frozenset()
        self._polled_at = now

    @property
    def hosts(self) -> Collection[str]:
        """Hosts whose heartbeats are needed."""
        return self._hosts.keys()

    def on_open_goals(
        self, host: str, instance: str, goals: Collection[bytes], now: float
    ) -> None:
        """Handle the open goals of a host.

        A new start of a host does not own the goals of the previous start.
        """
        known = self._hosts.get(host)
        if known is None and len(self._hosts) >= MOST_HOSTS:
            longest = min(self._hosts, key=lambda name: self._hosts[name].heard_at)
            if now - self._hosts[longest].heard_at < self.lease_s:
                return
            del self._hosts[longest]
        if known is not None and known.instance != instance:
            self._orphans |= known.goals
        self._hosts[host] = _Host(instance=instance, goals=frozenset(goals), heard_at=now)

    def on_heartbeat(self, host: str, instance: str, now: float) -> None:
        """Handle a sign of life; ignore it if it comes from another start of the host."""
        known = self._hosts.get(host)
        if known is not None and known.instance == instance:
            known.heard_at = now

    def lost(self, now: float) -> dict[bytes, str]:
        """Return the goals whose host is gone, with the reason; called at each heartbeat."""
        for host in self._hosts.values():
            host.heard_at = extended_lease(host.heard_at, self.lease_s, self._polled_at, now)
        self._polled_at = now
        found = dict.fromkeys(self._orphans, "its host was started anew")
        self._orphans = frozenset()
        for name, host in self._hosts.items():
            silent_s = now - host.heard_at
            if silent_s >= self.lease_s:
                found |= dict.fromkeys(
                    host.goals, f"its host {name} has been silent for {silent_s:.1f} s"
                )
        return found
