# SPDX-License-Identifier: Apache-2.0
"""Monitors of a run: whether its award is valid, its market alive, and its live scene fresh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bt_agents_core.liveness import LIVE_LEASE_S, StallDetector, extended_lease
from bt_agents_core.run_key import RunKey
from bt_agents_core.scene import Scene

_POLL_AGAIN_S = 0.1


class AwardMonitor:
    """Monitor of the run that the market names; a stalled host waits for it before it acts.

    All times are on the steady clock [s]. ``stall`` detects that this process was suspended.
    """

    def __init__(self, now: float) -> None:
        self.stall = StallDetector(now)
        self._named: RunKey | None = None
        # The run that the last heartbeat did not name.
        self._unnamed: RunKey | None = None

    def on_heartbeat(self, named: RunKey, run: RunKey | None, now: float) -> bool:
        """Handle the run that a market names; return whether the current run was given away."""
        if run is not None and run.epoch != named.epoch:
            return False
        self._named = named
        if self.stall.confirmed or self.stall.poll(now):
            return False
        if run is None or named == run:
            self.stall.confirmed = True
            self._unnamed = None
            return False
        # Two heartbeats of the run are needed, because the first may be from before the award.
        unnamed, self._unnamed = self._unnamed, run
        return unnamed == run

    def is_over(self, run: RunKey) -> bool:
        """Return whether the market is already at a later round."""
        named = self._named
        return named is not None and named.epoch == run.epoch and named.round > run.round

    def hold_off_s(self, run: RunKey, now: float) -> float:
        """Return how long to wait before a run continues [s].

        It does not wait for a market that has never named a run.
        """
        wait_s = self.stall.poll(now)
        names_runs = self._named is not None and self._named.epoch == run.epoch
        return wait_s if self.stall.confirmed or not names_runs else max(wait_s, _POLL_AGAIN_S)


class MarketLease:
    """Lease of the market on the current run; all times are on the steady clock [s].

    A market is gone when it has been silent for ``lease_s``, even if it dies before its first
    heartbeat arrives.
    """

    def __init__(self, lease_s: float) -> None:
        self.lease_s = lease_s
        self._epoch: str | None = None
        self._last = 0.0

    def begin(self, epoch: str, now: float) -> None:
        """Start the lease with a run of a market, which is a sign of life."""
        self._epoch = epoch
        self._last = now

    def end(self) -> None:
        """End the lease with the run."""
        self._epoch = None

    def on_heartbeat(self, epoch: str, now: float) -> None:
        """Renew the lease if this market holds it."""
        if epoch == self._epoch:
            self._last = now

    def extend(self, checked_at: float, now: float) -> None:
        """Extend the lease by a delay of this process since the last check."""
        self._last = extended_lease(self._last, self.lease_s, checked_at, now)

    def silence(self, now: float) -> float:
        """Return how long the market has been silent if that is too long, else 0 [s]."""
        silent = now - self._last
        return silent if self._epoch and silent >= self.lease_s else 0.0


class LiveSceneView:
    """Latest live scene of one run, initially the awarded one; each counts for ``lease_s`` [s]."""

    def __init__(
        self, awarded: Scene, clock: Callable[[], float], lease_s: float = LIVE_LEASE_S
    ) -> None:
        self.lease_s = lease_s
        self.scene_id = awarded.scene_id
        self._clock = clock
        self._scene = awarded
        self._seen_at = clock()

    def receive(self, scene: Scene) -> None:
        """Take a live scene of the run."""
        self._scene = scene
        self._seen_at = self._clock()

    def now(self) -> Scene:
        """Return the latest scene, marked as stale if none arrived during the lease."""
        silent_s = self._clock() - self._seen_at
        return self._scene if silent_s <= self.lease_s else replace(self._scene, stale_s=silent_s)
