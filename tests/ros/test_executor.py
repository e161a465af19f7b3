# SPDX-License-Identifier: Apache-2.0
"""The executor behaves like rclpy's single-threaded one, which passes the same tests."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Thread, Timer
from typing import Any

import pytest
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMsg
from std_msgs.msg import Empty, String
from std_srvs.srv import Trigger

from bt_agents_ros import qos
from bt_agents_ros.signals import Interrupt
from bt_agents_ros.workarounds import cached_executor
from bt_agents_ros.workarounds.cached_executor import CachedExecutor
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup

LIMIT_S = 30.0
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class SpunNode:
    """A node and the executor that spins it.

    Attributes:
        errors: Exceptions of callbacks.
    """

    def __init__(self, kind: type) -> None:
        self.executor = kind()
        self.node = rclpy.create_node("spun", start_parameter_services=False)
        self.executor.add_node(self.node)
        self.errors: list[BaseException] = []

    def spin_once(self, timeout_s: float = 0.02) -> None:
        """Do one piece of work."""
        try:
            self.executor.spin_once(timeout_sec=timeout_s)
        except ExternalShutdownException:
            raise
        except Exception as error:
            self.errors.append(error)

    def until(self, condition: Callable[[], Any], timeout_s: float = 0.02) -> None:
        """Spin until a condition holds."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, "it does not happen"
            self.spin_once(timeout_s)

    def spin_times(self, count: int = 30) -> None:
        """Spin a few times, to check that something does not happen."""
        for _ in range(count):
            self.spin_once(0.005)

    def talk(self, heard: Callable[[Any], Any], **options: Any) -> Any:
        """Return a publisher whose messages reach a callback of this node."""
        publisher = self.node.create_publisher(String, "words", qos.FACTS)
        self.node.create_subscription(String, "words", heard, qos.FACTS, **options)
        self.until(publisher.get_subscription_count)
        return publisher

    def serve(self, answer: Callable[..., Any], name: str = "ask", **options: Any) -> Any:
        """Return a client of a service of this node."""
        self.node.create_service(Trigger, name, answer, **options)
        client = self.node.create_client(
            Trigger, name, callback_group=ReentrantCallbackGroup(), qos_profile=qos.SERVICE
        )
        self.until(client.service_is_ready)
        return client

    def timer(self, callback: Callable[[], Any], period_s: float = 0.01, **options: Any) -> Any:
        """Return a timer of this node."""
        return self.node.create_timer(period_s, callback, clock=STEADY, **options)


@pytest.fixture(params=[CachedExecutor, SingleThreadedExecutor])
def spun(request: pytest.FixtureRequest) -> Iterator[SpunNode]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        spun = SpunNode(request.param)
        try:
            yield spun
        finally:
            spun.executor.shutdown()
            spun.node.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_raising_callback_loses_no_messages(spun: SpunNode) -> None:
    heard = []

    def hear(message: String) -> None:
        heard.append(message.data)
        if message.data == "2":
            raise RuntimeError("no")

    publisher = spun.talk(hear)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    spun.until(lambda: len(heard) == 5)
    publisher.publish(String(data="5"))
    spun.until(lambda: len(heard) == 6)
    assert heard == ["0", "1", "2", "3", "4", "5"]
    assert [str(error) for error in spun.errors] == ["no"]


def test_message_burst_keeps_order_without_delaying_others(spun: SpunNode) -> None:
    heard: list[str] = []
    ticks: list[int] = []

    def hear(message: String) -> None:
        heard.append(message.data)
        if len(heard) == 50:
            timer.reset()

    timer = spun.timer(
        lambda: (timer.cancel(), ticks.append(len(heard))), 0.000001, autostart=False
    )
    publisher = spun.talk(hear)
    for number in range(200):
        publisher.publish(String(data=str(number)))
    spun.until(lambda: len(heard) == 200 and ticks)
    assert heard == [str(number) for number in range(200)]
    assert ticks[0] < 100


def test_slow_message_callbacks_do_not_starve_others(spun: SpunNode) -> None:
    heard: list[str] = []
    ticks: list[int] = []

    def hear(message: String) -> None:
        time.sleep(0.003)
        heard.append(message.data)

    publisher = spun.talk(hear)
    spun.timer(lambda: ticks.append(len(heard)), 0.001)
    for number in range(10):
        publisher.publish(String(data=str(number)))
    spun.until(lambda: len(heard) == 10)
    spun.until(lambda: ticks[-1] == 10)
    assert set(range(1, 11)) <= set(ticks)


