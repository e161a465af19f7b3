# SPDX-License-Identifier: Apache-2.0
"""Statistics of a market: runs, disagreements with the shadow, and starved agents."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import Decision


class MarketStatistics:
    """Counters over the rounds of a market, and over its runs including earlier starts.

    Attributes:
        shadow_rounds: Awarded rounds that both the strategy and the shadow in force have ranked.
        shadow_disagreements: Number of them with different winners.
        runs: Number of runs of each agent that has run.
        last_run: Number of the last run of each, from 1.
        earlier_runs: Number of runs before this start.
    """

    def __init__(self) -> None:
        self.shadow_rounds = 0
        self.shadow_disagreements = 0
        self.starvation = Starvation()
        self.runs: Counter[str] = Counter()
        self.last_run: dict[str, int] = {}
        self.earlier_runs = 0
        self._compared = ("", "")

    def take(self, decision: Decision) -> None:
        """Count a decision; do not call it for previews."""
        winner, terms = decision.winner, decision.terms
        if winner is None or decision.outcome is not AuctionOutcome.AWARDED:
            return
        if (terms.strategy, terms.shadow) != self._compared:
            self._compared = (terms.strategy, terms.shadow)
            self.shadow_rounds = self.shadow_disagreements = 0
        if decision.ranked.shadow_winner and decision.ranked.by == terms.strategy:
            self.shadow_rounds += 1
            self.shadow_disagreements += decision.ranked.shadow_winner != winner.agent

    def count_run(self, agent: str, bidders: Iterable[str]) -> None:
        """Count a run of an agent: the best bidder, or the next one that accepted."""
        self.runs[agent] += 1
        self.last_run[agent] = self.runs.total()
        self.starvation.ran(agent, bidders)

    def restore(
        self, runs: Mapping[str, int], last_run: Mapping[str, int], in_vain: Mapping[str, int]
    ) -> None:
        """Continue from the counts of an earlier start."""
        self.runs, self.last_run = Counter(runs), dict(last_run)
        self.earlier_runs = self.runs.total()
        self.starvation.restore(in_vain)


class Starvation:
    """Counter of each agent's bids in awarded rounds since its last run.

    Rounds without its bid neither count nor reset the count. ``in_vain`` has the counts by agent.
    """

    def __init__(self) -> None:
        self.in_vain: dict[str, int] = {}
        self._warned: set[str] = set()
        self._found: tuple[int, tuple[str, ...]] | None = None

    def restore(self, in_vain: Mapping[str, int]) -> None:
        """Take over the counts of an earlier market."""
        self.in_vain, self._found = dict(in_vain), None

    def ran(self, winner: str, bidders: Iterable[str]) -> None:
        """Record which agent runs: the best bidder, or the next one that accepted."""
        self._found = None
        for agent in bidders:
            self.in_vain[agent] = 0 if agent == winner else self.in_vain.get(agent, 0) + 1
        self._warned.discard(winner)

    def starved(self, limit: int) -> tuple[str, ...]:
        """Return the agents with at least ``limit`` bids in vain, sorted by name; none for 0."""
        if not limit:
            return ()
        if self._found is None or self._found[0] != limit:
            named = sorted(agent for agent, count in self.in_vain.items() if count >= limit)
            self._found = (limit, tuple(named))
        return self._found[1]

    def newly_starved(self, limit: int) -> list[str]:
        """Return a warning for each newly starved agent, once until it runs again."""
        starved = self.starved(limit)
        fresh = [agent for agent in starved if agent not in self._warned]
        self._warned = set(starved)
        return [
            f"{agent} is starved: it has bid in {self.in_vain[agent]} awarded rounds and got no "
            "run; a strategy that explores (bounded_ucb, softmax) gives it a chance"
            for agent in fresh
        ]


def counts(found: object) -> dict[str, int]:
    """Check counts by agent that were read from a file, and return them.

    Raises:
        ValueError: They are not counts.
    """
    if not isinstance(found, Mapping) or not all(
        isinstance(agent, str) and type(count) is int and count >= 0
        for agent, count in found.items()
    ):
        raise ValueError("expected names of agents with whole numbers")
    return dict(found)
