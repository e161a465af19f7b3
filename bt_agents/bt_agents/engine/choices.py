# SPDX-License-Identifier: Apache-2.0
"""Composites that do one of their children: the first case that fits, or one at random."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite

from bt_agents.engine.context import RunContext
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.halting import FAILURE, RUNNING
from bt_agents.engine.light_behaviour import LightBehaviour, adopt
from bt_agents.engine.modifiers import NodeDecorator
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticking import CallTicked, Ticker
from bt_agents_core.errors import Refused
from bt_agents_language.model.specs import NodeSpec


class Case(NodeDecorator):
    """A child of a ``choose``; the one that is done otherwise has no condition."""

    def misfit(self) -> str:
        """Return why the case does not fit now, empty when it does."""
        if "condition" not in self.fields:
            return ""
        try:
            if self.fields.holds("condition"):
                return ""
        except Exception as error:
            return reason_of(error)
        return self.fields.not_so("condition")


class Weight(NodeDecorator):
    """A child of a ``random``."""

    def weight(self) -> float:
        """Return how often it is picked, compared with the others; may raise."""
        return self.fields.number("weight")


class ChooseOne(CallTicked, Composite, LightBehaviour):
    """Picks one child when it starts and ends as that one does; a pick that fails is a FAILURE."""

    status: Status

    def __init__(self, spec: NodeSpec, children: Sequence[Behaviour]) -> None:
        Composite.__init__(self, spec.name)
        adopt(self, children)
        self.spec = spec

    def pick(self) -> Behaviour:
        """Return the child to be done, noting which in the message; may raise."""
        raise NotImplementedError

    def turn(self, tree: Ticker) -> Status:
        """Pick at the start, then tick what was picked."""
        if self.status is not RUNNING:
            for child in self.children:
                tree.drop_child(child)
            self.current_child = self._picked()
        return FAILURE if self.current_child is None else tree.tick_child(self.current_child)

    def _picked(self) -> Behaviour | None:
        try:
            return self.pick()
        except Exception as error:
            self.feedback_message = with_location(reason_of(error), self.spec)
            return None


class Choose(ChooseOne):
    """Does the first of its cases that fits when it starts; a later one is never tried instead."""

    def __init__(
        self, spec: NodeSpec, _context: RunContext, _scope: Scope, cases: Sequence[Case]
    ) -> None:
        super().__init__(spec, cases)
        self._cases = tuple(cases)

    def pick(self) -> Behaviour:
        """Look at the cases in order."""
        misfits = []
        for case in self._cases:
            misfit = case.misfit()
            if not misfit:
                self.feedback_message = f"case '{case.name}'"
                return case
            misfits.append(f"{case.name}: {misfit}")
        raise Refused("NO_CASE", f"no case fits; {'; '.join(misfits)}")


class RandomChoice(ChooseOne):
    """Does one of its children, picked when it starts, the more often the larger its weight."""

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, choices: Sequence[Weight]
    ) -> None:
        super().__init__(spec, choices)
        self._choices = tuple(choices)
        seed = NodeFields(spec=spec, names=scope).constant("seed")
        self._random = Random(seed) if isinstance(seed, int) else context.random

    def pick(self) -> Behaviour:
        """Draw among those whose weight is not 0."""
        weights = {choice: weight for choice in self._choices if (weight := choice.weight()) > 0}
        if not weights:
            raise Refused("NO_WEIGHT", "all weights are 0, expected at least one larger number")
        largest = max(weights.values())
        # Scaled, so that the sum of large weights is finite.
        [picked] = self._random.choices(
            list(weights), [weight / largest for weight in weights.values()]
        )
        self.feedback_message = f"picked '{picked.decorated.name}'"
        return picked
