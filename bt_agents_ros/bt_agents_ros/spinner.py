# SPDX-License-Identifier: Apache-2.0
"""Spinning of a node that survives exceptions and ends cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import Any, Protocol, runtime_checkable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bt_agents_core.errors import BtAgentsError, NodeMustEnd
from bt_agents_core.liveness import LONGEST_PAUSE_S, StallDetector
from bt_agents_ros.local_bus import LocalBus
from bt_agents_ros.node_main import READY, READY_BYTES, RESTARTED, SUPERVISED
from bt_agents_ros.parameters import report_unknown
from bt_agents_ros.signals import Interrupt, Interrupted
from bt_agents_ros.workarounds.bounded_end import ending_in_time, limit_end
from bt_agents_ros.workarounds.cached_executor import CachedExecutor
from bt_agents_ros.workarounds.skipped_generator import import_type_support

# The first message would import the generator, too.
import_type_support()

_POLL_S = 0.2
_CHECK_S = 1.0
STOP_LIMIT_S = 1.0
"""Time for a stopped node to end its ongoing work [s].

A node that waits for others, which may be ending with it, sets its own ``stop_limit_s``.
"""

LAST_RESULTS_S = 0.05
"""Time for the executor to send the results of ended work [s]."""

_PR_SET_PDEATHSIG = 1


@runtime_checkable
class Stopping(Protocol):
    """Node whose executor must keep spinning until its ongoing work has ended."""

    def request_stop(self) -> None:
        """Start to end; called once."""

    def stopped(self) -> bool:
        """Return True when all work has ended."""


class Spinner:
    """Executor of nodes that logs and survives exceptions in callbacks.

    Args:
        nodes: One node, or the nodes of a process that a bus connects.
        bus: Their bus.
    """

    def __init__(self, *nodes: Any, bus: LocalBus | None = None) -> None:
        self.nodes = nodes
        self.executor = CachedExecutor(bus=bus)
        for node in nodes:
            self.executor.add_node(node)

    def spin_once(self, timeout_s: float = _POLL_S) -> None:
        """Wait up to ``timeout_s`` seconds for work and do one piece of it.

        Raises:
            NodeMustEnd: A callback found that the node must end.
        """
        try:
            self.executor.spin_once(timeout_sec=timeout_s)
        except (ExternalShutdownException, NodeMustEnd):
            raise
        except Exception:
            if not self.nodes[0].context.ok():
                raise ExternalShutdownException from None
            alone = len(self.nodes) == 1
            logger = self.nodes[0].get_logger() if alone else get_logger("bt_agents")
            logger.error("a callback failed and was skipped:\n" + traceback.format_exc())

    def spin_until(
        self, done: Callable[[], bool], limit_s: float, *, poll_s: float = _POLL_S
    ) -> bool:
        """Spin until ``done()`` is true or ``limit_s`` seconds have passed; return ``done()``.

        It checks ``done()`` after each piece of work and every ``poll_s`` seconds.
        """
        end = time.monotonic() + limit_s
        while not done():
            left = end - time.monotonic()
            if left <= 0:
                return False
            self.spin_once(min(left, poll_s))
        return True

    def close(self) -> None:
        """Stop the executor and destroy the nodes, in the order that Fast DDS survives."""
        with ending_in_time():
            self.executor.shutdown(timeout_sec=0.5)
            for node in self.nodes:
                node.destroy_node()


@contextmanager
def starting_ros(args: Sequence[str] | None) -> Iterator[None]:
    """Initialize ROS for a block that creates a node; None stands for the command line.

    Raises:
        BtAgentsError: ROS refuses, for example an argument, a parameter file or a key.
    """
    try:
        rclpy.init(args=args and [*args], signal_handler_options=SignalHandlerOptions.NO)
        yield
    except RuntimeError as error:
        raise BtAgentsError(f"ROS cannot start: {error}") from None


def run(make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Create a node and spin it until SIGINT, SIGTERM or a shutdown of its context.

    A node with the methods of :class:`Stopping` gets some time to end its ongoing work.
    ``make_node`` is called after ``rclpy.init``; if it raises, the process ends with one line.

    Returns:
        Exit code: 0 after a clean stop, 1 when the node could not be created, and that of
        :class:`NodeMustEnd` when it had to end.
    """
    return run_together((make_node,), args, bus=nullcontext)


