# SPDX-License-Identifier: Apache-2.0
"""How long somebody who is silent counts as alive: a host, or the market that started a run."""

from __future__ import annotations


def extended_after_stall(heard: float, lease_s: float, since: float, now: float) -> float:
    """Return when somebody counts as heard, as nobody has listened after ``since``.

    A lease that was valid then lasts for half its length from now at least.

    Args:
        heard: When a sign of life was heard last, on the steady clock [s].
        lease_s: How long one counts [s].
        since: When somebody listened last.
        now: The time.
    """
    return max(heard, now - lease_s / 2) if since - heard < lease_s else heard


class MarketLease:
    """Says how long a run goes on without a sign of life of its market, one run at a time.

    All times are on the steady clock [s].

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
        self._last = extended_after_stall(self._last, self.lease_s, since, now)

    def silence(self, now: float) -> float:
        """Return how long the market has been silent if that is too long, else 0 [s]."""
        silent = now - self._last
        return silent if self._epoch and self._known and silent >= self.lease_s else 0.0
