# SPDX-License-Identifier: Apache-2.0
"""Detection of another marketplace of the same name, of which the younger one gives way."""

from __future__ import annotations

LISTEN_S = 0.3
"""Time for which a market that starts listens for another one, three heartbeats [s]."""

LEAVE_S = 1.5
"""Time that another market, which may just be ending, has to fall silent [s]."""

_MOST = 10
"""Other markets whose last heartbeat is remembered."""

_AS_OLD = 3
"""Heartbeats by which two counts may differ on their way; markets closer than that are as old."""


class StartCheck:
    """Check that no other market is alive, before one starts; times are steady [s].

    A market that was killed sends no heartbeats, whatever else the graph still shows of it.

    Attributes:
        alive: Epoch of the market that was heard last; empty for none.
    """

    def __init__(self, now: float) -> None:
        self.alive = ""
        self._quiet_at = now + LISTEN_S
        self._limit = now + LEAVE_S

    def on_heartbeat(self, epoch: str, now: float) -> None:
        """Handle a heartbeat, which is another market's, as this one has not started."""
        self.alive = epoch
        self._quiet_at = now + LISTEN_S

    def is_over(self, now: float, *, is_on_graph: bool) -> bool:
        """Return whether enough was listened.

        While the graph shows another market, its heartbeat may not be connected yet.
        """
        if is_on_graph and not self.alive:
            return now >= self._limit
        return now >= min(self._quiet_at, self._limit)

    def is_refused(self, now: float) -> bool:
        """Return whether another market was still heard at the end."""
        return bool(self.alive) and now < self._quiet_at


class OtherMarket:
    """Watch over the heartbeats on the topic of one market, for those of another."""

    def __init__(self, epoch: str) -> None:
        self._epoch = epoch
        self._last: dict[str, int] = {}

    def gives_way(self, epoch: str, sequence: int, own_sequence: int) -> bool:
        """Handle a heartbeat; return whether this market has to end, as the other is older.

        Heartbeats count up from the start of a market. The first one of another market may be its
        last, so the second one counts.
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
