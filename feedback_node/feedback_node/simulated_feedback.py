# SPDX-License-Identifier: Apache-2.0
"""Simulated feedback for experiments: a prepared list instead of a person, as in the paper."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.scene import Vector
from bt_agents_language.model.experiment import PreparedFeedback

_OTHERS = ""


class SimulatedFeedback:
    """Supplies prepared feedback vectors, one per run.

    Section 2.3.4 of the paper: "a previously generated list of simulated user feedback". Every row
    of the list counts, including the first.
    """

    def __init__(self, prepared: PreparedFeedback) -> None:
        self._prepared = prepared
        self._given = 0
        # Used rows of the list of each agent, and of the common list.
        self._used: dict[str, int] = {}

    def resume(self, given: Mapping[str, int]) -> None:
        """Continue after a restart; ``given`` has the number of earlier feedbacks per agent."""
        self._given = sum(given.values())
        self._used.clear()
        for agent, count in given.items():
            whose = self._whose(agent)
            self._used[whose] = self._used.get(whose, 0) + count

    def next(self, agent: str) -> Vector | None:
        """Return the feedback for a run of ``agent`` that has just ended; None without one."""
        prepared = self._prepared
        meant = prepared.each.get(agent)
        if meant is None:
            whose = self._whose(agent)
            rows = prepared.sequences.get(whose, prepared.sequence)
            used = self._used.get(whose, 0)
            if not rows or (used >= len(rows) and not prepared.repeat):
                return None
            meant = rows[used % len(rows)]
            self._used[whose] = used + 1
        wrong = prepared.errors.instead(self._given) if prepared.errors else None
        self._given += 1
        return meant if wrong is None else wrong

    def _whose(self, agent: str) -> str:
        """Return whose rows an agent uses: its own name, or an empty one for the common list."""
        prepared = self._prepared
        return agent if agent in prepared.sequences or agent in prepared.each else _OTHERS
