# SPDX-License-Identifier: Apache-2.0
"""Cases of nodes that share a process and its bus; each case runs in a process of its own.

The middleware decides only once per process whether its endpoints ignore each other.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from action_msgs.msg import GoalStatusArray
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Int64, String

from bt_agents_interfaces.action import Say
from bt_agents_interfaces.msg import Scene, SceneValue
from bt_agents_interfaces.srv import CancelRun
from bt_agents_ros import one_process, qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.local_bus import LocalBus
from bt_agents_ros.spinner import Spinner

LIMIT_S = 20.0
OUTSIDE = "outside_topic"
"""Topic on which the test, in another process, receives a latched text and answers ``go``."""


class Nodes:
    """Two nodes on a bus, and their executor."""

    def __init__(self, bus: LocalBus | None) -> None:
        assert bus is not None, "the middleware does not ignore endpoints of its own process"
        self.bus = bus
        self.first, self.second = BaseNode("first"), BaseNode("second")
        self.spinner = Spinner(self.first, self.second, bus=bus)

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Spin until a condition holds."""
        assert self.spinner.spin_until(lambda: bool(condition()), LIMIT_S), what


@contextmanager
def nodes() -> Iterator[Nodes]:
    """Make a context with a bus and two nodes."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        with one_process.bus() as bus:
            made = Nodes(bus)
            try:
                yield made
            finally:
                made.spinner.close()
    finally:
        rclpy.try_shutdown()


def messages_are_copies_and_facts_are_latched() -> None:
    with nodes() as of:
        heard: list[Scene] = []
        publisher = of.first.create_publisher(Scene, "bt_agents/scene", qos.FACT)

        def change(message: Scene) -> None:
            message.values[0].value = 9.0

        of.second.create_subscription(Scene, "bt_agents/scene", change, qos.FACT)
        of.first.create_subscription(Scene, "bt_agents/scene", heard.append, qos.FACT)
        sent = Scene(scene_id="a", values=[SceneValue(name="age", value=1.0)])
        publisher.publish(sent)
        sent.scene_id = "changed"
        assert not heard, "it was called from within publish()"
        of.until(lambda: heard, "the scene is heard")
        late: list[Scene] = []
        of.second.create_subscription(Scene, "bt_agents/scene", late.append, qos.FACT)
        of.until(lambda: late, "a late reader is told")
        for message in (heard[0], late[0]):
            assert (message.scene_id, message.values[0].value) == ("a", 1.0)
        assert publisher.get_subscription_count() == 3
        of.spinner.spin_until(lambda: False, 0.2)
        assert len(heard) == len(late) == 1, "it came twice"


def times_and_bytes_are_handed_over() -> None:
    with nodes() as of:
        found: list[Any] = []
        of.second.create_subscription(String, "t", lambda m, i: found.append(i), qos.EVENTS)
        raw: list[bytes] = []
        of.second.create_subscription(String, "t", raw.append, qos.EVENTS, raw=True)

        def answer(request: Any, response: Any) -> Any:
            response.message = request.reason
            return response

        of.second.create_service(CancelRun, "s", answer, qos_profile=qos.SERVICE)
        client = of.first.create_client(CancelRun, "s", qos_profile=qos.SERVICE)
        before = time.time_ns()
        publisher = of.first.create_publisher(String, "t", qos.EVENTS)
        publisher.publish(String(data="x"))
        assert client.service_is_ready()
        future = client.call_async(CancelRun.Request(reason="why"))
        of.until(lambda: future.done() and found and raw, "all is handed over")
        assert before <= found[0]["source_timestamp"] <= found[0]["received_timestamp"]
        assert future.result().message == "why"
        publisher.publish(raw[0])
        of.until(lambda: len(raw) == 2, "bytes are handed over")
        assert raw[1] == raw[0]


def actions_are_handed_over() -> None:
    with nodes() as of:
        ends: list[Any] = []

        async def say(handle: Any) -> Say.Result:
            handle.publish_feedback(Say.Feedback(progress=0.5))
            done = rclpy.Future(executor=of.spinner.executor)
            ends.append(done)
            await done
            handle.canceled() if handle.is_cancel_requested else handle.succeed()
            return Say.Result(message=handle.request.text)

        def cancel(_handle: Any) -> CancelResponse:
            # The goal changes its state only after this callback.
            of.first.create_timer(0.02, lambda: ends[-1].done() or ends[-1].set_result(None))
            return CancelResponse.ACCEPT

        server = ActionServer(of.first, Say, "say", say, cancel_callback=cancel)
        client = ActionClient(of.second, Say, "say")
        states: list[GoalStatusArray] = []
        of.second.create_subscription(
            GoalStatusArray, "say/_action/status", states.append, qos.FACT
        )
        assert client.server_is_ready()
        progress: list[float] = []
        results = []
        for text in ("kept", "cancelled"):
            sent = client.send_goal_async(
                Say.Goal(text=text),
                feedback_callback=lambda m: progress.append(m.feedback.progress),
            )
            of.until(lambda sent=sent: sent.done(), "the goal is accepted")
            handle = sent.result()
            assert handle.accepted
            result = handle.get_result_async()
            of.until(lambda text=text: len(progress) > (text == "cancelled"), "it says how far")
            if text == "kept":
                ends[-1].set_result(None)
            else:
                handle.cancel_goal_async()
            of.until(lambda result=result: result.done(), "it has ended")
            results.append((result.result().result.message, result.result().status))
            of.until(lambda h=handle, r=result: h.status == r.result().status, "its status")
        assert results == [("kept", 4), ("cancelled", 5)]
        assert progress == [0.5, 0.5]
        of.until(lambda: [s.status for s in states[-1].status_list] == [4, 5], "both states")
        server.destroy()
        assert not client.server_is_ready()
        client.destroy()


def nobody_starves() -> None:
    with nodes() as of:
        counts = {"ping": 0, "ticks": 0, "outside": 0}
        ping = of.first.create_publisher(Int64, "ping", qos.EVENTS)
        pong = of.second.create_publisher(Int64, "pong", qos.EVENTS)

        def on_ping(message: Int64) -> None:
            counts["ping"] += 1
            pong.publish(message)

        of.second.create_subscription(Int64, "ping", on_ping, qos.EVENTS)
        of.first.create_subscription(Int64, "pong", lambda m: ping.publish(m), qos.EVENTS)
        of.first.create_timer(0.02, lambda: counts.update(ticks=counts["ticks"] + 1))
        told = of.first.create_publisher(String, OUTSIDE, qos.FACT)
        of.second.create_subscription(
            String, f"{OUTSIDE}/go", lambda _: counts.update(outside=1), qos.EVENTS
        )
        told.publish(String(data="ready"))
        ping.publish(Int64())
        of.until(lambda: counts["outside"], "the other process is heard")
        of.until(lambda: counts["ticks"] > 10, "timers fire")
        assert counts["ping"] > 100


def a_callback_that_raises_is_survived_and_nothing_is_lost() -> None:
    with nodes() as of:
        numbers: list[int] = []

        def take(message: Int64) -> None:
            numbers.append(message.data)
            if message.data == 1:
                raise ValueError("one")

        publisher = of.first.create_publisher(Int64, "t", qos.EVENTS)
        of.second.create_subscription(Int64, "t", take, qos.EVENTS)
        for number in range(3):
            publisher.publish(Int64(data=number))
        of.until(lambda: len(numbers) == 3, "all are handed over")


def where_the_middleware_matches_endpoints_there_is_no_bus() -> None:
    os.environ["RMW_FASTRTPS_USE_QOS_FROM_XML"] = "0"
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    # The first node creates the participant, here without the property.
    early = rclpy.create_node("early")
    with one_process.bus() as bus:
        assert bus is None
        node = BaseNode("node")
        heard: list[String] = []
        node.create_subscription(String, "t", heard.append, qos.FACT)
        node.create_publisher(String, "t", qos.FACT).publish(String(data="x"))
        spinner = Spinner(node, bus=bus)
        assert spinner.spin_until(lambda: bool(heard), LIMIT_S)
        spinner.close()
    early.destroy_node()
    rclpy.try_shutdown()
