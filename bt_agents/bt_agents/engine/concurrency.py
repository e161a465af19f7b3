# SPDX-License-Identifier: Apache-2.0
"""The composite that does its children at the same time, and when it has succeeded or failed."""

from __future__ import annotations

from collections.abc import Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel

from bt_agents.engine.context import RunContext
from bt_agents.engine.fields import NodeFields
from bt_agents.engine.halting import FAILURE, RUNNING, SUCCESS
from bt_agents.engine.light_behaviour import LightBehaviour, adopt
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticking import CallTicked, Ticker
from bt_agents_core.field_types import Plain
from bt_agents_language.model.specs import NodeSpec

_ENDED = (SUCCESS, FAILURE)


class SuccessOnCount(ParallelPolicy.Base):
    """Success depends on so many children, whichever they are."""

    def __init__(self, count: int) -> None:
        super().__init__(synchronise=True)
        self.count = count


class CountingParallel(CallTicked, Parallel, LightBehaviour):
    """Ticks each child until it ends; ends itself as soon as it is certain how.

    ============== ================================== ==========================================
    ``succeed_on`` SUCCESS when                       FAILURE when
    ============== ================================== ==========================================
    all            every child has succeeded          any child has failed
    one, N         so many children have succeeded    fewer than so many can still succeed
    names          each of those has succeeded        any child has failed, one of those or not
    ============== ================================== ==========================================

    A failure in the tick of the last success of those named counts, as in py_trees. Children that
    still run at the end are stopped.
    """

    status: Status

    def __init__(
        self, spec: NodeSpec, _context: RunContext, scope: Scope, children: Sequence[Behaviour]
    ) -> None:
        succeed_on = NodeFields(spec=spec, names=scope).constant("succeed_on", "all")
        Parallel.__init__(self, spec.name, _policy(succeed_on, children))
        adopt(self, children)
        self.spec = spec

    def turn(self, tree: Ticker) -> Status:
        """Tick the children that have not ended."""
        if self.status is not RUNNING:
            for child in self.children:
                tree.drop_child(child)
            self.feedback_message = ""
        for child in self.children:
            if child.status not in _ENDED:
                tree.tick_child(child)
        status = self._decide()
        deciding = self._with(status)
        self.current_child = deciding[-1] if deciding else None
        return status

    def _decide(self) -> Status:
        succeeded = self._with(SUCCESS)
        failed = self._with(FAILURE)
        match self.policy:
            case ParallelPolicy.SuccessOnAll():
                needed = self.children
            case ParallelPolicy.SuccessOnSelected():
                needed = self.policy.children
            case policy:
                count = policy.count if isinstance(policy, SuccessOnCount) else 1
                return self._counted(count, len(succeeded), len(self.children) - len(failed))
        if failed:
            return FAILURE
        done = all(child.status is SUCCESS for child in needed)
        return SUCCESS if done else RUNNING

    def _counted(self, needed: int, succeeded: int, possible: int) -> Status:
        if succeeded >= needed:
            return SUCCESS
        if possible >= needed:
            return RUNNING
        self.feedback_message = f"{needed} had to succeed, at most {possible} still can"
        return FAILURE

    def _with(self, status: Status) -> list[Behaviour]:
        return [child for child in self.children if child.status is status]


def _policy(succeed_on: Plain, children: Sequence[Behaviour]) -> ParallelPolicy.Base:
    match succeed_on:
        case "one":
            return ParallelPolicy.SuccessOnOne()
        case int():
            return SuccessOnCount(succeed_on)
        case tuple():
            places = (place for place in succeed_on if isinstance(place, int))
            return ParallelPolicy.SuccessOnSelected([children[place] for place in places])
        case _:
            return ParallelPolicy.SuccessOnAll()
