# SPDX-License-Identifier: Apache-2.0
"""Plug-ins: a behaviour of a package, isolated from the run around it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from typing import TypeVar
from uuid import UUID

from py_trees.behaviour import Behaviour
from py_trees.blackboard import Blackboard
from py_trees.common import Status

from bt_agents.engine.bases import Leaf
from bt_agents.engine.call_limit import bounded
from bt_agents.engine.context import NodeMaker, RunContext
from bt_agents.engine.environment import PluginNode
from bt_agents.engine.node_errors import reason_of, with_location
from bt_agents.engine.scope import Scope
from bt_agents_core.errors import LONGEST_REASON, Refused
from bt_agents_core.field_types import Plain
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import NodeSpec

BLOCKS_S = 0.25
"""Time limit of a call into a plug-in [s], well below the time the market waits for a host."""

BLOCKED_SHARE = 0.2
"""Factor of the time limit after each call of a behaviour that blocks."""

_LEAST_S = 0.001

T = TypeVar("T")


class PluginLeaf(Leaf):
    """Creates one behaviour for the run, sets it up once, and starts and ticks it like py_trees.

    The behaviour is not part of the tree: it gets its name, copies of its fields, the blackboard
    keys that its class declares, and a ROS node in ``setup`` where there is one. A new behaviour
    is created after an error, and when its fields have other values than at the last start. What
    it set up is cleaned up after the run. Its exceptions and blocking calls become a FAILURE.
    """

    has_side_effects = True
    _behaviour: Behaviour | None = None
    _node: PluginNode | None = None
    _made_of: Mapping[str, Plain] | None = None
    _follows_run = False
    _limit_s = BLOCKS_S

    def __init__(self, spec: NodeSpec, context: RunContext, scope: Scope) -> None:
        super().__init__(spec, context, scope)
        self._reads: Mapping[str, str] = getattr(spec.plugin, "reads", {})
        self._clients: set[UUID] = set()

    def begin(self) -> None:
        self._limit_s = BLOCKS_S
        shared = self._reads.values()
        fields = {
            name: copy.deepcopy(self._field(name))
            for name in self.spec.fields
            if name not in shared
        }
        if self._behaviour is not None and fields != self._made_of:
            self._close()
        if self._behaviour is None:
            self._set_up(fields)

    def step(self) -> Status:
        behaviour = self._behaviour
        assert behaviour is not None
        for key, name in self._reads.items():
            Blackboard.set(key, copy.deepcopy(self._field(name)))
        self._contained(behaviour.tick_once)
        status, message = behaviour.status, behaviour.feedback_message
        if not isinstance(status, Status) or status is Status.INVALID:
            raise Refused(
                RefusalCode.NO_STATUS,
                f"{self.spec.kind} ended its tick as {status}, expected RUNNING, SUCCESS or "
                "FAILURE",
            )
        self._write()
        lost = self._node.lost() if self._node is not None else ""
        if lost and status is Status.RUNNING:
            raise Refused(RefusalCode.LOST_GOAL, lost)
        self.feedback_message = ellipsize(printable(str(message)), LONGEST_REASON)
        return status

    def end(self) -> None:
        """Stop it unless it has ended by itself; shut it down if it has raised."""
        behaviour = self._behaviour
        if behaviour is None:
            return
        with ExitStack() as rest:
            if self._error:
                rest.callback(self._close)
            if self._node is not None:
                rest.callback(self._node.settle)
            if behaviour.status not in (Status.SUCCESS, Status.FAILURE):
                self._contained(lambda: behaviour.stop(Status.INVALID))

    def _set_up(self, fields: Mapping[str, Plain]) -> None:
        if not self._follows_run:
            self._follows_run = True
            self.context.on_close(self._end_run)
        behaviour = self._behaviour = self._contained(lambda: self._made(fields))
        self._made_of = fields
        self._node = self.context.open_plugin_node(self.spec.path)
        shared = {} if self._node is None else {"node": self._node.node}

        def set_up() -> None:
            for node in behaviour.iterate():
                node.setup(**shared)

        try:
            self._contained(set_up)
        except Exception:
            # The first error counts.
            with suppress(Exception):
                self._close()
            raise

    def _end_run(self) -> None:
        try:
            self._close()
        except Exception as error:
            text = with_location(reason_of(error), self.spec)
            self.context.environment.log("warning", f"at the end of the run: {text}")

    def _close(self) -> None:
        """Clean up what it has set up, and remove its keys from the blackboard."""
        behaviour, self._behaviour = self._behaviour, None
        plugin_node, self._node = self._node, None
        with ExitStack() as rest:
            if plugin_node is not None:
                rest.callback(self.context.forget_plugin_node, plugin_node)
                rest.callback(plugin_node.close)
            rest.callback(self._remove_keys)
            for node in behaviour.iterate() if behaviour is not None else ():
                rest.callback(self._contained, node.shutdown)

    def _remove_keys(self) -> None:
        """Remove its blackboard clients, and the keys that no other node of the run uses."""
        clients, self._clients = self._clients, set()
        for client in clients:
            Blackboard.clients.pop(client, None)
        keys = {_absolute(key) for key in (*self._reads, *self.spec.outputs.values())}
        for key, users in Blackboard.metadata.items():
            for of_kind in (users.read, users.write, users.exclusive):
                if not clients.isdisjoint(of_kind):
                    of_kind.difference_update(clients)
                    keys.add(key)
        for key in keys:
            users = Blackboard.metadata.get(key)
            if users is None or not (users.read or users.write or users.exclusive):
                Blackboard.metadata.pop(key, None)
                Blackboard.unset(key)

    def _write(self) -> None:
        """Copy the values that the behaviour wrote to the blackboard to their names."""
        for name, key in self.spec.outputs.items():
            if Blackboard.exists(key):
                value = Blackboard.get(key)
                if self._node is not None:
                    value = self._node.plain(value)
                if not _is_plain(value):
                    raise Refused(
                        RefusalCode.NOT_PLAIN,
                        f"{self.spec.kind} has put a {type(value).__name__} on the blackboard as "
                        f"'{key}', expected a message, or texts, numbers, lists and mappings",
                    )
                self.write(name, copy.deepcopy(value))

    def _field(self, name: str) -> Plain:
        value = self.spec.fields[name]
        if isinstance(value, Expression):
            return self.fields.is_true(name)
        return self.fields.value(name)

    def _made(self, fields: Mapping[str, Plain]) -> Behaviour:
        assert self.spec.plugin is not None
        made = self.spec.plugin(name=self.spec.name, **copy.deepcopy(dict(fields)))
        if not isinstance(made, Behaviour):
            raise Refused(
                RefusalCode.NO_BEHAVIOUR,
                f"{self.spec.kind} made a {type(made).__name__}, expected a py_trees Behaviour",
            )
        return made

    def _contained(self, call: Callable[[], T]) -> T:
        """Return the result of a call into the plug-in; it may neither block nor end the program.

        Blackboard clients that appear meanwhile are those of the plug-in, attached or not.

        Raises:
            Refused: ``BLOCKED`` or ``EXIT``. Every other error is passed on.
        """
        before = set(Blackboard.clients)
        try:
            return bounded(call, self._limit_s)
        except Refused as refused:
            if refused.code == RefusalCode.BLOCKED:
                self._limit_s = max(self._limit_s * BLOCKED_SHARE, _LEAST_S)
            raise
        except (Exception, KeyboardInterrupt):
            raise
        except SystemExit:
            raise Refused(
                RefusalCode.EXIT, "the plug-in wanted to end the program, which it may not"
            ) from None
        except BaseException as error:
            raise Refused(
                RefusalCode.EXIT, f"the plug-in raised {type(error).__name__}: {error}"
            ) from None
        finally:
            self._clients |= Blackboard.clients.keys() - before


def _absolute(key: str) -> str:
    return str(Blackboard.absolute_name(Blackboard.separator, key))


def _is_plain(value: object, levels: int = 20) -> bool:
    """Return whether a value has only texts, numbers, lists and mappings, not nested too deep."""
    match value:
        case None | bool() | int() | float() | str():
            return True
        case Mapping():
            return levels > 0 and all(
                isinstance(key, str) and _is_plain(one, levels - 1) for key, one in value.items()
            )
        case tuple() | list():
            return levels > 0 and all(_is_plain(one, levels - 1) for one in value)
    return False


BEHAVIOURS: dict[str, NodeMaker] = {}
"""Empty: :class:`PluginLeaf` makes every key of a package."""
