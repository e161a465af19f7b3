# SPDX-License-Identifier: Apache-2.0
"""The leaf that ticks a behaviour of a plug-in, kept apart from the run around it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import TypeVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.leaves import Leaf
from bt_agents.engine.scope import evaluate, holds
from bt_agents.errors import Refused
from bt_agents.language.expression.expressions import Expression
from bt_agents.language.specs import Plain

T = TypeVar("T")


class PluginLeaf(Leaf):
    """Makes a new behaviour at every start, sets it up, and ticks it to its end.

    The behaviour is no part of the tree: it gets its name and copies of its fields, nothing else.
    """

    acts = True
    _behaviour: Behaviour | None = None

    def begin(self) -> None:
        """Make the behaviour from what its fields mean now."""
        fields = {name: copy.deepcopy(self._field(name)) for name in self.spec.fields}
        self._behaviour = _contained(lambda: self._made(fields))
        _contained(self._behaviour.setup_with_descendants)

    def step(self) -> Status:
        """Tick it."""
        behaviour = self._behaviour
        assert behaviour is not None
        _contained(behaviour.tick_once)
        status, message = behaviour.status, behaviour.feedback_message
        if not isinstance(status, Status) or status is Status.INVALID:
            raise Refused(
                "NO_STATUS",
                f"{self.spec.kind} ended its tick as {status}, expected RUNNING, SUCCESS or "
                "FAILURE",
            )
        self.feedback_message = str(message)
        return status

    def end(self) -> None:
        """Stop it unless it has ended by itself, and let it take down what it has set up."""
        behaviour, self._behaviour = self._behaviour, None
        if behaviour is None:
            return
        try:
            if behaviour.status not in (Status.SUCCESS, Status.FAILURE):
                _contained(lambda: behaviour.stop(Status.INVALID))
        finally:
            for node in behaviour.iterate():
                _contained(node.shutdown)

    def _field(self, name: str) -> Plain:
        value = self.spec.fields[name]
        if isinstance(value, Expression):
            return holds(value, self.scope)
        return evaluate(value, self.scope)

    def _made(self, fields: dict[str, Plain]) -> Behaviour:
        assert self.spec.plugin is not None
        made = self.spec.plugin(name=self.spec.name, **fields)
        if not isinstance(made, Behaviour):
            raise Refused(
                "NO_BEHAVIOUR",
                f"{self.spec.kind} made a {type(made).__name__}, expected a py_trees Behaviour",
            )
        return made


def _contained(call: Callable[[], T]) -> T:
    """Return what a call of the plug-in returns; its wish to end the program is only an error.

    Raises:
        Refused: ``EXIT``. Every other error is passed on.
    """
    try:
        return call()
    except SystemExit:
        raise Refused("EXIT", "the plug-in wanted to end the program, which it may not") from None
