# SPDX-License-Identifier: Apache-2.0
"""Detection of a screen that nobody has open; without ROS."""

from __future__ import annotations

from bt_agents_core.liveness import extended_lease

LEASE_S = 1.5
"""Longest silence of the screen [s]; loading the page again takes less."""

FIRST_PAGE_S = 10.0
"""How long the first goal waits for a page to be opened [s]."""


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
