# SPDX-License-Identifier: Apache-2.0
"""Statistics of a market: runs, rounds in which the shadow disagrees, and starved agents."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import Decision


class MarketStatistics:
    """Counters over the rounds of a market, and its runs with those of earlier starts.

    Attributes:
        shadow_rounds: Awarded rounds that the strategies in force, the one that ranks and its
            shadow, have both ranked.
        shadow_disagreements: In how many of these they had another winner.
        runs: How often each agent has run that ever did.
        last_run: Number of the last run of each, from 1.
        earlier_runs: How many runs there were before this start.
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
        """Count a decision; one that only foretells is not to be counted."""
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
        """Count a run of an agent, be it the best of those that bid or the next who took it."""
        self.runs[agent] += 1
        self.last_run[agent] = self.runs.total()
        self.starvation.ran(agent, bidders)

    def restore(
        self, runs: Mapping[str, int], last_run: Mapping[str, int], in_vain: Mapping[str, int]
    ) -> None:
        """Go on from what an earlier start has counted."""
        self.runs, self.last_run = Counter(runs), dict(last_run)
        self.earlier_runs = self.runs.total()
        self.starvation.restore(in_vain)


class Starvation:
    """Counter of the awarded rounds in which each agent bid since it ran last.

    Rounds in which it did not bid neither count nor clear it. ``in_vain`` has them by agent.
    """

    def __init__(self) -> None:
        self.in_vain: dict[str, int] = {}
        self._warned: set[str] = set()
        self._found: tuple[int, tuple[str, ...]] | None = None

    def restore(self, in_vain: Mapping[str, int]) -> None:
        """Take over what an earlier market has counted."""
        self.in_vain, self._found = dict(in_vain), None

    def ran(self, winner: str, bidders: Iterable[str]) -> None:
        """Note who runs, be it the best of those that bid or the next who took it."""
        self._found = None
        for agent in bidders:
            self.in_vain[agent] = 0 if agent == winner else self.in_vain.get(agent, 0) + 1
        self._warned.discard(winner)

    def starved(self, limit: int) -> tuple[str, ...]:
        """Return the agents with at least ``limit`` bids in vain, by name; none for 0."""
        if not limit:
            return ()
        if self._found is None or self._found[0] != limit:
            named = sorted(agent for agent, count in self.in_vain.items() if count >= limit)
            self._found = (limit, tuple(named))
        return self._found[1]

    def newly_starved(self, limit: int) -> list[str]:
        """Return a warning for each agent that has become starved, once until it runs again."""
        starved = self.starved(limit)
        fresh = [agent for agent in starved if agent not in self._warned]
        self._warned = set(starved)
        return [
            f"{agent} is starved: it has bid in {self.in_vain[agent]} awarded rounds and got no "
            "run; a strategy that explores (bounded_ucb, softmax) gives it a chance"
            for agent in fresh
        ]


def counts(found: object) -> dict[str, int]:
    """Return the counts of a file that was read, by the names of agents.

    Raises:
        ValueError: They are none.
    """
    if not isinstance(found, Mapping) or not all(
        isinstance(agent, str) and type(count) is int and count >= 0
        for agent, count in found.items()
    ):
        raise ValueError("expected names of agents with whole numbers")
    return dict(found)
