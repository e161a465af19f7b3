# SPDX-License-Identifier: Apache-2.0
"""Laws of the bus for every order of publishing and taking."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from bt_agents_ros.local_bus import Channel, LocalBus, LocalQueue

READERS = 3
DEPTHS = st.lists(st.integers(1, 4), min_size=READERS, max_size=READERS)
STEPS = st.lists(st.one_of(st.none(), st.integers(0, READERS - 1)), max_size=40)
"""A publication, or one of the readers taking."""


@given(depths=DEPTHS, steps=STEPS, latched=st.booleans())
def test_readers_receive_undropped_messages_in_order(
    depths: list[int], steps: list[int | None], latched: bool
) -> None:
    bus = LocalBus(lambda: 0)
    channel = Channel(kind=list, depth=2, is_reliable=True, is_latched=latched)
    writer = bus.add_writer("t", channel, list)
    queues = [LocalQueue(bus, object(), depth) for depth in depths]
    for queue, depth in zip(queues, depths, strict=True):
        bus.add_reader("t", replace(channel, depth=depth), queue)
    expected: list[deque[int]] = [deque(maxlen=depth) for depth in depths]
    for number, step in enumerate(steps):
        if step is None:
            bus.publish(writer, [number])
            for one in expected:
                one.append(number)
            continue
        found = queues[step].take()
        if found is None:
            assert not expected[step]
        else:
            assert found.message == [expected[step].popleft()]
        # Exactly the endpoints with messages are pending.
        assert set(bus.pending) == {one for one in queues if len(one)}


@given(sent=st.lists(st.integers(0, READERS - 1), max_size=60))
def test_waiting_queue_is_served_within_one_rotation(sent: list[int]) -> None:
    bus = LocalBus(lambda: 0)
    queues = [LocalQueue(bus, index, None) for index in range(READERS)]
    for index in sent:
        queues[index].put(index)
    overtaken = dict.fromkeys(range(READERS), 0)
    while bus.pending:
        queue = next(iter(bus.pending))
        queue.take()
        overtaken[queue.entity] = 0
        for other in bus.pending:
            if other is not queue:
                overtaken[other.entity] += 1
                assert overtaken[other.entity] < READERS
