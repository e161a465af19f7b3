# SPDX-License-Identifier: Apache-2.0
"""Fence between the runs of a robot, which keeps out late requests of ended runs."""

from __future__ import annotations

from collections import deque

from bt_agents_core.run_key import RunKey

MOST_RUNS = 100
"""Maximum numbers of remembered ended runs and of remembered earlier markets."""


class RunFence:
    """Fence that admits requests of the current run, of future runs, and without a run.

    Runs that the market has left are over. A goal may arrive before the news of its run, so an
    unknown run counts as a future one. The last run of an earlier market may clean up until the
    next market awards a run.
    """

    def __init__(self) -> None:
        self._named: RunKey | None = None
        self._is_awarded = False
        self._over: deque[RunKey] = deque(maxlen=MOST_RUNS)
        self._earlier: deque[str] = deque(maxlen=MOST_RUNS)

    def on_market(self, named: RunKey) -> None:
        """Handle the run that the market reports; a run without an agent means none."""
        before = self._named
        if before is not None and before.epoch != named.epoch:
            self._earlier.append(before.epoch)
            self._is_awarded = False
        elif before is not None and before.agent and before != named:
            self._over.append(before)
        self._named = named
        self._is_awarded = self._is_awarded or bool(named.agent)

    def is_superseded(self, run: RunKey, by: RunKey) -> bool:
        """Return whether a run must no longer act once another run acts."""
        return self.is_over(run) or (run.epoch == by.epoch and run.round < by.round)

    def is_over(self, run: RunKey) -> bool:
        """Return whether a run is over, so that its requests are too late."""
        named = self._named
        if named is None or not run.epoch or run == named:
            return False
        if run.epoch == named.epoch:
            return run.round < named.round or run in self._over
        return self._is_awarded and run.epoch in self._earlier
