# SPDX-License-Identifier: Apache-2.0
"""A stalled market reads queued messages before it acts on a deadline."""

from __future__ import annotations

from bt_agents.engine.run import RunLimits
from bt_agents_language.model.specs import MOST_CLEAN_UP_S
from market_harness import EXPRESS, GUIDE, MarketHarness, scene
from marketplace_node.effects import State
from marketplace_node.settings import Settings


def hold_up(market: MarketHarness, lasted_s: float) -> None:
    """Let time pass without the market; then it reads the queued messages."""
    market.stall(lasted_s)
    market.do(market.market.tick(market.now))


def test_bids_received_during_stall_count(market: MarketHarness) -> None:
    market.scene()
    hold_up(market, 3.0)
    assert market.status.state is State.BIDDING
    market.bid()

    assert market.goal.agent == GUIDE


def test_goal_accepted_during_stall_runs(market: MarketHarness) -> None:
    market.award()
    hold_up(market, 5.0)
    market.accept()

    assert market.events == ["1 attentive_guide STARTED"]


def test_result_after_idle_heartbeat_counts(market: MarketHarness) -> None:
    market.run()
    market.busy["/agents"] = 0
    market.beat()
    hold_up(market, 3.0)
    market.end()

    assert market.events[-1] == "1 attentive_guide ENDED SUCCEEDED"
    assert len(market.calls) == 1, "nobody is served twice"


def test_run_cancelled_during_stall_is_not_lost(market: MarketHarness) -> None:
    market.run()
    market.cancel()
    hold_up(market, 20.0)
    market.end(outcome=3)

    assert market.events[-1] == "1 attentive_guide ENDED CANCELLED"


def test_challenge_bids_received_during_stall_count() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.run()
    market.scene("s2", 3.0, 5.0, 3.5)
    hold_up(market, 3.0)
    market.bid(round=2)

    assert market.auction.decision.winner is not None
    assert market.auction.decision.winner.agent == EXPRESS
    assert market.status.state is State.CANCELLING


def test_deadlines_still_expire_after_stall(market: MarketHarness) -> None:
    market.scene()
    hold_up(market, 3.0)
    market.wait(0.6)

    assert market.ends == [("s1", "NO_BIDS")]


def test_cancel_deadline_exceeds_slowest_run_end() -> None:
    limits, slowest_tick_s = RunLimits(), 1.0

    needed_s = limits.explain_s + MOST_CLEAN_UP_S + limits.settle_s + slowest_tick_s
    assert Settings().cancel_deadline_s > needed_s


def test_deferred_feedback_delays_no_scene(market: MarketHarness) -> None:
    market.run()
    market.do(market.market.scene(scene("s2"), market.now))
    market.end()
    assert market.status.state is State.COLLECTING
    market.do(market.market.feedback_deferred(1, market.now))

    assert market.ends == [("s1", "SUCCEEDED")]
    assert market.end_words.endswith("feedback is kept until the feedback node is back")
    assert (market.status.scene_id, market.status.state) == ("s2", State.BIDDING)
