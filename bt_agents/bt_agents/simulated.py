# SPDX-License-Identifier: Apache-2.0
"""Simulated feedback for experiments: a prepared list instead of a person, as in the paper."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents.scene import Vector


class SimulatedFeedback:
    """Hands out prepared feedback vectors, one for each run.

    Section 2.3.4 of the paper: "a previously generated list of simulated user feedback". Every row
    of the list counts, the first one too.
    """

    def __init__(
        self,
        each: Mapping[str, Vector] | None = None,
        sequence: tuple[Vector, ...] = (),
        repeat: bool = False,
    ) -> None:
        """Prepare the feedback.

        Args:
            each: Agent → the vector it is given after every one of its runs.
            sequence: Vectors used up in order, whichever other agent ran.
            repeat: True starts the sequence again after its end.
        """
        self.each = dict(each or {})
        self._sequence = tuple(sequence)
        self._repeat = repeat
        self._used = 0

    def resume(self, given: Mapping[str, int]) -> None:
        """Go on after feedback that was given before a restart.

        Args:
            given: Agent → how often it was given some.
        """
        self._used = sum(count for agent, count in given.items() if agent not in self.each)
        if self._repeat and self._sequence:
            self._used %= len(self._sequence)

    def next(self, agent: str) -> Vector | None:
        """Return the feedback for a run of ``agent`` that has just ended; None for no feedback."""
        if agent in self.each:
            return self.each[agent]
        if self._used >= len(self._sequence):
            if not (self._repeat and self._sequence):
                return None
            self._used = 0
        vector = self._sequence[self._used]
        self._used += 1
        return vector
