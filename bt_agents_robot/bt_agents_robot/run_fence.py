# SPDX-License-Identifier: Apache-2.0
"""Fence between the runs of a robot: which of them are over, so that late words stay out."""

from __future__ import annotations

from collections import deque

from bt_agents_core.run_key import RunKey

MOST_RUNS = 100
"""Runs that are remembered as over, and earlier markets, each."""


class RunFence:
    """Fence that lets in what belongs to a run under way, to one to come, or to none.

    What the market has gone on from is over. A goal may be here before the news of its run, so a
    run that was never named is taken for one to come. The last run of an earlier market may clean
    up until the next market has awarded one.
    """

    def __init__(self) -> None:
        self._named: RunKey | None = None
        self._is_awarded = False
        self._over: deque[RunKey] = deque(maxlen=MOST_RUNS)
        self._earlier: deque[str] = deque(maxlen=MOST_RUNS)

    def on_market(self, named: RunKey) -> None:
        """Handle the run that the market names; one without an agent says that none is there."""
        before = self._named
        if before is not None and before.epoch != named.epoch:
            self._earlier.append(before.epoch)
            self._is_awarded = False
        elif before is not None and before.agent and before != named:
            self._over.append(before)
        self._named = named
        self._is_awarded = self._is_awarded or bool(named.agent)

    def is_over(self, run: RunKey) -> bool:
        """Return whether what belongs to a run comes too late."""
        named = self._named
        if named is None or not run.epoch or run == named:
            return False
        if run.epoch == named.epoch:
            return run.round < named.round or run in self._over
        return self._is_awarded and run.epoch in self._earlier
