# SPDX-License-Identifier: Apache-2.0
"""Liveness of processes: stalls, and leases that survive a stall of the listener."""

from __future__ import annotations

STALL_S = 0.5
"""A process in which nobody had a turn for longer than this has stalled [s]."""

LONGEST_PAUSE_S = 10.0
"""Longest pause of a process after which it goes on rather than starts again [s].

Fast DDS drops a peer after 20 s of silence. Of two processes that were both paused, often only one
drops the other; they find each other again, but the one no longer hears what the other announces.
"""

SLOW_NETWORK = "slow_network"
"""ROS parameter of market, hosts and robot: how much longer than by cable they wait."""


def extended_after_stall(last_seen: float, lease_s: float, since: float, now: float) -> float:
    """Return the last sign of life of a peer, extended as this process has not listened since.

    A lease that was valid then lasts for half its length from now at least. All times are on the
    steady clock [s]; ``since`` is when somebody listened last.
    """
    return max(last_seen, now - lease_s / 2) if since - last_seen < lease_s else last_seen


class StallDetector:
    """Detects that this process was suspended; all times are on the steady clock [s].

    Args:
        limit_s: A longer gap between two polls is a stall.
        settle_s: How long afterwards to wait for news of what has happened meanwhile.

    Attributes:
        last_stall_s: How long the last stall was.
        confirmed: False after a stall until somebody who had none has said what holds now.
    """

    def __init__(self, now: float, *, limit_s: float = STALL_S, settle_s: float = 0.3) -> None:
        self.last_stall_s = 0.0
        self.confirmed = True
        self._last = now
        self._limit_s = limit_s
        self._settle_s = settle_s
        self._until = now

    def hold_off_s(self, now: float) -> float:
        """Poll the clock; return how long not to act, 0 for not at all [s]."""
        gap, self._last = now - self._last, now
        if gap > self._limit_s:
            self.last_stall_s = gap
            self.confirmed = False
            self._until = now + self._settle_s
        return max(0.0, self._until - now)
