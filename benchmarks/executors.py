# SPDX-License-Identifier: Apache-2.0
"""Measures our executor and rclpy's executors, all with the same bare nodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import Trigger

from bare import EVENTS
from bare_executor import KINDS, echo
from bt_agents_interfaces.action import Say
from bt_agents_tools.launcher.domain_lock import reserve_domain
from measuring import COLD, HOT, Effort, Row, in_turn, paused, timed
from processes import Running, graphs

_FLOOR = "single"
_CROWD = 50
_WORDS = String(data="x" * 100)
_LIMIT_S = 30.0
_IDLE_S = 2.0
Case = Callable[[], None]
"""Requests one thing and returns when it has arrived."""


class Asker:
    """A node that calls other nodes, and the executor that spins it.

    Args:
        kind: A key of :data:`KINDS`.
        context: Context of its nodes.
    """

    def __init__(self, kind: str, context: Context) -> None:
        self._context = context
        self._executor = KINDS[kind](context=context)
        self._nodes: list[Node] = []
        self.node = self.add("asker")
        self._told: list[String] = []
        self._asks = self.node.create_publisher(String, "asked", EVENTS)
        self.node.create_subscription(String, "told", self._told.append, EVENTS)
        self._client = self.node.create_client(Trigger, "ask", qos_profile=EVENTS)

    def add(self, name: str) -> Node:
        """Return a new node that is spun as well."""
        node = Node(name, context=self._context, enable_rosout=False)
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def until(self, condition: Callable[[], Any]) -> None:
        """Spin until a condition holds.

        Raises:
            RuntimeError: It takes too long.
        """
        end = time.monotonic() + _LIMIT_S
        while not condition():
            if time.monotonic() > end:
                raise RuntimeError(f"not within {_LIMIT_S:g} s")
            self._executor.spin_once(timeout_sec=0.1)

    def until_matched(self, answers: int = 1) -> None:
        """Wait until this many nodes answer."""
        self.until(lambda: self._asks.get_subscription_count() == answers)
        self.until(lambda: self.node.count_publishers("told") == answers)
        self.until(self._client.service_is_ready)

    def hop(self, answers: int = 1) -> None:
        """Publish a message and wait until this many messages have been published in return."""
        self._told.clear()
        self._asks.publish(_WORDS)
        self.until(lambda: len(self._told) == answers)

    def call(self) -> None:
        """Call the service."""
        future = self._client.call_async(Trigger.Request())
        self.until(future.done)
        assert future.result().success

    def close(self) -> None:
        """Remove all nodes from the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        for node in self._nodes:
            node.destroy_node()


class Acting:
    """An action server, and goals for it.

    Args:
        asker: Spins both.
    """

    def __init__(self, asker: Asker) -> None:
        self._asker = asker

        async def execute(handle: Any) -> Say.Result:
            handle.succeed()
            return Say.Result()

        ActionServer(asker.add("acting"), Say, "act", execute, result_timeout=1)
        self._client = ActionClient(asker.node, Say, "act")
        asker.until(self._client.server_is_ready)

    def act(self) -> None:
        """Send a goal and wait for its result."""
        accepted = self._client.send_goal_async(Say.Goal())
        self._asker.until(accepted.done)
        ended = accepted.result().get_result_async()
        self._asker.until(ended.done)
        assert ended.result().status == GoalStatus.STATUS_SUCCEEDED


def measure(effort: Effort) -> Iterator[Row]:
    """Yield the cost of each executor, as a ratio to rclpy's single-threaded executor."""
    with ExitStack() as stack:
        one, crowd = _in_one_process(stack, effort)
        yield from _rows("topic there and back, 1 process", effort, 300, one, Asker.hop)
        yield from _rows("service, 1 process", effort, 200, one, Asker.call)
        actings = {kind: Acting(asker) for kind, asker in one.items()}
        yield from _rows("action: goal to result, 1 process", effort, 15, actings, Acting.act)
        count = _crowd(effort)
        name = f"{count} nodes answer, 1 process"
        yield from _rows(name, effort, 4, crowd, lambda asker: asker.hop(count))
    with graphs() as make, ExitStack() as stack:
        two: dict[str, Asker] = {}
        processes: dict[str, Running] = {}
        for kind in KINDS:
            graph = make(kind)
            processes[kind] = graph.bare("bare_executor.py", kind)
            graph.until_up()
            two[kind] = Asker(kind, graph.context)
            stack.callback(two[kind].close)
            two[kind].until_matched()
        yield from _rows("topic there and back, 2 processes", effort, 200, two, Asker.hop)
        yield from _rows("service, 2 processes", effort, 200, two, Asker.call)
        yield from _idle(effort, processes)


def _in_one_process(stack: ExitStack, effort: Effort) -> tuple[dict[str, Asker], dict[str, Asker]]:
    """Return, by kind, an asker of one node and an asker of many nodes."""
    one: dict[str, Asker] = {}
    crowd: dict[str, Asker] = {}
    for kind in KINDS:
        for askers, count in ((one, 1), (crowd, _crowd(effort))):
            context = Context()
            rclpy.init(
                context=context,
                domain_id=reserve_domain(),
                signal_handler_options=SignalHandlerOptions.NO,
            )
            stack.callback(context.try_shutdown)
            askers[kind] = Asker(kind, context)
            stack.callback(askers[kind].close)
            for number in range(count):
                echo(askers[kind].add(f"there_{number}"))
            askers[kind].until_matched(count)
    return one, crowd


def _crowd(effort: Effort) -> int:
    return 5 if effort.is_short else _CROWD


def _rows(
    case: str, effort: Effort, number: int, sides: dict[str, Any], ask: Callable[[Any], None]
) -> Iterator[Row]:
    def call(kind: str) -> Callable[[], None]:
        return lambda: ask(sides[kind])

    for kind in sides:
        timed(call(kind), effort.times(number))()
    hot = {kind: timed(call(kind), effort.times(number)) for kind in sides}
    cold = {kind: paused(timed(call(kind), 1), effort.times(min(number, 8))) for kind in sides}
    for pace, ways in ((HOT, hot), (COLD, cold)):
        yield from _beside_floor(case, in_turn(ways, effort), pace=pace)


def _idle(effort: Effort, processes: dict[str, Running]) -> Iterator[Row]:
    """Yield the CPU use of processes that only publish ten heartbeats a second."""
    found: dict[str, list[float]] = {kind: [] for kind in processes}
    for _ in range(effort.repetitions):
        before = {kind: one.cpu_s for kind, one in processes.items()}
        began = time.monotonic()
        time.sleep(0.2 if effort.is_short else _IDLE_S)
        took = time.monotonic() - began
        for kind, one in processes.items():
            found[kind].append(100 * (one.cpu_s - before[kind]) / took)
    yield from _beside_floor("idle: 1 node, 10 heartbeats/s", found, unit="% of a core")


def _beside_floor(
    case: str, found: dict[str, list[float]], *, pace: str = "", unit: str = "s"
) -> Iterator[Row]:
    for kind in found:
        if kind != _FLOOR:
            goal = 1.0 if kind == "lean" else None
            yield Row.beside(found, kind, _FLOOR, case=case, unit=unit, goal=goal, pace=pace)
