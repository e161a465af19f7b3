# SPDX-License-Identifier: Apache-2.0
"""How long a run goes on without a sign of life of the market that started it."""

from __future__ import annotations


class MarketLease:
    """Watches over the market of one run at a time; all times are on the steady clock [s].

    A market that has never been heard of is not missed: it may be one without heartbeats.

    Args:
        lease_s: The market is gone when it has been silent for this long [s].
    """

    def __init__(self, lease_s: float) -> None:
        self.lease_s = lease_s
        self._epoch: str | None = None
        self._known = False
        self._last = 0.0
        self._latest = ""

    def begin(self, epoch: str, now: float) -> None:
        """A run of a market begins, which is a sign of life of it."""
        self._epoch = epoch
        self._known = epoch == self._latest
        self._last = now

    def end(self) -> None:
        """The run has ended."""
        self._epoch = None

    def heard(self, epoch: str, now: float) -> None:
        """A market has given a sign of life."""
        self._latest = epoch
        if epoch == self._epoch:
            self._known = True
            self._last = now

    def excuse(self, since: float, now: float) -> None:
        """Renew the lease valid at ``since``, as nobody has listened to heartbeats after it."""
        if since - self._last < self.lease_s:
            self._last = max(self._last, now - self.lease_s / 2)

    def silence(self, now: float) -> float:
        """Return how long the market has been silent if that is too long, else 0 [s]."""
        silent = now - self._last
        return silent if self._epoch and self._known and silent >= self.lease_s else 0.0
