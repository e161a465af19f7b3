# SPDX-License-Identifier: Apache-2.0
"""Plug-ins: a behaviour of a package, kept apart from the run around it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from contextlib import ExitStack
from typing import TypeVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.call_limit import bounded
from bt_agents.engine.context import NodeMaker
from bt_agents.engine.leaf import Leaf
from bt_agents_core.errors import LONGEST_REASON, Refused
from bt_agents_core.field_types import Plain
from bt_agents_language.expression.expressions import Expression

BLOCKS_S = 0.25
"""How long a call into a plug-in may take [s], well below what the market waits for a host."""

BLOCKED_SHARE = 0.2
"""Each time that a behaviour blocks its next call gets this part of the limit of the last one."""

_LEAST_S = 0.001

T = TypeVar("T")


class PluginLeaf(Leaf):
    """Makes a new behaviour at every start, sets it up, and ticks it to its end.

    The behaviour is no part of the tree: it gets its name and copies of its fields, nothing else.
    Whatever it raises, and a call of it that blocks, is a FAILURE.
    """

    has_side_effects = True
    _behaviour: Behaviour | None = None
    _limit_s = BLOCKS_S

    def begin(self) -> None:
        self._limit_s = BLOCKS_S
        fields = {name: copy.deepcopy(self._field(name)) for name in self.spec.fields}
        behaviour = self._behaviour = self._contained(lambda: self._made(fields))
        self._contained(behaviour.setup_with_descendants)

    def step(self) -> Status:
        behaviour = self._behaviour
        assert behaviour is not None
        self._contained(behaviour.tick_once)
        status, message = behaviour.status, behaviour.feedback_message
        if not isinstance(status, Status) or status is Status.INVALID:
            raise Refused(
                "NO_STATUS",
                f"{self.spec.kind} ended its tick as {status}, expected RUNNING, SUCCESS or "
                "FAILURE",
            )
        self.feedback_message = str(message)[:LONGEST_REASON]
        return status

    def end(self) -> None:
        """Stop it unless it has ended by itself, and let it take down what it has set up."""
        behaviour, self._behaviour = self._behaviour, None
        if behaviour is None:
            return
        with ExitStack() as rest:
            for node in behaviour.iterate():
                rest.callback(self._contained, node.shutdown)
            if behaviour.status not in (Status.SUCCESS, Status.FAILURE):
                self._contained(lambda: behaviour.stop(Status.INVALID))

    def _field(self, name: str) -> Plain:
        value = self.spec.fields[name]
        if isinstance(value, Expression):
            return self.fields.is_true(name)
        return self.fields.value(name)

    def _made(self, fields: dict[str, Plain]) -> Behaviour:
        assert self.spec.plugin is not None
        made = self.spec.plugin(name=self.spec.name, **fields)
        if not isinstance(made, Behaviour):
            raise Refused(
                "NO_BEHAVIOUR",
                f"{self.spec.kind} made a {type(made).__name__}, expected a py_trees Behaviour",
            )
        return made

    def _contained(self, call: Callable[[], T]) -> T:
        """Return what a call of the plug-in returns; it may neither block nor end the program.

        Raises:
            Refused: ``BLOCKED``, ``EXIT``. Every other error is passed on.
        """
        try:
            return bounded(call, self._limit_s)
        except Refused as refused:
            if refused.code == "BLOCKED":
                self._limit_s = max(self._limit_s * BLOCKED_SHARE, _LEAST_S)
            raise
        except (Exception, KeyboardInterrupt):
            raise
        except SystemExit:
            raise Refused(
                "EXIT", "the plug-in wanted to end the program, which it may not"
            ) from None
        except BaseException as error:
            raise Refused("EXIT", f"the plug-in raised {type(error).__name__}: {error}") from None


BEHAVIOURS: dict[str, NodeMaker] = {}
"""None of its own: every key that a package brings is made by :class:`PluginLeaf`."""
