# SPDX-License-Identifier: Apache-2.0
"""Stops of an interaction: by people, by a change of mood, by another scene."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, MarketHarness, scene
from marketplace_node.effects import AnnounceRun, Collect, SendGoal, State
from marketplace_node.hosts.host_effects import CancelGoal


def test_cancel_stops_the_run_and_ends_the_interaction(running: MarketHarness) -> None:
    assert running.cancel("button") == (True, "stopping attentive_guide")
    assert running.all(CancelGoal) == [CancelGoal(goal=running.goal)]
    assert running.cancel("button") == (True, "attentive_guide is being stopped already")
    assert running.all(CancelGoal) == [CancelGoal(goal=running.goal)]
    running.finish(outcome=3)

    assert running.events[1:] == [
        "1 attentive_guide CANCELLING",
        "1 attentive_guide ENDED CANCELLED",
    ]
    assert (running.all(AnnounceRun)[-1].message, running.over) == ("button (done)", ["s1"])
    assert len(running.calls) == 1


def test_stop_reason_stands_alone_without_host_reason(running: MarketHarness) -> None:
    running.cancel("she says stop")
    running.end(outcome=3, message="whatever it says", host_reason=False)
    assert running.all(AnnounceRun)[-1].message == "she says stop"


def test_repeated_auctions_exclude_stopped_agents_until_none_remain(market: MarketHarness) -> None:
    def shown() -> tuple[str, str]:
        return market.status.scene_id, market.status.scene_label

    market.run()
    market.cancel("bored", again=True, scene=scene("s1", 5.0, 1.0, 1.0))
    awarded = ("s1", "age 5, familiarity 1, mood 3")
    assert shown() == awarded, "the run that stops is for the scene as it was awarded"
    market.finish(outcome=3)
    assert shown() == ("s1", "age 5, familiarity 1, mood 1")
    call = market.calls[-1]
    assert (call.round, call.scene.scene_id, call.excluded) == (2, "s1+1", (GUIDE,))
    assert call.scene.get("mood") == 1.0

    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    market.accept()
    assert shown() == ("s1", "age 5, familiarity 1, mood 1")
    market.cancel("bored again", again=True)
    market.finish(outcome=3)

    assert market.auction.decision.terms.follows == 2
    assert "no other agents are registered" in market.auction.reason
    assert (market.over, market.status.finished_scene_id) == (["s1"], "s1")


def test_plain_stop_overrides_repeat_auction(running: MarketHarness) -> None:
    running.cancel("bored", again=True)
    running.cancel("stop")
    running.finish(outcome=3)

    assert running.over == ["s1"]


def test_run_succeeding_before_cancel_has_no_follow_up(running: MarketHarness) -> None:
    running.cancel("bored", again=True)
    running.finish(outcome=1)

    assert running.events[-1] == "1 attentive_guide ENDED SUCCEEDED"
    assert running.over == ["s1"]


def test_stop_during_feedback_collection_prevents_follow_up(running: MarketHarness) -> None:
    running.cancel("bored", again=True)
    running.end(outcome=3)
    assert running.cancel("stop") == (True, "no other agent is asked")
    assert running.cancel("stop")[0] is False
    running.collect()

    assert running.over == ["s1"]


@pytest.mark.parametrize(
    ("epoch", "round_number", "words"),
    [
        ("epoch", 7, "round 7 does not run; the current one is 1"),
        ("earlier", 1, "the market 'earlier' is gone, this one is 'epoch'"),
    ],
)
def test_a_cancel_for_another_run_is_refused(
    running: MarketHarness, epoch: str, round_number: int, words: str
) -> None:

    assert running.cancel(epoch=epoch, round_number=round_number) == (False, words)
    assert running.all(CancelGoal) == []


def test_cancel_while_awarding_cancels_on_acceptance(market: MarketHarness) -> None:
    market.award()
    goal = market.goal
    market.cancel("button", again=True)
    assert market.status.state is State.CANCELLING
    market.accept()
    assert market.effects[-1] == CancelGoal(goal=goal)
    market.end(outcome=3)

    assert market.events == ["1 attentive_guide CANCELLING", "1 attentive_guide ENDED CANCELLED"]
    assert market.all(Collect) == [], "what never began teaches nothing"
    assert market.over == ["s1"]


@pytest.mark.parametrize("answer", ["refused", "silent", "gone"])
def test_cancel_while_awarding_ends_unless_accepted(market: MarketHarness, answer: str) -> None:
    market.award()
    market.cancel("button")
    if answer == "refused":
        market.refuse()
    elif answer == "gone":
        market.die()
    market.wait(2.1)

    assert market.events[-1] == "1 attentive_guide ENDED CANCELLED"
    assert (len(market.all(SendGoal)), market.over) == (1, ["s1"])


def test_scenes_queue_in_order_up_to_limit() -> None:
    market = MarketHarness(queue_limit=2)
    market.run()
    for name in ("s2", "s3", "s4"):
        market.scene(name)
    assert (market.status.queued, market.status.waiting) == (2, ("s2", "s3"))
    assert market.ends == [("s4", "QUEUE_FULL")]
    market.finish()

    assert (market.status.scene_id, market.status.finished_scene_id) == ("s2", "s1")
    market.scene("s5")
    assert market.status.queued == 2, "there is room again"


def test_shutdown_stops_run_and_drops_queued_scenes(running: MarketHarness) -> None:
    running.scene("s2")
    running.shut_down()
    running.scene("s3")

    assert running.ends == [("s2", "SHUTTING_DOWN"), ("s3", "SHUTTING_DOWN")]
    assert running.status.state is State.CANCELLING


@pytest.mark.parametrize(
    ("stop", "words", "dropped", "now"),
    [
        ({}, "; dropped 2 waiting scenes", [("s2", "STOPPED"), ("s3", "STOPPED")], ""),
        ({"round_number": 1}, "", [], "s2"),
        ({"again": True}, "", [], "s1"),
    ],
)
def test_only_plain_stop_drops_queued_scenes(
    running: MarketHarness, stop: dict[str, Any], words: str, dropped: list[Any], now: str
) -> None:
    running.scene("s2")
    running.scene("s3")

    assert running.cancel("she says stop", **stop) == (True, f"stopping attentive_guide{words}")
    assert running.ends == dropped
    running.finish(outcome=3)
    assert running.status.scene_id == now


def test_stop_cause_is_announced_before_cancel_and_afterwards(running: MarketHarness) -> None:
    running.cancel("it is late", by=StoppedBy.OPERATOR)
    cancelling = running.all(AnnounceRun)[-1]
    assert running.effects.index(cancelling) < running.effects.index(CancelGoal(goal=running.goal))
    running.end(outcome=3)
    ended = running.all(AnnounceRun)[-1]
    for one in (cancelling, ended):
        assert (one.stopped_by, one.stop_reason) == (StoppedBy.OPERATOR, "it is late")
