# SPDX-License-Identifier: Apache-2.0
"""Statistics of a market: runs, rounds in which the shadow disagrees, and starved agents."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from marketplace_node.round.decision import AuctionOutcome, Decision


class MarketStatistics:
    """Counters over the rounds of a market.

    Attributes:
        shadow_rounds: Awarded rounds that the strategies in force, the one that ranks and its
            shadow, have both ranked.
        shadow_disagreements: In how many of these they had another winner.
    """

    def __init__(self) -> None:
        self.shadow_rounds = 0
        self.shadow_disagreements = 0
        self.starvation = Starvation()
        self._compared = ("", "")

    def take(self, decision: Decision) -> None:
        """Count a decision; one that only foretells is not to be counted."""
        winner, terms = decision.winner, decision.terms
        if winner is None or decision.outcome is not AuctionOutcome.AWARDED:
            return
        if (terms.strategy, terms.shadow) != self._compared:
            self._compared = (terms.strategy, terms.shadow)
            self.shadow_rounds = self.shadow_disagreements = 0
        if decision.shadow_winner and decision.ranked.by == terms.strategy:
            self.shadow_rounds += 1
            self.shadow_disagreements += decision.shadow_winner != winner.agent


class Starvation:
    """Counter of the awarded rounds in which each agent bid since it ran last.

    Rounds in which it did not bid neither count nor clear it.
    """

    def __init__(self) -> None:
        self._in_vain: dict[str, int] = {}
        self._warned: set[str] = set()
        self._found: tuple[int, tuple[str, ...]] | None = None

    @property
    def in_vain(self) -> Mapping[str, int]:
        """In how many rounds with a run each agent has bid since it ran last."""
        return self._in_vain

    def restore(self, in_vain: Mapping[str, int]) -> None:
        """Take over what an earlier market has counted."""
        self._in_vain, self._found = dict(in_vain), None

    def ran(self, winner: str, bidders: Iterable[str]) -> None:
        """Note who runs, be it the best of those that bid or the next who took it."""
        self._found = None
        for agent in bidders:
            self._in_vain[agent] = 0 if agent == winner else self._in_vain.get(agent, 0) + 1
        self._warned.discard(winner)

    def starved(self, limit: int) -> tuple[str, ...]:
        """Return the agents with at least ``limit`` bids in vain, by name; none for 0."""
        if not limit:
            return ()
        if self._found is None or self._found[0] != limit:
            named = sorted(agent for agent, count in self._in_vain.items() if count >= limit)
            self._found = (limit, tuple(named))
        return self._found[1]

    def newly_starved(self, limit: int) -> list[str]:
        """Return a warning for each agent that has become starved, once until it runs again."""
        starved = self.starved(limit)
        fresh = [agent for agent in starved if agent not in self._warned]
        self._warned = set(starved)
        return [
            f"{agent} is starved: it has bid in {self._in_vain[agent]} awarded rounds and got no "
            "run; a strategy that explores (softmax, ucb) gives it a chance"
            for agent in fresh
        ]


class RunCounts:
    """Counter of the runs of each agent, also those of earlier starts of the market.

    Attributes:
        earlier: How many runs there were before this start.
    """

    def __init__(self) -> None:
        self.earlier = 0
        self._runs: dict[str, int] = {}
        self._last: dict[str, int] = {}

    @property
    def total(self) -> int:
        """How many runs there were in all."""
        return sum(self._runs.values())

    @property
    def runs(self) -> dict[str, int]:
        """How often each agent has run that ever did; a copy."""
        return dict(self._runs)

    @property
    def last_run(self) -> dict[str, int]:
        """Number of the last run of each, from 1; a copy."""
        return dict(self._last)

    def count(self, agent: str) -> None:
        """Count a run of an agent."""
        self._runs[agent] = self._runs.get(agent, 0) + 1
        self._last[agent] = self.total

    def restore(self, runs: Mapping[str, int], last: Mapping[str, int]) -> None:
        """Go on from what an earlier start has counted."""
        self._runs, self._last = dict(runs), dict(last)
        self.earlier = self.total


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
