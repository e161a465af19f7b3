# SPDX-License-Identifier: Apache-2.0
"""Liveness of processes: stalls, and leases that survive a stall of the listener."""

from __future__ import annotations

HEARTBEAT_S = 0.2
"""Period of heartbeats and of the checks of leases [s].

The shortest lease is more than twice as long.
"""

LIVE_LEASE_S = 1.0
"""Silence after which a live scene is stale; at least twice the period of live scenes [s]."""

STALL_S = 0.5
"""A process that ran nothing for longer than this has stalled [s]."""

LONGEST_PAUSE_S = 10.0
"""Longest pause after which a process continues instead of restarting [s].

Fast DDS drops a peer after 20 s of silence. If two processes were both paused, often only one
drops the other; they find each other again, but one no longer receives the other's announcements.
"""

SLOW_NETWORK = "slow_network"
"""ROS parameter of market, hosts and robot: factor on the waiting times for a wired network."""


def extended_after_stall(last_seen: float, lease_s: float, since: float, now: float) -> float:
    """Return the last sign of life of a peer, extended by a stall of this process.

    A lease that was valid at ``since``, when this process last listened, stays valid for at least
    half its length from now. All times are on the steady clock [s].
    """
    return max(last_seen, now - lease_s / 2) if since - last_seen < lease_s else last_seen


def extended_lease(last_seen: float, lease_s: float, checked_at: float, now: float) -> float:
    """Return the last sign of life of a peer, extended by a delay of this process.

    This process last checked the lease at ``checked_at``; it checks every :data:`HEARTBEAT_S`.
    Messages from the time of a delay are still unread: a late check counts as one in time, and a
    delay of more than half the lease as a stall. All times are on the steady clock [s].
    """
    gap_s = now - checked_at
    if gap_s > lease_s / 2:
        return extended_after_stall(last_seen, lease_s, checked_at, now)
    return last_seen + max(0.0, gap_s - HEARTBEAT_S)


class StallDetector:
    """Detects that this process was suspended; all times are on the steady clock [s].

    Args:
        limit_s: A longer gap between two polls is a stall.
        settle_s: How long to wait afterwards for news about the time of the stall.

    Attributes:
        last_stall_s: Length of the last stall.
        confirmed: False after a stall until a process without a stall has confirmed the state.
    """

    def __init__(self, now: float, *, limit_s: float = STALL_S, settle_s: float = 0.3) -> None:
        self.last_stall_s = 0.0
        self.confirmed = True
        self._last = now
        self._limit_s = limit_s
        self._settle_s = settle_s
        self._until = now

    def poll(self, now: float) -> float:
        """Detect a stall since the last poll; return how long not to act, 0 if not at all [s]."""
        gap, self._last = now - self._last, now
        if gap > self._limit_s:
            self.last_stall_s = gap
            self.confirmed = False
            self._until = now + self._settle_s
        return max(0.0, self._until - now)
