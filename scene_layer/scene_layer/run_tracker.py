# SPDX-License-Identifier: Apache-2.0
"""Tracks the run that the live scene is published for; ignores replayed old runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class LiveRun:
    """Run that a live scene belongs to."""

    epoch: str
    round: int
    scene_id: str


class RunTracker:
    """Tracks the current run, None between runs, by run events and the market's state."""

    def __init__(self) -> None:
        self.run: LiveRun | None = None
        self._ended: dict[str, int] = {}
        self._market: tuple[str, int, bool] | None = None

    def started(self, run: LiveRun) -> bool:
        """Handle the start of a run; return True if it is the current run."""
        if run.round <= self._ended.get(run.epoch, 0) or self._is_over(run):
            return False
        self.run = run
        return True

    def ended(self, epoch: str, round_number: int) -> None:
        """Handle the end of a run."""
        self._ended[epoch] = max(round_number, self._ended.get(epoch, 0))
        if self.run is not None and (self.run.epoch, self.run.round) == (epoch, round_number):
            self.run = None

    def market(self, epoch: str, round_number: int, idle: bool) -> None:
        """Handle the state of the market; a restarted market has lost its runs."""
        self._market = (epoch, round_number, idle)
        if self.run is not None and (epoch != self.run.epoch or self._is_over(self.run)):
            self.run = None

    def _is_over(self, run: LiveRun) -> bool:
        """Whether the market has passed a run; another epoch proves nothing about a new run."""
        if self._market is None or self._market[0] != run.epoch:
            return False
        _, round_number, idle = self._market
        return round_number > run.round or (idle and round_number == run.round)
