# SPDX-License-Identifier: Apache-2.0
"""Laws of the causal order of a system's events."""

from __future__ import annotations

from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from bt_agents_tools.client.causal_order import (
    LONGEST_WAIT_S,
    SETTLE_S,
    CausalEvent,
    CausalOrder,
    Links,
)

STEP_S = 0.01

times = st.floats(0.0, 1.0)
some_facts = st.frozensets(st.tuples(st.sampled_from("abcdef")), max_size=2)
lines = st.lists(st.tuples(times, times, some_facts, some_facts), max_size=20)
"""When each event arrives and was sent, its predecessors, and its text."""


def delivered(events: list[tuple[float, float, Links]]) -> list[tuple[int, float]]:
    """Return the numbers of events in the order of delivery, and the times."""
    order, shown, found = CausalOrder(), [], []
    arrivals = sorted(range(len(events)), key=lambda number: events[number][0])
    for step in range(round((1.0 + LONGEST_WAIT_S) / STEP_S) + 2):
        now = step * STEP_S
        while arrivals and events[arrivals[0]][0] <= now:
            number = arrivals.pop(0)
            _, sent_s, links = events[number]
            deliver = partial(shown.append, number)
            order.put(CausalEvent(sent_s=sent_s, deliver=deliver, links=links), now)
        order.deliver_due(now)
        found += [(number, now) for number in shown]
        shown.clear()
    return found


@given(lines)
def test_each_event_is_shown_once_within_its_limit(drawn):
    events = [(came, sent, Links(causes, facts)) for came, sent, causes, facts in drawn]
    found = delivered(events)
    assert sorted(number for number, _ in found) == list(range(len(events)))
    for number, at in found:
        assert at - events[number][0] <= max(SETTLE_S, LONGEST_WAIT_S) + 2 * STEP_S


@given(lines)
def test_unlinked_events_keep_their_send_order(drawn):
    events = [(came * SETTLE_S * 0.9, sent, Links()) for came, sent, _, _ in drawn]
    shown = [events[number][1] for number, _ in delivered(events)]
    assert shown == sorted(shown)


@given(st.permutations(range(6)), st.lists(times, min_size=6, max_size=6))
def test_causal_chain_is_shown_in_causal_order(order, sent):
    chain = [
        Links(frozenset({(number - 1,)} if number else ()), frozenset({(number,)}))
        for number in range(6)
    ]
    came = [order.index(number) * STEP_S for number in range(6)]
    events = list(zip(came, sent, chain, strict=True))
    assert [number for number, _ in delivered(events)] == list(range(6))
