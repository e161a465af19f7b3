# SPDX-License-Identifier: Apache-2.0
"""Spinning of a node: survives exceptions of callbacks, ends cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol, TypeVar

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bt_agents_core.errors import NodeMustEnd
from bt_agents_ros.node_main import READY, SUPERVISED
from bt_agents_ros.signals import Interrupt, Interrupted
from bt_agents_ros.workarounds.cached_executor import CachedExecutor

_POLL_S = 0.1
STOP_LIMIT_S = 1.0
"""Time that a node that is stopped has to end what it has under way [s]."""

_LAST_RESULTS_S = 0.05
_PR_SET_PDEATHSIG = 1


class Stopping(Protocol):
    """Node that needs its executor to spin on until what it has under way has ended."""

    def request_stop(self) -> None:
        """Start ending; called once."""

    def stopped(self) -> bool:
        """Return True when nothing is under way any more."""


NodeT = TypeVar("NodeT", bound=Node)


class Spinner:
    """Executor of one node; an exception in a callback is logged and survived."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.executor = CachedExecutor()
        self.executor.add_node(node)

    def spin_once(self, timeout_s: float = _POLL_S) -> None:
        """Wait up to ``timeout_s`` seconds for work and do one piece of it.

        Raises:
            NodeMustEnd: A callback has found that the node has to end.
        """
        try:
            self.executor.spin_once(timeout_sec=timeout_s)
        except (ExternalShutdownException, NodeMustEnd):
            raise
        except Exception:
            if not self.node.context.ok():
                raise ExternalShutdownException from None
            self.node.get_logger().error(
                "a callback failed and was skipped:\n" + traceback.format_exc()
            )

    def spin_until(self, done: Callable[[], bool], limit_s: float) -> bool:
        """Spin until ``done()`` is true or ``limit_s`` seconds have passed; return ``done()``."""
        end = time.monotonic() + limit_s
        while not done():
            left = end - time.monotonic()
            if left <= 0:
                return False
            self.spin_once(min(left, _POLL_S))
        return True

    def close(self) -> None:
        """Stop the executor and destroy the node, in the order that Fast DDS survives."""
        self.executor.shutdown(timeout_sec=0.5)
        self.node.destroy_node()


def run(make_node: Callable[[], NodeT], args: Sequence[str] | None = None) -> int:
    """Create a node and spin it until SIGINT, SIGTERM or a shutdown of its context.

    A node with the methods of :class:`Stopping` gets up to a second to end what it has under way.
    ``make_node`` is called after ``rclpy.init``; if it raises, the process ends with one line.

    Returns:
        Exit code: 0 after a clean stop, 1 when the node could not be created or had to end.
    """
    interrupt = Interrupt()
    _die_with_parent()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        try:
            with interrupt.raising():
                node = make_node()
        except Interrupted:
            return 0
        except Exception as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
        spinner = Spinner(node)
        code = 0
        try:
            _report_ready()
            try:
                while not interrupt and rclpy.ok():
                    spinner.spin_once()
            except NodeMustEnd as reason:
                print(f"error: {reason}", file=sys.stderr)
                code = 1
            if hasattr(node, "request_stop") and rclpy.ok():
                node.request_stop()
                spinner.spin_until(node.stopped, STOP_LIMIT_S)
                # The executor still has to send the results of what has just ended.
                spinner.spin_until(lambda: False, _LAST_RESULTS_S)
        except (ExternalShutdownException, NodeMustEnd):
            pass
        finally:
            spinner.close()
        return code
    finally:
        rclpy.try_shutdown()


def _report_ready() -> None:
    descriptor = os.environ.pop(READY, "")
    if descriptor.isdecimal():
        # The parent may have ended.
        with suppress(OSError), os.fdopen(int(descriptor), "wb") as parent:
            parent.write(b"up")


def _die_with_parent() -> None:
    parent = os.environ.get(SUPERVISED)
    if parent and sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != int(parent):
            # It died before the line above.
            os.kill(os.getpid(), signal.SIGTERM)