def run_together(
    makers: Sequence[Callable[[], Node]],
    args: Sequence[str] | None,
    *,
    bus: Callable[[], AbstractContextManager[LocalBus | None]],
) -> int:
    """Run several nodes on one executor, like :func:`run` for one node.

    Args:
        makers: Called one after the other. Their nodes stop in the same order, each after the
            previous one has ended its work.
        args: Command line arguments.
        bus: Gives the bus for the nodes that are made within its block, or None.
    """
    interrupt = Interrupt()
    die_with_parent()
    try:
        with starting_ros(args):
            pass
    except BtAgentsError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    nodes: list[Any] = []
    try:
        with bus() as connecting:
            try:
                with interrupt.ending_at_second():
                    for make_node in makers:
                        nodes.append(make_node())
                    unknown = {
                        # An inactive node has not yet declared most of its parameters.
                        node.get_fully_qualified_name(): report_unknown(node, *nodes)
                        if getattr(node, "is_active", True)
                        else None
                        for node in nodes
                    }
            except BaseException as error:
                code = 0 if isinstance(error, Interrupted) else 1
                if isinstance(error, Exception):
                    print(f"error: {error}", file=sys.stderr)
                limit_end(code)
                for node in nodes:
                    node.destroy_node()
                if not isinstance(error, Exception | Interrupted):
                    raise
                return code
            spinner = Spinner(*nodes, bus=connecting)
            code = 1
            try:
                report_ready(unknown)
                code = _spin(spinner, interrupt)
            finally:
                limit_end(code)
                spinner.close()
            return code
    finally:
        rclpy.try_shutdown()


def _spin(spinner: Spinner, interrupt: Interrupt) -> int:
    """Spin until the end, then let nodes end their ongoing work; return the exit code."""
    code = 0
    with suppress(ExternalShutdownException, NodeMustEnd):
        try:
            with interrupt.waking(spinner.executor.wake):
                restarted = RESTARTED in os.environ
                pauses = StallDetector(time.monotonic(), limit_s=LONGEST_PAUSE_S)
                while not interrupt and rclpy.ok():
                    spinner.spin_once(_CHECK_S)
                    if restarted and pauses.poll(time.monotonic()):
                        raise NodeMustEnd(
                            f"this process was paused for {pauses.last_stall_s:.0f} s, and others "
                            "may have dropped it, so it starts again"
                        )
        except NodeMustEnd as reason:
            print(f"error: {reason}", file=sys.stderr)
            code = reason.exit_code
        stopping = [node for node in spinner.nodes if isinstance(node, Stopping)]
        for node in stopping:
            if rclpy.ok():
                node.request_stop()
                limit_s = float(getattr(node, "stop_limit_s", STOP_LIMIT_S))
                spinner.spin_until(node.stopped, limit_s)
        if stopping and rclpy.ok():
            spinner.spin_until(lambda: False, LAST_RESULTS_S)
    return code


def report_ready(unknown: Mapping[str, Mapping[str, str] | None] | None = None) -> None:
    """Report to the supervisor, if any, that this process is up.

    Args:
        unknown: Full name of a node → result of :func:`report_unknown`, None while it is inactive.
            If they are too long together, the report has None for each.
    """
    descriptor = os.environ.pop(READY, "")
    if descriptor.isdecimal():
        unknown = unknown or {}
        report = json.dumps(unknown).encode()
        if len(report) > READY_BYTES:
            report = json.dumps(dict.fromkeys(unknown)).encode()
        # The parent may have ended.
        with suppress(OSError), os.fdopen(int(descriptor), "wb") as parent:
            parent.write(report)


def die_with_parent() -> None:
    """Let this process end with its supervisor, if any."""
    parent = os.environ.get(SUPERVISED)
    if parent and sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != int(parent):
            # The supervisor died before the line above.
            os.kill(os.getpid(), signal.SIGTERM)
