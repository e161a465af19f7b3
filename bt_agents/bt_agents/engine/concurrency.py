# SPDX-License-Identifier: Apache-2.0
"""The composite that does its children at the same time, and when it has succeeded or failed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel

from bt_agents.engine.context import RunContext
from bt_agents.engine.fields import Fields
from bt_agents.engine.scope import Scope
from bt_agents.language.specs import NodeSpec, Plain

_ENDED = (Status.SUCCESS, Status.FAILURE)


class SuccessOnCount(ParallelPolicy.Base):
    """Success depends on so many children, whichever they are."""

    def __init__(self, count: int) -> None:
        super().__init__(synchronise=True)
        self.count = count


class CountingParallel(Parallel):
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
        succeed_on = Fields(spec=spec, names=scope).constant("succeed_on", "all")
        super().__init__(spec.name, _policy(succeed_on, children), children)
        self.spec = spec

    def tick(self) -> Iterator[Behaviour]:
        """Tick the children that have not ended."""
        if self.status is not Status.RUNNING:
            for child in self.children:
                if child.status is not Status.INVALID:
                    child.stop(Status.INVALID)
            self.feedback_message = ""
        for child in self.children:
            if child.status not in _ENDED:
                yield from child.tick()
        status = self._decide()
        self.current_child = self._with(status)[-1] if self._with(status) else None
        if status is Status.RUNNING:
            self.status = status
        else:
            self.stop(status)
        yield self

    def _decide(self) -> Status:
        succeeded = self._with(Status.SUCCESS)
        failed = self._with(Status.FAILURE)
        match self.policy:
            case ParallelPolicy.SuccessOnAll():
                needed = self.children
            case ParallelPolicy.SuccessOnSelected():
                needed = self.policy.children
            case policy:
                count = policy.count if isinstance(policy, SuccessOnCount) else 1
                return self._counted(count, len(succeeded), len(self.children) - len(failed))
        if failed:
            return Status.FAILURE
        done = all(child.status is Status.SUCCESS for child in needed)
        return Status.SUCCESS if done else Status.RUNNING

    def _counted(self, needed: int, succeeded: int, possible: int) -> Status:
        if succeeded >= needed:
            return Status.SUCCESS
        if possible >= needed:
            return Status.RUNNING
        self.feedback_message = f"{needed} had to succeed, at most {possible} still can"
        return Status.FAILURE

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
