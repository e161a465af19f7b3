# SPDX-License-Identifier: Apache-2.0
"""Stops of an interaction: by people, by a change of mood, by another scene."""

from __future__ import annotations

import pytest

from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, MarketHarness, scene
from marketplace_node.effects import AnnounceRun, Collect, SendGoal, State
from marketplace_node.hosts.host_effects import CancelGoal
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy


def test_cancel_stops_the_run_and_ends_the_interaction(market: MarketHarness) -> None:
    goal = market.run()
    assert market.cancel("button") == (True, "stopping attentive_guide")
    assert market.all(CancelGoal) == [CancelGoal(goal=goal)]
    assert market.cancel("button") == (True, "attentive_guide is being stopped already")
    assert market.all(CancelGoal) == [CancelGoal(goal=goal)]
    market.finish(outcome=3)

    assert market.events[1:] == [
        "1 attentive_guide CANCELLING",
        "1 attentive_guide ENDED CANCELLED",
    ]
    assert market.all(AnnounceRun)[-1].message == "button (done)"
    assert market.over == ["s1"]
    assert len(market.calls) == 1


def test_stop_reason_stands_alone_without_host_reason(market: MarketHarness) -> None:
    market.run()
    market.cancel("she says stop")
    market.end(outcome=3, message="whatever it says", host_reason=False)
    assert market.all(AnnounceRun)[-1].message == "she says stop"


def test_status_shows_current_scene_under_first_scene_id(market: MarketHarness) -> None:
    def shown() -> tuple[str, str]:
        return market.status.scene_id, market.status.scene_label

    first, now = "age 5, familiarity 1, mood 3", "age 5, familiarity 1, mood 1"
    market.run()
    assert shown() == ("s1", first)
    market.cancel("bored", again=True, scene=scene("s1", 5.0, 1.0, 1.0))
    assert shown() == ("s1", first), "the run that stops is for the scene as it was awarded"
    market.finish(outcome=3)
    assert shown() == ("s1", now)
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    market.accept()
    assert shown() == ("s1", now)


def test_repeated_auctions_exclude_stopped_agents_until_none_remain(market: MarketHarness) -> None:
    market.run()
    market.cancel("bored", again=True, scene=scene("s1", 5.0, 1.0, 1.0))
    market.finish(outcome=3)
    call = market.calls[-1]
    assert (call.round, call.scene.scene_id, call.excluded) == (2, "s1+1", (GUIDE,))
    assert call.scene.get("mood") == 1.0
    assert market.status.scene_id == "s1"

    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    market.accept()
    market.cancel("bored again", again=True)
    market.finish(outcome=3)

    assert market.auction.decision.terms.follows == 2
    assert "no other agents are registered" in market.auction.reason
    assert market.over == ["s1"]
    assert market.status.finished_scene_id == "s1"


def test_plain_stop_overrides_repeat_auction(market: MarketHarness) -> None:
    market.run()
    market.cancel("bored", again=True)
    market.cancel("stop")
    market.finish(outcome=3)

    assert market.over == ["s1"]


def test_stop_during_feedback_collection_prevents_follow_up(market: MarketHarness) -> None:
    market.run()
    market.cancel("bored", again=True)
    market.end(outcome=3)
    assert market.cancel("stop") == (True, "no other agent is asked")
    assert market.cancel("stop")[0] is False
    market.collect()

    assert market.over == ["s1"]


def test_run_succeeding_before_cancel_has_no_follow_up(market: MarketHarness) -> None:
    market.run()
    market.cancel("bored", again=True)
    market.finish(outcome=1)

    assert market.events[-1] == "1 attentive_guide ENDED SUCCEEDED"
    assert market.over == ["s1"]


@pytest.mark.parametrize(
    ("epoch", "round_number", "words"),
    [
        ("epoch", 7, "round 7 does not run; the current one is 1"),
        ("earlier", 1, "the market 'earlier' is gone, this one is 'epoch'"),
    ],
)
def test_a_cancel_for_another_run_is_refused(
    market: MarketHarness, epoch: str, round_number: int, words: str
) -> None:
    market.run()

    assert market.cancel(epoch=epoch, round_number=round_number) == (False, words)
    assert market.all(CancelGoal) == []


def test_a_cancel_without_an_interaction_is_refused(market: MarketHarness) -> None:
    assert market.cancel() == (False, "nothing runs")


