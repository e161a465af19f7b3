# SPDX-License-Identifier: Apache-2.0
"""Parallel: runs its children at the same time until the result is certain."""

from __future__ import annotations

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from bt_agents.engine.bases import Composite
from bt_agents.engine.context import BuildChild, RunContext
from bt_agents.engine.light_behaviour import FAILURE, INVALID, RUNNING, SUCCESS
from bt_agents.engine.scope import Scope
from bt_agents.engine.ticker import Ticker
from bt_agents_language.model.specs import NodeSpec

_ENDED = (SUCCESS, FAILURE)


class CountingParallel(Composite, composites.Parallel):
    """Ticks each child until it ends; ends as soon as its own result is certain.

    ============== ================================== ==========================================
    ``succeed_on`` SUCCESS when                       FAILURE when
    ============== ================================== ==========================================
    all            every child has succeeded          any child has failed
    one, N         that many children have succeeded  fewer than that many can still succeed
    names          each of those has succeeded        any child has failed, one of those or not
    ============== ================================== ==========================================

    A failure in the same tick as the last success of the named children counts, as in py_trees.
    Children that still run at the end are stopped.
    """

    def __init__(
        self, spec: NodeSpec, context: RunContext, scope: Scope, build: BuildChild
    ) -> None:
        super().__init__(spec, context, scope, build)
        # The display functions of py_trees read it.
        self.policy = ParallelPolicy.SuccessOnAll()
        self._count: int | None = None
        self._named = self.children
        match self.fields.constant("succeed_on", "all"):
            case "one":
                self._count = 1
                self.policy = ParallelPolicy.SuccessOnOne()
            case int(count):
                self._count = count
                self.policy = ParallelPolicy.Base(synchronise=True)
            case tuple(places):
                self._named = [self.children[place] for place in places if isinstance(place, int)]
                self.policy = ParallelPolicy.SuccessOnSelected(self._named)

    def tick_children(self, ticker: Ticker) -> Status:
        if self.status is not RUNNING:
            for child in self.children:
                ticker.reset_child(child)
            self.feedback_message = ""
        for child in self.children:
            if child.status not in _ENDED:
                ticker.tick_child(child)
        status = self._decide()
        deciding = self._with(status)
        self.current_child = deciding[-1] if deciding else None
        if status is not RUNNING:
            for child in self._with(RUNNING):
                ticker.reset_child(child)
        return status

    def stop(self, new_status: Status) -> None:
        """Set the status; INVALID also stops the children, running ones first."""
        if new_status is INVALID:
            for child in self._with(RUNNING):
                child.stop(INVALID)
        super().stop(new_status)

    def _decide(self) -> Status:
        succeeded, failed = len(self._with(SUCCESS)), len(self._with(FAILURE))
        if self._count is not None:
            return self._counted(self._count, succeeded, len(self.children) - failed)
        if failed:
            return FAILURE
        done = all(child.status is SUCCESS for child in self._named)
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


BEHAVIOURS = {"parallel": CountingParallel}
