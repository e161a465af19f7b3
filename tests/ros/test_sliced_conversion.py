# SPDX-License-Identifier: Apache-2.0
"""Conversion of large messages in slices: the same result as by rclpy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import pytest
import rclpy
from rclpy.serialization import deserialize_message, serialize_message

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import (
    AgentCard,
    FileProblem,
    HostCard,
    MoodRule,
    PersonFact,
    Run,
    Scene,
    SceneValue,
)
from bt_agents_ros import qos
from bt_agents_ros.workarounds.cached_executor import CachedExecutor
from bt_agents_ros.workarounds.sliced_conversion import SLICE_S, is_sliced, slices

LIMIT_TURNS = 5000


def clock(step_s: float) -> Callable[[], float]:
    """Return a clock that advances by a given time between two readings [s]."""
    looks = count()
    return lambda: next(looks) * step_s


def made(kind: Any, message: bytes, now: Callable[[], float]) -> tuple[Any, int]:
    """Return a message that is made in slices, and the number of pauses."""
    under_way = slices(kind, message, now)
    pauses = 0
    while True:
        try:
            next(under_way)
        except StopIteration as end:
            return end.value, pauses
        pauses += 1


def agent(number: int, rules: int = 2) -> AgentCard:
    card = AgentCard(
        name=f"agent{number}",
        tags=["a", "b"],
        profile=[1.0, 2.0],
        rules=[MoodRule(when="mood < 2")] * rules,
        problems=[FileProblem(file="a.yaml", line=3, message="no")],
    )
    card.learning.sources = ["anna"]
    return card


def host_card(agents: int, rules: int = 2) -> HostCard:
    return HostCard(
        host="/agents",
        parameters=["age", "mood"],
        agents=[agent(number, rules) for number in range(agents)],
        problems=[FileProblem(message="of the host")] * 3,
    )


@pytest.mark.parametrize(
    "message",
    [
        host_card(300),
        host_card(2, rules=300),
        HostCard(host="/agents"),
        Scene(remembered=[PersonFact(key=f"k{n}") for n in range(50)], values=[SceneValue()] * 3),
        Run(agent="leo", scene=Scene(values=[SceneValue(name=f"v{n}") for n in range(50)])),
    ],
    ids=["agents", "rules of an agent", "nothing", "scene", "scene in a run"],
)
@pytest.mark.parametrize("step_s", [0.0, SLICE_S], ids=["at once", "with pauses"])
def test_sliced_conversion_matches_rclpy(message: Any, step_s: float) -> None:
    kind, sent = type(message), bytes(serialize_message(message))

    found, pauses = made(kind, sent, clock(step_s))

    assert found == deserialize_message(sent, kind) == message
    assert (pauses > 0) is (step_s > 0)


def test_conversion_may_pause_after_each_list_entry() -> None:
    message = host_card(1, rules=300)
    _, pauses = made(HostCard, bytes(serialize_message(message)), clock(SLICE_S))

    assert pauses >= 300


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (
            HostCard(agents=[AgentCard()] * 10_001),
            "HostCard.agents has 10001 entries, expected at most 10000",
        ),
        (
            HostCard(agents=[AgentCard(tags=["a"] * 20_001)]),
            "AgentCard.tags has 20001 entries, expected at most 20000",
        ),
        (
            HostCard(agents=[AgentCard(problems=[FileProblem()] * 20_001)]),
            "AgentCard.problems has 20001 entries, expected at most 20000",
        ),
        (
            HostCard(agents=[AgentCard(), AgentCard(title="x" * 20_001)]),
            "AgentCard.title has 20001 characters, expected at most 20000",
        ),
    ],
    ids=["list", "list in an entry", "messages in an entry", "text in an entry"],
)
def test_oversized_message_is_refused_during_slicing(message: HostCard, reason: str) -> None:
    with pytest.raises(Refused) as found:
        made(HostCard, bytes(serialize_message(message)), clock(0.0))

    assert (found.value.code, found.value.reason) == ("TOO_LARGE", reason)


def test_malformed_bytes_are_refused() -> None:
    with pytest.raises(Refused, match="MALFORMED: 40004 bytes are not a HostCard"):
        made(HostCard, b"\0\1\0\0" + b"\xff" * 40_000, clock(0.0))


def test_only_large_messages_with_message_lists_are_sliced() -> None:
    assert is_sliced(HostCard, 100_000)
    assert is_sliced(Run, 100_000), "of a scene in it"
    assert not is_sliced(HostCard, 1_000)
    assert not is_sliced(MoodRule, 100_000)


@pytest.fixture
def node(ros: Any) -> Iterator[Any]:
    """A node that nothing spins."""
    made = rclpy.create_node("in_slices", start_parameter_services=False)
    yield made
    made.destroy_node()


@pytest.fixture
def executor(node: Any) -> Iterator[CachedExecutor]:
    """The executor of that node, which the test turns."""
    made = CachedExecutor()
    made.add_node(node)
    yield made
    made.shutdown()


def test_sliced_conversion_lets_timers_run_and_keeps_order(
    node: Any, executor: CachedExecutor
) -> None:
    heard: list[tuple[int, int]] = []
    beats: list[None] = []
    node.create_timer(0.001, lambda: beats.append(None))
    node.create_subscription(
        HostCard,
        "bt_agents/cards",
        lambda card: heard.append((len(card.agents), len(beats))),
        qos.EVENTS,
    )
    publisher = node.create_publisher(HostCard, "bt_agents/cards", qos.EVENTS)
    sizes = [4000, 1, 2000]
    turn_until(executor, lambda: publisher.get_subscription_count() and beats)
    began = len(beats)
    for size in sizes:
        publisher.publish(host_card(size, rules=0))
    turn_until(executor, lambda: len(heard) == len(sizes))

    assert [size for size, _ in heard] == sizes
    assert heard[0][1] >= began + 3


def test_subscription_destroyed_during_conversion_receives_nothing(
    node: Any, executor: CachedExecutor
) -> None:
    heard: list[HostCard] = []
    beats: list[None] = []
    subscription = node.create_subscription(HostCard, "bt_agents/cards", heard.append, qos.EVENTS)
    publisher = node.create_publisher(HostCard, "bt_agents/cards", qos.EVENTS)
    turn_until(executor, publisher.get_subscription_count)
    publisher.publish(host_card(4000, rules=0))
    turn_until(executor, lambda: executor._in_slices)
    node.destroy_subscription(subscription)
    node.create_timer(0.001, lambda: beats.append(None))
    turn_until(executor, lambda: not executor._in_slices and len(beats) > 3)

    assert not heard


def turn_until(executor: CachedExecutor, condition: Callable[[], Any]) -> None:
    """Do one piece of work after another until a condition holds."""
    for _ in range(LIMIT_TURNS):
        if condition():
            return
        executor.spin_once(timeout_sec=0.02)
    pytest.fail("it does not come")
