# SPDX-License-Identifier: Apache-2.0
"""Simulated feedback for experiments: a prepared list instead of a person, as in the paper."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.scene import Vector
from bt_agents_language.model.experiment import PreparedFeedback


class SimulatedFeedback:
    """Hands out prepared feedback vectors, one for each run.

    Section 2.3.4 of the paper: "a previously generated list of simulated user feedback". Every row
    of the list counts, the first one too.
    """

    def __init__(self, prepared: PreparedFeedback) -> None:
        self._prepared = prepared
        self._given = 0
        self._used = 0

    def resume(self, given: Mapping[str, int]) -> None:
        """Go on after a restart before which each agent was given some feedback, so often."""
        prepared = self._prepared
        self._given = sum(given.values())
        self._used = sum(count for agent, count in given.items() if agent not in prepared.each)
        if prepared.repeat and prepared.sequence:
            self._used %= len(prepared.sequence)

    def next(self, agent: str) -> Vector | None:
        """Return the feedback for a run of ``agent`` that has just ended; None for no feedback."""
        prepared = self._prepared
        meant = prepared.each.get(agent)
        if meant is None:
            if prepared.repeat and self._used >= len(prepared.sequence):
                self._used = 0
            if self._used >= len(prepared.sequence):
                return None
            meant = prepared.sequence[self._used]
            self._used += 1
        wrong = prepared.errors.instead(self._given) if prepared.errors else None
        self._given += 1
        return meant if wrong is None else wrong