@pytest.mark.parametrize("spun", [CachedExecutor], indirect=True)
def test_timer_runs_between_slow_topics(spun: SpunNode) -> None:
    heard: list[int] = []
    ticks: list[int] = []

    def hear(_message: String) -> None:
        time.sleep(0.06)
        heard.append(1)

    topics = [f"words{number}" for number in range(8)]
    publishers = [spun.node.create_publisher(String, topic, qos.FACTS) for topic in topics]
    for topic in topics:
        spun.node.create_subscription(String, topic, hear, qos.FACTS)
    spun.until(lambda: all(one.get_subscription_count() for one in publishers))
    spun.timer(lambda: ticks.append(len(heard)), 0.05)
    for publisher in publishers:
        publisher.publish(String())
    time.sleep(0.2)  # all of them exist before the next wait
    spun.until(lambda: len(heard) == len(topics))
    spun.until(lambda: ticks[-1] == len(topics))
    assert set(range(2, len(topics))) <= set(ticks)


def test_timers_and_services_keep_running_after_exceptions(spun: SpunNode) -> None:
    asked = []

    def answer(_request: Any, response: Any) -> Any:
        asked.append(1)
        if len(asked) == 1:
            raise RuntimeError("service")
        return response

    ticks = []

    def tick() -> None:
        ticks.append(1)
        raise RuntimeError("timer")

    client = spun.serve(answer)
    first, second = client.call_async(Trigger.Request()), client.call_async(Trigger.Request())
    spun.until(second.done)
    assert not first.done()
    spun.timer(tick)
    spun.until(lambda: len(ticks) == 3)
    assert {str(error) for error in spun.errors} == {"service", "timer"}


def test_timer_stopped_by_earlier_callback_is_not_called(spun: SpunNode) -> None:
    called = []
    timers: list[Any] = []

    def call(own: int) -> None:
        called.append(own)
        for timer in timers:
            timer.cancel()

    timers += [spun.timer(lambda: call(0)), spun.timer(lambda: call(1))]
    time.sleep(0.02)  # both are due when the first is checked
    spun.spin_times()
    assert len(called) == 1
    timers[1 - called[0]].reset()
    spun.until(lambda: len(called) == 2)
    assert sorted(called) == [0, 1]


def test_timer_reset_in_its_callback_fires_again(spun: SpunNode) -> None:
    called: list[int] = []
    timer = spun.timer(lambda: (timer.cancel(), called.append(1)), autostart=False)
    spun.spin_times(5)
    assert called == []
    for number in range(1, 4):
        timer.reset()
        spun.until(lambda number=number: len(called) == number)
    spun.spin_times()
    assert len(called) == 3


def test_entity_destroyed_by_callback_is_not_called(spun: SpunNode) -> None:
    called = []
    timers: list[Any] = []

    def call(own: int) -> None:
        called.append(own)
        spun.node.destroy_timer(timers[1 - own])

    timers += [spun.timer(lambda: call(0)), spun.timer(lambda: call(1))]
    time.sleep(0.02)
    spun.until(lambda: len(called) > 3)
    assert len(set(called)) == 1
    assert spun.errors == []


@pytest.mark.parametrize("spun", [CachedExecutor], indirect=True)  # rclpy's raises for ever
def test_entity_destroyed_without_notice_is_not_called(spun: SpunNode) -> None:
    heard: list[Any] = []
    told: list[Any] = []
    publisher = spun.talk(heard.append)
    spun.talk(told.append)
    publisher.publish(String())
    spun.until(lambda: heard and told)
    next(iter(spun.node.subscriptions)).destroy()
    publisher.publish(String())
    spun.until(lambda: len(heard) + len(told) == 3)
    ticks: list[int] = []
    spun.timer(lambda: ticks.append(1))
    spun.until(lambda: len(ticks) == 3)
    assert len(heard) + len(told) == 3
    assert spun.errors == []


