# SPDX-License-Identifier: Apache-2.0
"""How often each agent would have run, beside how often it did."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field

from bt_agents_lab.replay.recording_index import Round


@dataclass(kw_only=True)
class _Side:
    """Runs of one market; the number of its last run for each agent."""

    runs: Counter[str] = field(default_factory=Counter)
    last: dict[str, int] = field(default_factory=dict)
    total: int = 0

    def note(self, agent: str) -> None:
        if agent:
            self.total += 1
            self.runs[agent] += 1
            self.last[agent] = self.total


class ReplayedRunCounts:
    """Counts the runs of markets as they would have been.

    Bids tell how often their agents had run. What a journal has not seen of that, as it begins
    later or has lost something, is taken over; so counts without a change are as they were.
    """

    def __init__(self) -> None:
        self._was: defaultdict[str, _Side] = defaultdict(_Side)
        self._now: defaultdict[str, _Side] = defaultdict(_Side)

    def hear(self, one: Round) -> None:
        """Take what the bids of a round tell.

        Where the journal does not begin with the market, its runs in all are at least those of the
        bidders, which is all of them when everybody bids.
        """
        auction = one.auction
        was, now = self._was[auction.epoch], self._now[auction.epoch]
        told = max(one.least, was.total) if one.runs is None else one.earlier + one.runs
        now.total = max(0, now.total + told - was.total)
        was.total = told
        for bid in auction.ranking:
            now.runs[bid.agent] = max(0, now.runs[bid.agent] + bid.runs - was.runs[bid.agent])
            was.runs[bid.agent] = bid.runs
            if bid.last_run != was.last.get(bid.agent, 0):
                now.last[bid.agent] = was.last[bid.agent] = bid.last_run

    def note(self, epoch: str, was: str, now: str) -> None:
        """Note who ran after a round, and who would have; empty for nobody."""
        self._was[epoch].note(was)
        self._now[epoch].note(now)

    def of(self, epoch: str) -> tuple[dict[str, int], dict[str, int], int]:
        """Return runs and last run of each agent, and runs in all, as they would have been."""
        side = self._now[epoch]
        return dict(side.runs), dict(side.last), side.total
