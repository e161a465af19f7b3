# SPDX-License-Identifier: Apache-2.0
"""Tells which agents bid again and again and never get a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping


class Starvation:
    """Counts for each agent the rounds with a run in which it bid, since it ran last.

    Rounds in which it did not bid neither count nor clear it.
    """

    def __init__(self) -> None:
        self._in_vain: dict[str, int] = {}
        self._told: set[str] = set()
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
        self._told.discard(winner)

    def starved(self, limit: int) -> tuple[str, ...]:
        """Return who has bid in at least ``limit`` rounds in vain, by name; nobody for 0."""
        if not limit:
            return ()
        if self._found is None or self._found[0] != limit:
            named = sorted(agent for agent, count in self._in_vain.items() if count >= limit)
            self._found = (limit, tuple(named))
        return self._found[1]

    def news(self, limit: int) -> list[str]:
        """Return a warning for each agent that has become starved, once until it runs again."""
        starved = self.starved(limit)
        fresh = [agent for agent in starved if agent not in self._told]
        self._told = set(starved)
        return [
            f"{agent} is starved: it has bid in {self._in_vain[agent]} awarded rounds and got no "
            "run; a strategy that explores (softmax, ucb) gives it a chance"
            for agent in fresh
        ]