def test_entity_created_by_callback_is_served(spun: SpunNode) -> None:
    heard: list[Any] = []
    parts: list[Any] = []

    def make(_message: Any) -> None:
        parts.append(spun.node.create_subscription(Empty, "made", heard.append, qos.FACTS))
        parts.append(spun.node.create_publisher(Empty, "made", qos.FACTS))

    spun.talk(make).publish(String())
    spun.until(lambda: parts)
    spun.until(parts[1].get_subscription_count)
    parts[1].publish(Empty())
    spun.until(lambda: heard)
    spun.node.destroy_subscription(parts[0])
    spun.until(lambda: not parts[1].get_subscription_count())
    parts[1].publish(Empty())
    spun.spin_times()
    assert len(heard) == 1
    assert spun.errors == []


@pytest.mark.parametrize("group", [MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup])
def test_exclusive_group_is_busy_while_its_callback_awaits(
    spun: SpunNode, group: Callable[[], Any]
) -> None:
    awaited = Future()
    asked: list[int] = []
    shared = group()

    async def answer(_request: Any, response: Any) -> Any:
        asked.append(1)
        await awaited
        return response

    heard: list[Any] = []
    publisher = spun.talk(heard.append, callback_group=shared)
    client = spun.serve(answer, callback_group=shared)
    futures = [client.call_async(Trigger.Request()) for _ in range(3)]
    spun.until(lambda: asked)
    publisher.publish(String())
    spun.spin_times(60)
    busy = group is MutuallyExclusiveCallbackGroup
    assert (len(asked), len(heard)) == ((1, 0) if busy else (3, 1))
    awaited.set_result(None)
    spun.until(lambda: all(future.done() for future in futures) and heard)


def test_busy_group_does_not_lose_guard_condition(spun: SpunNode) -> None:
    awaited = Future()
    asked: list[int] = []
    called: list[int] = []
    shared = MutuallyExclusiveCallbackGroup()
    guard = spun.node.create_guard_condition(lambda: called.append(1), callback_group=shared)

    async def answer(_request: Any, response: Any) -> Any:
        asked.append(1)
        guard.trigger()
        await awaited
        return response

    client = spun.serve(answer, callback_group=shared)
    future = client.call_async(Trigger.Request())
    spun.until(lambda: asked)
    spun.spin_times()
    assert called == []
    awaited.set_result(None)
    spun.until(lambda: called and future.done())
    assert called == [1]


def test_raising_task_is_reported_and_ends(spun: SpunNode) -> None:
    awaited = Future()

    async def fail() -> None:
        await awaited
        raise RuntimeError("after a wait")

    def fail_at_once() -> None:
        raise RuntimeError("at once")

    tasks = [spun.executor.create_task(fail), spun.executor.create_task(fail_at_once)]
    spun.until(lambda: spun.errors)
    awaited.set_result(None)
    spun.until(lambda: all(task.done() for task in tasks))
    assert sorted(str(error) for error in spun.errors) == ["after a wait", "at once"]
    assert sorted(str(task.exception()) for task in tasks) == ["after a wait", "at once"]


def test_cancelled_task_stops(spun: SpunNode) -> None:
    awaited = Future()
    seen: list[str] = []

    async def work() -> None:
        try:
            await awaited
            seen.append("went on")
        finally:
            seen.append("closed")

    task = spun.executor.create_task(work)
    spun.spin_times(4)
    task.cancel()
    awaited.set_result(None)
    spun.spin_times()
    assert seen == ["closed"]
    assert task.cancelled()
    assert spun.errors == []


def test_task_from_another_thread_ends_wait(spun: SpunNode) -> None:
    called: list[int] = []
    spun.spin_times(3)
    thread = Thread(target=lambda: spun.executor.create_task(called.append, 1))

    def start() -> None:
        timer.cancel()
        thread.start()

    timer = spun.timer(start)
    spun.until(lambda: called, timeout_s=2 * LIMIT_S)
    thread.join()


def test_simulated_time_timers_stop_with_their_clock(spun: SpunNode) -> None:
    spun.node.set_parameters([Parameter("use_sim_time", value=True)])
    told = spun.node.create_publisher(ClockMsg, "/clock", qos.FACT)
    spun.until(told.get_subscription_count)
    simulated: list[int] = []
    steady: list[int] = []
    clock = spun.node.get_clock()
    spun.node.create_timer(1.0, lambda: simulated.append(1), clock=clock)
    spun.timer(lambda: steady.append(1))
    for second in (100, 101, 102):
        told.publish(ClockMsg(clock=rclpy.time.Time(seconds=second).to_msg()))
        spun.until(lambda second=second: clock.now().nanoseconds == second * 10**9)
        ticks = len(steady)
        spun.until(lambda ticks=ticks: len(steady) > ticks + 3)
    spun.until(lambda: len(simulated) >= 2)
    before = len(simulated)
    spun.spin_times(60)
    assert len(simulated) == before
    assert spun.errors == []


