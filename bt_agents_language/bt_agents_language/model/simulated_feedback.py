# SPDX-License-Identifier: Apache-2.0
"""Simulated feedback for experiments: a prepared list instead of a person, as in the paper."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents_core.scene import SceneSpace, Vector


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Which of the feedback is wrong, and what is said instead.

    Attributes:
        space: The scene parameters.
        seed: Seed of the chance.
        every: Each so-manyth feedback is wrong; 0 when chance decides.
        share: Probability that a feedback is wrong, 0..1; 0 when ``every`` decides.
        value: What is said then; None draws each value evenly from the range of its parameter.
    """

    space: SceneSpace
    seed: int
    every: int = 0
    share: float = 0.0
    value: Vector | None = None

    def instead(self, index: int) -> Vector | None:
        """Return what is said in place of the feedback of an index, from 0; None when it is right.

        It depends on seed and index alone, so a restart changes nothing.
        """
        if self.every and (index + 1) % self.every:
            return None
        chance = random.Random(f"{self.seed}/{index}")
        if not self.every and chance.random() >= self.share:
            return None
        if self.value is not None:
            return self.value
        return tuple(chance.uniform(p.minimum, p.maximum) for p in self.space.parameters)


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
        errors: Errors | None = None,
    ) -> None:
        """Prepare the feedback.

        Args:
            each: Agent → the vector it is given after every one of its runs.
            sequence: Vectors used up in order, whichever other agent ran.
            repeat: True starts the sequence again after its end.
            errors: Which of all the feedback is wrong; None for none.
        """
        self.each = dict(each or {})
        self.errors = errors
        self._given = 0
        self.sequence = tuple(sequence)
        self.repeat = repeat
        self._used = 0

    def afresh(self, errors: Errors | None) -> SimulatedFeedback:
        """Return the same list from its start, with these errors."""
        return SimulatedFeedback(self.each, self.sequence, self.repeat, errors)

    def resume(self, given: Mapping[str, int]) -> None:
        """Go on after feedback that was given before a restart.

        Args:
            given: Agent → how often it was given some.
        """
        self._given = sum(given.values())
        self._used = sum(count for agent, count in given.items() if agent not in self.each)
        if self.repeat and self.sequence:
            self._used %= len(self.sequence)

    def next(self, agent: str) -> Vector | None:
        """Return the feedback for a run of ``agent`` that has just ended; None for no feedback."""
        meant = self._meant(agent)
        if meant is None:
            return None
        wrong = self.errors.instead(self._given) if self.errors else None
        self._given += 1
        return meant if wrong is None else wrong

    def _meant(self, agent: str) -> Vector | None:
        if agent in self.each:
            return self.each[agent]
        if self._used >= len(self.sequence):
            if not (self.repeat and self.sequence):
                return None
            self._used = 0
        vector = self.sequence[self._used]
        self._used += 1
        return vector
