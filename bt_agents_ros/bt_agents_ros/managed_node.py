# SPDX-License-Identifier: Apache-2.0
"""Managed node: configured, it has read its files; active, it takes part in the system."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, ClassVar, Generic, TypeVar

from lifecycle_msgs.msg import Transition
from rclpy.action import ActionClient, ActionServer
from rclpy.task import Future

from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.lifecycle import Lifecycle
from bt_agents_ros.parameters import (
    StartParameter,
    declare,
    declare_start,
    describe,
    report_unknown,
)
from bt_agents_ros.signals import check_interrupt
from bt_agents_ros.spinner import LAST_RESULTS_S, STOP_LIMIT_S
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.workarounds.bounded_end import ending_in_time

_CALLBACKS = (
    "_pre_set_parameters_callbacks",
    "_on_set_parameters_callbacks",
    "_post_set_parameters_callbacks",
)

_DESTROY = {
    "timers": "destroy_timer",
    "subscriptions": "destroy_subscription",
    "services": "destroy_service",
    "clients": "destroy_client",
    "publishers": "destroy_publisher",
    "guards": "destroy_guard_condition",
}
"""Node attribute that lists entities → its method that destroys one and its event handlers."""


AUTOSTART = "autostart"

DEACTIVATION_S = 15.0
"""Time for ongoing work to end when a node is deactivated [s].

The market gives a run 14 s to end after a stop request.
"""

_POLL_S = 0.02

ConfigurationT = TypeVar("ConfigurationT")
NodeT = TypeVar("NodeT", bound="ManagedNode[Any]")


class Activation:
    """Endpoints, timers, parameters and callbacks that a node gets after this object is made.

    In rclpy, their only scope is the node itself.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        # The objects themselves, because the id of a deleted object may be reused.
        self._before = [one for kind in (*_DESTROY, "waitables") for one in getattr(node, kind)]
        self._parameters = frozenset(node._parameters)
        self._callbacks = {name: list(getattr(node, name)) for name in _CALLBACKS}

    def end(self, *, keeps: Callable[[str], bool]) -> None:
        """Destroy everything that was made.

        Args:
            keeps: Whether a parameter keeps its value when it is declared again.
        """
        node = self._node
        before = {id(entity) for entity in self._before}

        def made(kind: str) -> list[Any]:
            return [one for one in getattr(node, kind) if id(one) not in before]

        for waitable in made("waitables"):
            if isinstance(waitable, (ActionClient, ActionServer)):
                waitable.destroy()
        for kind, destroy in _DESTROY.items():
            for entity in made(kind):
                getattr(node, destroy)(entity)
        for waitable in made("waitables"):
            node.remove_waitable(waitable)
        for name, callbacks in self._callbacks.items():
            getattr(node, name)[:] = callbacks
        for name in node._parameters.keys() - self._parameters:
            # Read-only parameters cannot be undeclared.
            parameter = node._parameters.pop(name)
            del node._descriptors[name]
            if keeps(name):
                node._parameter_overrides[name] = parameter