def test_middleware_events_arrive_under_constant_load(spun: SpunNode) -> None:
    matched: list[int] = []
    publisher = spun.talk(lambda message: publisher.publish(message))
    publisher.publish(String())
    spun.node.create_publisher(
        Empty,
        "other",
        qos.FACTS,
        event_callbacks=PublisherEventCallbacks(matched=lambda _: matched.append(1)),
    )
    spun.node.create_subscription(Empty, "other", lambda _: None, qos.FACTS)
    spun.until(lambda: matched)


def test_removed_node_is_not_spun(spun: SpunNode) -> None:
    ticks: list[int] = []
    other = rclpy.create_node("other", start_parameter_services=False)
    spun.executor.add_node(other)
    other.create_timer(0.005, lambda: ticks.append(1), clock=STEADY)
    spun.until(lambda: len(ticks) == 3)
    spun.executor.remove_node(other)
    spun.spin_times()
    assert len(ticks) == 3
    other.destroy_node()
    spun.spin_times(3)
    assert spun.executor.get_nodes() == [spun.node]
    assert spun.errors == []


def test_context_shutdown_ends_wait(spun: SpunNode) -> None:
    thread = Thread(target=rclpy.shutdown)

    def start() -> None:
        timer.cancel()
        thread.start()

    timer = spun.timer(start)
    began = time.monotonic()
    with suppress(ExternalShutdownException):
        spun.until(lambda: not rclpy.ok(), timeout_s=2 * LIMIT_S)
    assert time.monotonic() - began < LIMIT_S
    thread.join()


@pytest.mark.parametrize("spun", [CachedExecutor], indirect=True)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_wait_immediately(spun: SpunNode, number: signal.Signals) -> None:
    interrupt = Interrupt()
    soon = Timer(0.2, os.kill, (os.getpid(), number))
    began = time.monotonic()
    try:
        with interrupt.waking(spun.executor.wake):
            soon.start()
            spun.until(lambda: bool(interrupt), timeout_s=2 * LIMIT_S)
    finally:
        soon.join()
        interrupt.release()
    assert time.monotonic() - began < LIMIT_S


@pytest.mark.parametrize("spun", [CachedExecutor], indirect=True)
def test_polled_group_messages_do_not_wake_executor(spun: SpunNode) -> None:
    heard: list[str] = []
    publisher = spun.talk(lambda m: heard.append(m.data), callback_group=PolledGroup())
    spun.spin_once(1.0)
    waits = 0
    for number in range(50):
        publisher.publish(String(data=str(number)))
        time.sleep(0.002)
    while len(heard) < 50:
        waits += not spun.executor._batch
        spun.spin_once(1.0)
        assert waits < 20
    assert heard == [str(number) for number in range(50)]


@pytest.mark.parametrize("spun", [CachedExecutor], indirect=True)
def test_polled_group_empties_its_queue_at_once(
    spun: SpunNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine takes longer than the product allows, and leaves the rest to the next poll.
    monkeypatch.setattr(cached_executor, "_POLLED_S", LIMIT_S)
    heard: list[str] = []
    publisher = spun.talk(lambda m: heard.append(m.data), callback_group=PolledGroup())
    for number in range(200):
        publisher.publish(String(data=str(number)))
    assert publisher.wait_for_all_acked(Duration(seconds=30))
    spun.spin_once(1.0)
    while spun.executor._batch:
        spun.spin_once(0.0)
    assert len(heard) == 200


@pytest.mark.parametrize("spun", [CachedExecutor], indirect=True)
def test_polled_messages_arrive_before_due_timer(spun: SpunNode) -> None:
    order: list[str] = []
    publisher = spun.talk(lambda _: order.append("heard"), callback_group=PolledGroup())
    publisher.publish(String())
    spun.node.create_timer(0.2, lambda: order.append("looked"), clock=STEADY)
    time.sleep(0.4)
    spun.until(lambda: "looked" in order)
    assert order == ["heard", "looked"]
