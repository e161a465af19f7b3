# SPDX-License-Identifier: Apache-2.0
"""Random: draws one child by weight."""

from __future__ import annotations

from random import Random

from py_trees.behaviour import Behaviour

from bt_agents.engine.bases import ChooseOne
from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.nodes.weight import Weight
from bt_agents.engine.scope import Scope
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.model.specs import NodeSpec


class RandomChoice(ChooseOne):
    """Ticks one child, drawn at each start with a probability proportional to its weight.

    Without repeats, children that were drawn are left out until all have been drawn; even then,
    no child is drawn twice in a row.
    """

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec, context, scope, build)
        seed = self.fields.constant("seed")
        self._context = context
        self._repeats = bool(self.fields.constant("repeats", True))
        self._had: set[Weight] = set()
        self._last: Weight | None = None
        self._random = Random(seed) if isinstance(seed, int) else context.random

    def pick(self) -> Behaviour:
        place = self._context.picked_child(self.spec)
        picked = self._drawn() if place is None else self.children[place]
        assert isinstance(picked, Weight)
        self._had.add(picked)
        self._last = picked
        self.feedback_message = f"picked '{picked.decorated.name}'"
        return picked

    def _drawn(self) -> Weight:
        weights: dict[Weight, float] = {}
        for child in self.children:
            assert isinstance(child, Weight)
            if (weight := child.fields.number("weight")) > 0:
                weights[child] = weight
        if not weights:
            raise Refused(
                RefusalCode.NO_WEIGHT, "all weights are 0, expected at least one larger number"
            )
        if not self._repeats:
            weights = self._not_had(weights)
        # Scaled, so that the sum of large weights stays finite.
        shares = [weight / max(weights.values()) for weight in weights.values()]
        [picked] = self._random.choices(list(weights), shares)
        return picked

    def _not_had(self, weights: dict[Weight, float]) -> dict[Weight, float]:
        left = {child: weight for child, weight in weights.items() if child not in self._had}
        if left:
            return left
        self._had.clear()
        others = {child: weight for child, weight in weights.items() if child is not self._last}
        return others or weights


BEHAVIOURS = {"random": RandomChoice}