class ManagedNode(BaseNode, Generic[ConfigurationT]):
    """Node with a life cycle; while inactive, it has parameters but takes no part in the system.

    A subclass defines :meth:`configure`, :meth:`activate`, :meth:`begin_stop` and
    :meth:`has_stopped`. All rclpy objects that :meth:`activate` makes are destroyed when the node
    is deactivated or its activation fails.

    Args:
        configuration: Configuration with which it starts active; None leaves it unconfigured.
        node_kwargs: Arguments for :class:`rclpy.node.Node`.

    Attributes:
        node_name: Name of the node.
        start_parameters: Parameters whose values :meth:`configure` gets.
        stop_limit_s: How long its process waits for :meth:`has_stopped` when it ends [s].
        process_ends: Whether its process ends, so that work has ``stop_limit_s`` to end instead
            of :data:`DEACTIVATION_S`.
    """

    node_name: ClassVar[str]
    start_parameters: ClassVar[tuple[StartParameter, ...]] = ()
    stop_limit_s: ClassVar[float] = STOP_LIMIT_S

    def __init__(self, configuration: ConfigurationT | None = None, **node_kwargs: Any) -> None:
        super().__init__(self.node_name, **node_kwargs)
        for parameter in self.start_parameters:
            declare_start(self, parameter)
        self._configuration: ConfigurationT | None = None
        self._closing: ExitStack | None = None
        self.process_ends = False
        self._lifecycle = Lifecycle(self, self._make_transition)
        if configuration is not None:
            with self._lifecycle.transition(Transition.TRANSITION_CONFIGURE):
                self._configuration = configuration
            try:
                self._activate()
            except BaseException:
                with ending_in_time():
                    self.destroy_node()
                raise

    def configure(self, values: Mapping[str, str]) -> ConfigurationT:
        """Return the configuration for the activation, as its start parameters say.

        Raises:
            BtAgentsError: It cannot be read; the node stays unconfigured.
        """
        raise NotImplementedError

    def activate(self, configuration: ConfigurationT, closing: ExitStack) -> None:
        """Make everything that takes part in the system.

        Args:
            configuration: Result of :meth:`configure`.
            closing: Takes the cleanup of everything but endpoints and timers, such as files.

        Raises:
            BtAgentsError: The activation fails; the node stays inactive.
        """
        raise NotImplementedError

    def begin_stop(self) -> None:
        """Start ending ongoing work; called again if the process ends during a deactivation."""

    def has_stopped(self) -> bool:
        """Return True when all work has ended."""
        return True

    def keeps(self, _parameter: str) -> bool:
        """Return whether the value of a parameter lasts until the next activation."""
        return True

    @property
    def is_active(self) -> bool:
        """True from the activation until everything that it made is destroyed."""
        return self._closing is not None

    def start(self) -> None:
        """Configure and activate the node.

        Raises:
            BtAgentsError: The configuration or activation failed.
        """
        self._configure()
        self._activate()

    def request_stop(self) -> None:
        """Start ending ongoing work, if the node is active, because its process ends."""
        if self.is_active and not self.process_ends:
            self.process_ends = True
            self.begin_stop()

    def stopped(self) -> bool:
        """Return True when no work is going on."""
        return not self.is_active or self.has_stopped()

    def destroy_node(self) -> None:
        """Close everything that the node has open, and destroy it."""
        if self._closing is not None:
            closing, self._closing = self._closing, None
            closing.close()
        self._lifecycle.destroy()
        super().destroy_node()

    async def _make_transition(self, number: int) -> None:
        if number == Transition.TRANSITION_CONFIGURE:
            self._configure()
        elif number == Transition.TRANSITION_ACTIVATE:
            self._activate()
            report_unknown(self, *self.executor.get_nodes())
        else:
            with self._lifecycle.transition(number):
                if self.is_active:
                    await self._end_activation()
                if number != Transition.TRANSITION_DEACTIVATE:
                    self._configuration = None

    def _configure(self) -> None:
        with self._lifecycle.transition(Transition.TRANSITION_CONFIGURE):
            self._configuration = self.configure(
                {
                    one.name: str(self.get_parameter(one.name).value)
                    for one in self.start_parameters
                }
            )

    def _activate(self) -> None:
        with self._lifecycle.transition(Transition.TRANSITION_ACTIVATE):
            assert self._configuration is not None, "it is configured"
            with ExitStack() as closing:
                closing.callback(
                    Activation(self).end, keeps=lambda one: self.is_active and self.keeps(one)
                )
                self.activate(self._configuration, closing)
                self._closing = closing.pop_all()

    async def _end_activation(self) -> None:
        assert self._closing is not None, "it is active"
        if not self.process_ends:
            self.begin_stop()
        if not await self._comes_true(DEACTIVATION_S, self.has_stopped):
            self.get_logger().error(
                f"what was under way has not ended within {DEACTIVATION_S:g} s: it is cut off"
            )
        await self._comes_true(LAST_RESULTS_S, lambda: False)
        try:
            self._closing.close()
        finally:
            self._closing = None
            self.process_ends = False

    async def _comes_true(self, limit_s: float, done: Callable[[], bool]) -> bool:
        """Wait until ``done()`` or for ``limit_s`` seconds; return whether it came true."""
        ended, end = Future(executor=self.executor), time.monotonic() + limit_s

        def poll() -> None:
            if not ended.done() and time.monotonic() >= end:
                ended.set_result(False)
            elif not ended.done() and done():
                ended.set_result(True)

        timer = steady_timer(self, _POLL_S, poll)
        try:
            return bool(await ended)
        finally:
            self.destroy_timer(timer)


def make_managed(kind: Callable[[], NodeT], before: Callable[[], None] = lambda: None) -> NodeT:
    """Return a node for a process: active, or unconfigured if ``autostart`` is off.

    Args:
        kind: Makes the unconfigured node.
        before: Called before a start of the node; it may refuse the start.

    Raises:
        BtAgentsError: The node cannot be configured or activated.
    """
    node = kind()
    try:
        check_interrupt()
        starts = declare(
            node,
            AUTOSTART,
            True,
            describe(
                "true: the node configures and activates itself at once; false: it waits until it "
                "is told to, for example by a lifecycle manager",
                read_only=True,
            ),
        )
        if starts:
            before()
            node.start()
    except BaseException:
        with ending_in_time():
            node.destroy_node()
        raise
    return node
