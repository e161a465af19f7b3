# SPDX-License-Identifier: Apache-2.0
"""Managed node: configured it has read its files, active it takes part in the system."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, ClassVar, Generic, TypeVar

from lifecycle_msgs.msg import Transition
from rclpy.task import Future

from bt_agents_ros.activation import Activation
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

AUTOSTART = "autostart"

DEACTIVATION_S = 15.0
"""Time that what is under way has to end when a node is deactivated [s].

The market gives a run 14 s to end after it was told to stop.
"""

_POLL_S = 0.02

ConfigurationT = TypeVar("ConfigurationT")
NodeT = TypeVar("NodeT", bound="ManagedNode[Any]")


class ManagedNode(BaseNode, Generic[ConfigurationT]):
    """Node with the states of a life cycle; inactive it has parameters and no part in the system.

    A subclass says what it reads and makes: :meth:`configure`, :meth:`activate`,
    :meth:`begin_stop` and :meth:`has_stopped`. All that :meth:`activate` makes of rclpy is
    destroyed when the node is deactivated, and when it cannot be activated.

    Args:
        name: Of the node.
        configuration: What it is active with at once; None leaves it unconfigured.
        node_kwargs: For :class:`rclpy.node.Node`.

    Attributes:
        start_parameters: What :meth:`configure` gets the values of.
        stop_limit_s: How long its process waits for :meth:`has_stopped` when it ends [s].
    """

    start_parameters: ClassVar[tuple[StartParameter, ...]] = ()
    stop_limit_s: ClassVar[float] = STOP_LIMIT_S

    def __init__(
        self, name: str, configuration: ConfigurationT | None = None, **node_kwargs: Any
    ) -> None:
        super().__init__(name, **node_kwargs)
        for parameter in self.start_parameters:
            declare_start(self, parameter)
        self._configuration: ConfigurationT | None = None
        self._closing: ExitStack | None = None
        self._is_stopping = False
        self._lifecycle = Lifecycle(self, self._make_transition)
        if configuration is not None:
            with self._lifecycle.transition(Transition.TRANSITION_CONFIGURE):
                self._configuration = configuration
            try:
                self._activate()
            except BaseException:
                self.destroy_node()
                raise

    def configure(self, values: Mapping[str, str]) -> ConfigurationT:
        """Return what it needs to be active, read as its start parameters say.

        Raises:
            BtAgentsError: It cannot be read; the node stays unconfigured.
        """
        raise NotImplementedError

    def activate(self, configuration: ConfigurationT, closing: ExitStack) -> None:
        """Make what takes part in the system.

        Args:
            configuration: What it is made of.
            closing: Takes what closes all that is neither an endpoint nor a timer, such as files.

        Raises:
            BtAgentsError: That cannot be; the node stays inactive.
        """
        raise NotImplementedError

    def begin_stop(self) -> None:
        """Start ending what is under way; called once while it is active."""

    def has_stopped(self) -> bool:
        """Return True when nothing is under way any more."""
        return True

    def keeps(self, _parameter: str) -> bool:
        """Return whether the value of a parameter counts at the next activation."""
        return True

    @property
    def is_active(self) -> bool:
        """True from the activation until all is destroyed that it has made."""
        return self._closing is not None

    def start(self) -> None:
        """Configure and activate it.

        Raises:
            BtAgentsError: One of the two failed.
        """
        self._configure()
        self._activate()

    def request_stop(self) -> None:
        """Start ending what is under way, if it is active."""
        if self.is_active and not self._is_stopping:
            self._is_stopping = True
            self.begin_stop()

    def stopped(self) -> bool:
        """Return True when nothing is under way."""
        return not self.is_active or self.has_stopped()

    def destroy_node(self) -> None:
        """Destroy the node; what it has open is closed."""
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
        self.request_stop()
        if not await self._comes_true(DEACTIVATION_S, self.has_stopped):
            self.get_logger().error(
                f"what was under way has not ended within {DEACTIVATION_S:g} s: it is cut off"
            )
        await self._comes_true(LAST_RESULTS_S, lambda: False)
        try:
            self._closing.close()
        finally:
            self._closing = None
            self._is_stopping = False

    async def _comes_true(self, limit_s: float, done: Callable[[], bool]) -> bool:
        """Return whether ``done()`` came true, once it has or ``limit_s`` seconds have passed."""
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
    """Return a node of a process: active, or unconfigured where ``autostart`` says so.

    Args:
        kind: Makes it unconfigured.
        before: Called before it is started, if it is; it may refuse that.

    Raises:
        BtAgentsError: It cannot be configured or activated.
    """
    node = kind()
    try:
        check_interrupt()
        starts = declare(
            node,
            AUTOSTART,
            True,
            describe(
                "whether it is configured and activated at once; else it waits to be told so, "
                "as by a lifecycle manager",
                read_only=True,
            ),
        )
        if starts:
            before()
            node.start()
    except BaseException:
        node.destroy_node()
        raise
    return node
