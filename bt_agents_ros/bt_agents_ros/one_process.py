# SPDX-License-Identifier: Apache-2.0
"""Nodes of a system in one process, connected by a bus.

``python -m bt_agents_ros.node_main bt_agents_ros.one_process MODULE … --ros-args …``: each module
has a ``make_node``. The nodes are made and stopped in the given order, one after the other.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import takewhile
from pathlib import Path

import rclpy
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.utilities import get_default_context

from bt_agents_core.gc_pause import gc_paused
from bt_agents_ros import qos
from bt_agents_ros.fastdds_profile import PROFILE, FastDdsProfile
from bt_agents_ros.local_bus import LocalBus
from bt_agents_ros.spinner import run_together
from bt_agents_ros.workarounds.bounded_end import ending_in_time
from bt_agents_ros.workarounds.local_endpoints import handing_over

_IGNORED = "fastdds.ignore_local_endpoints"
_ROS_ARGUMENTS = "--ros-args"


def main(args: Sequence[str] | None = None) -> int:
    """Run the nodes of the modules on the command line; return the exit code."""
    words = list(sys.argv if args is None else args)
    names = list(takewhile(lambda word: word != _ROS_ARGUMENTS, words[1:]))
    if not names:
        print(
            "error: no module is named, expected the modules of the nodes to run", file=sys.stderr
        )
        return 1
    with gc_paused():
        modules = [importlib.import_module(name) for name in names]
    gc.freeze()
    return run_together([module.make_node for module in modules], args, bus=bus)


@contextmanager
def bus() -> Iterator[LocalBus | None]:
    """Give the bus for nodes that are made within this block, after ``rclpy.init``.

    It is None, after a line that says why, if the middleware always delivers messages to endpoints
    of the same process: each would arrive twice.
    """
    with endpoints_ignored(os.environ.get(PROFILE, "")) as file, _variable(PROFILE, str(file)):
        # The first node makes the participant, for which Fast DDS reads the file. The participant
        # ends with the last node, so this node stays.
        anchor = rclpy.create_node("_bus", start_parameter_services=False, enable_rosout=False)
    try:
        if not _ignores_own_endpoints(anchor):
            anchor.get_logger().warning(
                "NO_BUS: the middleware does not ignore endpoints of its own process, so nodes of "
                "this one hear each other over it, which takes longer; Fast DDS with the property "
                f"{_IGNORED} does"
            )
            yield None
        else:
            made = LocalBus(time.time_ns)
            with handing_over(get_default_context(), made):
                yield made
    finally:
        with ending_in_time():
            anchor.destroy_node()


def _ignores_own_endpoints(node: Node) -> bool:
    """Return whether endpoints of the process of a node do not match each other."""
    topic = f"_bus_{os.getpid()}"
    publisher = node.create_publisher(Time, topic, qos.EVENTS)
    subscription = node.create_subscription(Time, topic, lambda _: None, qos.EVENTS)
    is_matched = publisher.get_subscription_count() > 0
    node.destroy_publisher(publisher)
    node.destroy_subscription(subscription)
    return not is_matched


@contextmanager
def endpoints_ignored(profile: str) -> Iterator[Path]:
    """Give a copy of a Fast DDS profile whose participants ignore their own endpoints.

    Args:
        profile: File of the original; empty for the defaults of Fast DDS.

    Raises:
        BtAgentsError: As for :class:`FastDdsProfile`.
    """
    made = FastDdsProfile(profile)
    made.set_property(_IGNORED, "true")
    with tempfile.NamedTemporaryFile(
        "w", suffix=".xml", prefix="bt-agents-", encoding="utf-8", delete=False
    ) as file:
        file.write(made.text())
    try:
        yield Path(file.name)
    finally:
        with suppress(OSError):
            os.unlink(file.name)


@contextmanager
def _variable(name: str, value: str) -> Iterator[None]:
    """Set an environment variable within this block."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
