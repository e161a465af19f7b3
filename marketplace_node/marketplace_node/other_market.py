# SPDX-License-Identifier: Apache-2.0
"""Detection of another marketplace of the same name; the younger one gives way."""

from __future__ import annotations

LISTEN_S = 0.3
"""A starting market listens this long for another one: three heartbeats [s]."""

LEAVE_S = 1.5
"""Time that another market has to fall silent, because it may just be ending [s]."""

_MOST = 10
"""Most other markets whose last heartbeat is remembered."""

_AS_OLD = 3
"""Counts that differ by no more heartbeats than this, due to delays, mean an equal age."""


class StartCheck:
    """Check before a start that no other market is alive; times are steady [s].

    A killed market sends no heartbeats, even while the graph still shows its node.

    Attributes:
        alive: Epoch in the last heartbeat of a market; empty for none.
    """

    def __init__(self, now: float) -> None:
        self.alive = ""
        self._quiet_at = now + LISTEN_S
        self._limit = now + LEAVE_S

    def on_heartbeat(self, epoch: str, now: float) -> None:
        """Handle a heartbeat of another market; this one has not started yet."""
        self.alive = epoch
        self._quiet_at = now + LISTEN_S

    def is_over(self, now: float, *, is_on_graph: bool) -> bool:
        """Return whether the check has listened long enough.

        While the graph shows another market, its heartbeat may still be connecting.
        """
        if is_on_graph and not self.alive:
            return now >= self._limit
        return now >= min(self._quiet_at, self._limit)

    def is_refused(self, now: float) -> bool:
        """Return whether another market was still alive at the end."""
        return bool(self.alive) and now < self._quiet_at


class OtherMarket:
    """Watches the heartbeat topic of one market for heartbeats of another."""

    def __init__(self, epoch: str) -> None:
        self._epoch = epoch
        self._last: dict[str, int] = {}

    def gives_way(self, epoch: str, sequence: int, own_sequence: int) -> bool:
        """Handle a heartbeat; return whether this market must end, because the other is older.

        Heartbeats count up from the start of a market. The first heartbeat of another market may
        be its last, so the second one decides.
        """
        if epoch == self._epoch:
            return False
        before = self._last.pop(epoch, None)
        self._last[epoch] = sequence
        if len(self._last) > _MOST:
            del self._last[next(iter(self._last))]
        if before is None or sequence <= before:
            return False
        if abs(own_sequence - sequence) <= _AS_OLD:
            return self._epoch < epoch
        return own_sequence < sequence