def test_cancel_while_bidding_stops_the_round(market: MarketHarness) -> None:
    market.scene()
    assert market.cancel("button", again=True)[0]

    decision = market.auction.decision
    assert (decision.outcome, decision.closed_by) == (AuctionOutcome.NO_BIDS, ClosedBy.STOPPED)
    assert market.auction.reason == "stopped before the round closed: button"
    assert market.over == ["s1"]


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
def test_cancel_while_awarding_ends_unless_host_accepts(
    market: MarketHarness, answer: str
) -> None:
    market.award()
    market.cancel("button")
    if answer == "refused":
        market.refuse()
    elif answer == "gone":
        market.die()
    market.wait(2.1)

    assert market.events[-1] == "1 attentive_guide ENDED CANCELLED"
    assert len(market.all(SendGoal)) == 1
    assert market.over == ["s1"]


def test_run_ignoring_stop_is_lost_and_excludes_host() -> None:
    market = MarketHarness(host_wait_s=0)
    market.run()
    market.cancel("button")
    market.wait(14.1)
    assert market.events[-1] == "1 attentive_guide ENDED LOST"
    assert "did not end within 14 s" in market.all(AnnounceRun)[-1].message
    assert market.over == ["s1"]

    market.scene("s2")
    assert "its run of round 1 has not ended" in market.auction.reason
    market.busy["/agents"] = 0
    market.wait(0.1)
    market.scene("s3")
    assert market.status.state is State.BIDDING


def test_scenes_queue_in_order_up_to_limit() -> None:
    market = MarketHarness(queue_limit=2)
    market.run()
    for name in ("s2", "s3", "s4"):
        market.scene(name)
    assert market.status.queued == 2
    assert market.status.waiting == ("s2", "s3")
    assert market.ends == [("s4", "QUEUE_FULL")]
    market.finish()

    assert (market.status.scene_id, market.status.finished_scene_id) == ("s2", "s1")
    market.scene("s5")
    assert market.status.queued == 2, "there is room again"


def test_queued_scenes_end_one_by_one_without_agents() -> None:
    market = MarketHarness(host_wait_s=0)
    market.run()
    for number in range(2, 10):
        market.scene(f"s{number}")
    market.lose(away_s=1.1)

    assert market.over == [f"s{number}" for number in range(1, 10)]


def test_new_scene_is_rejected_in_reject_mode() -> None:
    market = MarketHarness(on_new_scene="reject")
    market.run()
    market.scene("s2")

    assert market.ends == [("s2", "BUSY")]


def test_a_known_scene_id_is_a_duplicate(market: MarketHarness) -> None:
    market.run()
    market.scene("s2")
    for name in ("s1", "s2"):
        market.scene(name)

    assert market.ends == [("s1", "DUPLICATE"), ("s2", "DUPLICATE")]


def test_shutdown_stops_run_and_drops_queued_scenes(market: MarketHarness) -> None:
    market.run()
    market.scene("s2")
    market.do(market.market.shut_down("shutting down", market.now))
    market.scene("s3")

    assert market.ends == [("s2", "SHUTTING_DOWN"), ("s3", "SHUTTING_DOWN")]
    assert market.status.state is State.CANCELLING


def test_stop_drops_queued_scenes() -> None:
    market = MarketHarness()
    market.run()
    market.scene("s2")
    market.scene("s3")

    accepted, words = market.cancel("she says stop")

    assert accepted
    assert words == "stopping attentive_guide; dropped 2 waiting scenes"
    assert market.ends == [("s2", "STOPPED"), ("s3", "STOPPED")]
    market.finish(outcome=3)
    assert market.status.state is State.IDLE


def test_cancel_of_named_round_keeps_queued_scenes() -> None:
    market = MarketHarness()
    market.run()
    market.scene("s2")

    assert market.cancel("the next, please", round_number=1) == (True, "stopping attentive_guide")
    market.finish(outcome=3)
    assert market.status.scene_id == "s2"


def test_stop_with_repeat_auction_keeps_queued_scenes() -> None:
    market = MarketHarness()
    market.run()
    market.scene("s2")

    market.cancel("the mood fell", again=True)

    assert market.status.queued == 1
    assert market.ends == []


def test_stop_cause_is_announced_before_cancel_and_afterwards(market: MarketHarness) -> None:
    market.run()
    market.cancel("it is late", by=StoppedBy.OPERATOR)
    cancelling = market.all(AnnounceRun)[-1]
    assert market.effects.index(cancelling) < market.effects.index(CancelGoal(goal=market.goal))
    market.end(outcome=3)
    ended = market.all(AnnounceRun)[-1]
    for one in (cancelling, ended):
        assert (one.stopped_by, one.stop_reason) == (StoppedBy.OPERATOR, "it is late")
