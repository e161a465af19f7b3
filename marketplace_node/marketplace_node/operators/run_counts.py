# SPDX-License-Identifier: Apache-2.0
"""How often each agent has run, and when it ran last among all of them."""

from __future__ import annotations

from collections.abc import Mapping


class RunCounts:
    """Counts runs, also those of earlier starts of the market.

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
        """Note that an agent runs."""
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
