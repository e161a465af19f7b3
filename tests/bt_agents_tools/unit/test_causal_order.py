# SPDX-License-Identifier: Apache-2.0
"""Causal order: which events precede another, and when a tree was ticked."""

from __future__ import annotations

from functools import partial

import pytest

from bt_agents_interfaces.msg import Auction, Feedback, Run, Scene, SceneEnd, TreeStatus
from bt_agents_ros.messages import header_at, to_time
from bt_agents_tools.client import causal_order as causal
from bt_agents_tools.client.causal_order import CausalEvent, CausalOrder, Links

SCENE = Scene(scene_id="s1")
ROUND = {"epoch": "e", "round": 2}
STARTED, CANCELLING = Run.STARTED, Run.CANCELLING
STORY: list[tuple[str, Links]] = [
    ("scene", causal.scene_links(SCENE)),
    ("auction", causal.auction_links(Auction(**ROUND, scene=SCENE))),
    ("first tick", causal.tree_links(TreeStatus(**ROUND, tick=1))),
    ("started", causal.run_links(Run(**ROUND, event=STARTED, scene=SCENE))),
    ("feedback", causal.feedback_links(Feedback(**ROUND))),
    ("cancelling", causal.run_links(Run(**ROUND, event=CANCELLING, scene=SCENE))),
    ("last tick", causal.tree_links(TreeStatus(**ROUND, tick=7))),
    ("ended", causal.run_links(Run(**ROUND, event=Run.ENDED, outcome=Run.CANCELLED, ticks=7))),
    ("over", causal.scene_end_links(SceneEnd(**ROUND, scene_id="s1", agent="a"))),
]


def shown(events: list[tuple[str, Links]], now: float = causal.SETTLE_S) -> list[str]:
    """Return the events shown by then; all arrive at 0, each was sent at its position."""
    found: list[str] = []
    order = CausalOrder()
    for place, (name, links) in enumerate(events):
        deliver = partial(found.append, name)
        order.put(CausalEvent(sent_s=float(place), deliver=deliver, links=links), 0.0)
    order.deliver_due(now)
    return found


@pytest.mark.parametrize("moved", range(len(STORY)))
def test_late_cause_is_shown_before_its_effects(moved):
    late = STORY[moved]
    others = [line for line in STORY if line is not late]
    names = shown([*others, late])
    assert sorted(names) == sorted(name for name, _ in STORY)
    # Either the first tick or the market's message counts as a start.
    only_said_by_it = late[1].facts.difference(*(links.facts for _, links in others))
    for name, links in others:
        if links.causes & only_said_by_it:
            assert names.index(name) > names.index(late[0])


def test_event_without_cause_is_shown_after_time_limit():
    auction = STORY[1:2]
    assert shown(auction, causal.LONGEST_WAIT_S - 0.01) == []
    assert shown(auction, causal.LONGEST_WAIT_S) == ["auction"]


def test_waiting_event_does_not_delay_unrelated_events():
    assert shown([STORY[1], ("robot", Links())]) == ["robot"]


@pytest.mark.parametrize(
    "auction",
    [
        Auction(**ROUND, follows=1, scene=Scene(scene_id="s1+2")),
        Auction(**ROUND, follows=1, scene=SCENE),
        Auction(**ROUND, scene=SCENE, intervention="anna awards it to bert"),
    ],
)
def test_follow_up_and_operator_award_need_no_scene(auction):
    assert causal.auction_links(auction).causes == frozenset()


def test_lost_run_and_refused_scene_do_not_wait():
    lost = causal.run_links(Run(**ROUND, event=Run.ENDED, outcome=Run.LOST, ticks=7))
    assert lost.causes == {("run", "e", 2)}
    refused = causal.scene_end_links(SceneEnd(epoch="e", scene_id="s1", code="BUSY"))
    assert refused.causes == causal.scene_links(SCENE).facts


@pytest.mark.parametrize(
    ("stamp_s", "expected_s"), [(99.9, 99.9), (100.0, 100.0), (100.5, 100.0), (3.0, 100.0)]
)
def test_timeouts_use_stamps_unless_clocks_differ(stamp_s, expected_s):
    for kind in (Auction, TreeStatus):
        assert causal.happened_s(kind(header=header_at(to_time(stamp_s))), 100.0) == pytest.approx(
            expected_s
        )
    assert causal.happened_s(Run(header=header_at(to_time(stamp_s))), 100.0) == 100.0


def test_remembered_facts_are_bounded():
    order = CausalOrder()
    for number in range(2 * causal.MOST_FACTS):
        links = Links(facts=frozenset({(number,)}))
        order.put(CausalEvent(sent_s=0.0, deliver=list, links=links), 0.0)
    order.deliver_due(1.0)
    found: list[int] = []
    for cause in (0, 2 * causal.MOST_FACTS - 1):
        links = Links(causes=frozenset({(cause,)}))
        deliver = partial(found.append, cause)
        order.put(CausalEvent(sent_s=0.0, deliver=deliver, links=links), 2.0)
    order.deliver_due(2.0 + causal.SETTLE_S)
    assert found == [2 * causal.MOST_FACTS - 1]
