# SPDX-License-Identifier: Apache-2.0
"""Messages between nodes of one process: queued, bounded, and copied for each receiver."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import pytest

from bt_agents_ros.local_bus import Channel, LocalBus, LocalQueue, LocalReader

EVENTS = Channel(kind=list, depth=3, is_reliable=True, is_latched=False)
FACT = replace(EVENTS, depth=1, is_latched=True)


@pytest.fixture
def bus() -> LocalBus:
    return LocalBus(lambda: 7)


def reader(bus: LocalBus, channel: Channel = EVENTS, topic: str = "t") -> LocalReader:
    return bus.add_reader(topic, channel, LocalQueue(bus, object(), channel.depth))


def taken(queue: LocalQueue) -> list[Any]:
    return [queue.take().message for _ in range(len(queue))]


def test_receivers_get_independent_copies_of_message(bus: LocalBus) -> None:
    first, second = reader(bus, FACT), reader(bus, FACT)
    writer = bus.add_writer("t", FACT, deepcopy)
    sent = [1]
    bus.publish(writer, sent)
    sent.append(2)
    first.queue.take().message.append(3)
    assert second.queue.take().message == [1]
    late = reader(bus, FACT)
    late.queue.take().message.append(4)
    assert taken(reader(bus, FACT).queue) == [[1]]


def test_late_reader_receives_only_kept_latched_messages(bus: LocalBus) -> None:
    first = bus.add_writer("t", replace(FACT, depth=2), deepcopy)
    gone = bus.add_writer("t", FACT, deepcopy)
    volatile = bus.add_writer("t", EVENTS, deepcopy)
    for number in range(3):
        bus.publish(first, [number])
        bus.publish(volatile, [-number])
    bus.publish(gone, [9])
    bus.remove(gone)
    assert taken(reader(bus, replace(FACT, depth=9)).queue) == [[1], [2]]
    assert taken(reader(bus).queue) == []


@pytest.mark.parametrize(
    ("asked", "hears"),
    [
        ({}, True),
        ({"is_reliable": False}, True),
        ({"is_latched": True}, False),
        ({"kind": dict}, False),
    ],
)
def test_endpoints_match_as_in_dds(bus: LocalBus, asked: dict[str, Any], hears: bool) -> None:
    writer, other = bus.add_writer("t", EVENTS, deepcopy), reader(bus, replace(EVENTS, **asked))
    assert bool(bus.readers_of(writer)) is bool(bus.writers_of(other)) is hears
    best_effort = bus.add_writer("u", replace(EVENTS, is_reliable=False), deepcopy)
    reader(bus, topic="u")
    assert not bus.readers_of(best_effort)


def test_removed_reader_receives_nothing(bus: LocalBus) -> None:
    writer, ended = bus.add_writer("t", EVENTS, deepcopy), reader(bus)
    bus.publish(writer, [1])
    bus.remove(ended)
    ended.queue.put([2])
    bus.publish(writer, [3])
    assert not bus.pending
    assert ended.queue.take() is None


def test_answer_carries_number_of_its_request(bus: LocalBus) -> None:
    server = bus.add_server("/s", int, LocalQueue(bus, object(), 2))
    assert bus.server_of("/s", str) is None
    found = bus.server_of("/s", int)
    assert found is server
    answers: list[tuple[int, Any]] = []
    numbers = [
        bus.call(found, text, lambda *answer: answers.append(answer)) for text in ("a", "b")
    ]
    requests = [server.queue.take(), server.queue.take()]
    assert [one.request for one in requests] == ["a", "b"]
    requests[1].answer("B")
    requests[0].answer("A")
    assert answers == [(numbers[1], "B"), (numbers[0], "A")]
    bus.remove(server)
    assert bus.server_of("/s", int) is None


def test_outgoing_messages_are_written_once_in_order(bus: LocalBus) -> None:
    written: list[int] = []
    for number in range(3):
        bus.send_out(lambda number=number: written.append(number))
    bus.write_out()
    bus.write_out()
    assert written == [0, 1, 2]


def test_only_latest_waiting_state_is_written_in_order(bus: LocalBus) -> None:
    written: list[str] = []
    for name, state_of in (("idle", "market"), ("end", None), ("busy", "market"), ("on", "robot")):
        bus.send_out(lambda name=name: written.append(name), state_of)
    bus.write_out()
    assert written == ["end", "busy", "on"]
