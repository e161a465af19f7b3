# SPDX-License-Identifier: Apache-2.0
"""Detection of goals that have lost their host or the screen that shows them; without ROS."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from bt_agents_core.liveness import extended_lease

LEASE_S = 1.5
"""Longest silence of the screen [s]; loading the page again takes less."""

FIRST_PAGE_S = 10.0
"""How long the first goal waits for a page to be opened [s]."""

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


class ScreenWatch:
    """Watch over the page Person as the screen of a robot; times are on the steady clock [s]."""

    def __init__(self, now: float) -> None:
        self._seen_at: float | None = None
        self._awaited_since: float | None = None
        self._polled_at = now

    def on_heartbeat(self, now: float) -> None:
        """Handle a sign that a page is open."""
        self._seen_at = now

    def on_goal(self, now: float) -> None:
        """Handle a goal that needs the screen; the first one begins the wait for a page."""
        if self._awaited_since is None:
            self._awaited_since = now

    @property
    def was_seen(self) -> bool:
        """Whether a page has ever been open."""
        return self._seen_at is not None

    def is_gone(self, now: float) -> bool:
        """Return whether no page is open, nor expected; called at each heartbeat of the robot."""
        polled_at, self._polled_at = self._polled_at, now
        if self._seen_at is None:
            return self._awaited_since is not None and now - self._awaited_since >= FIRST_PAGE_S
        self._seen_at = extended_lease(self._seen_at, LEASE_S, polled_at, now)
        return now - self._seen_at >= LEASE_S
