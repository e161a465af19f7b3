# SPDX-License-Identifier: Apache-2.0
"""Preemption by a scene during a run: which run is stopped, and when."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness
from marketplace_node.effects import AnnounceRun, Collect, OpenCall, PublishAuction, State
from marketplace_node.hosts.host_effects import CancelGoal
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy
from marketplace_node.settings import Settings

# The scene of the tests is [5, 1, 3].
NEAR, MIDDLE, FAR = (5.0, 1.0, 3.5), (5.0, 1.0, 5.0), (3.0, 1.0, 5.0)  # 0.5, 2.0 and 4.0 away


@pytest.fixture
def market() -> MarketHarness:
    """A market in which the guide runs."""
    harness = MarketHarness(on_new_scene="preempt", preempt_cooldown_s=5.0)
    harness.run()
    return harness


def bid(market: MarketHarness, guide: tuple[float, ...], express: tuple[float, ...]) -> None:
    """Answer the open challenge."""
    market.bid(vectors={GUIDE: guide, EXPRESS: express}, round=market.calls[-1].round)


def challenge(
    market: MarketHarness,
    guide: tuple[float, ...],
    express: tuple[float, ...],
    scene_id: str = "s2",
    *,
    urgent: bool = False,
) -> None:
    """Announce a scene, and answer its challenge."""
    market.scene(scene_id, urgent=urgent)
    bid(market, guide, express)


def outcome(market: MarketHarness) -> AuctionOutcome:
    return market.auction.decision.outcome


def test_challenge_opens_while_run_continues(market: MarketHarness) -> None:
    market.scene("s2")

    assert (market.calls[-1].round, market.calls[-1].scene.scene_id) == (2, "s2")
    assert market.calls[-1].excluded == ()
    status = market.status
    assert (status.state, status.round, status.scene_id) == (State.RUNNING, 1, "s1")
    assert status.queued == 1
    assert market.market.due < math.inf


def test_better_agent_preempts_run_and_opens_fresh_round(market: MarketHarness) -> None:
    challenge(market, MIDDLE, NEAR)

    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert market.auction.decision.winner is not None
    assert market.auction.reason == (
        "professional_express 0.5 for the new scene, attentive_guide who runs has 2.0: "
        "better by 1.5, margin 1.0: attentive_guide is stopped"
    )
    assert market.status.state is State.CANCELLING
    assert market.all(AnnounceRun)[-1].stopped_by is StoppedBy.OTHER_SCENE
    market.end(outcome=3)
    assert market.ends == [("s1", "PREEMPTED")]
    assert market.end_words.startswith("attentive_guide cancelled: preempted by scene 's2'")
    assert (market.calls[-1].round, market.calls[-1].scene.scene_id) == (3, "s2")
    assert (market.status.scene_id, market.status.round) == ("s2", 3)
    market.bid()
    assert outcome(market) is AuctionOutcome.AWARDED


def test_feedback_on_preempted_run_delays_no_scene(market: MarketHarness) -> None:
    challenge(market, MIDDLE, NEAR)
    market.end(outcome=3)

    assert len(market.all(Collect)) == 1
    assert market.status.state is State.BIDDING
    effects = market.market.collected(1, "late", market.now)
    assert effects == [], "a late answer changes nothing"


@pytest.mark.parametrize(
    ("guide", "express", "words"),
    [
        (
            NEAR,
            MIDDLE,
            "attentive_guide 0.5 for the new scene, it is the one that runs: "
            "attentive_guide goes on, the scene waits",
        ),
        (
            (5.0, 1.0, 4.25),
            NEAR,
            "professional_express 0.5 for the new scene, attentive_guide who runs has 1.25: "
            "better by 0.75, margin 1.0: attentive_guide goes on, the scene waits",
        ),
    ],
)
def test_scene_waits_without_margin(
    market: MarketHarness, guide: tuple[float, ...], express: tuple[float, ...], words: str
) -> None:
    market.scene("s2")
    bid(market, guide, express)

    assert outcome(market) is AuctionOutcome.WAITS
    assert market.auction.reason == words
    assert (market.status.state, market.status.queued) == (State.RUNNING, 1)
    assert market.all(CancelGoal) == []
    market.finish()
    assert market.status.scene_id == "s2"


@pytest.mark.parametrize(
    ("margin", "better", "stops"),
    [(1.0, 1.0, True), (1.0, 0.9375, False), (0.0, 0.5, True), (100.0, 4.0, False)],
)
def test_margin_is_reached_or_missed(margin: float, better: float, stops: bool) -> None:
    market = MarketHarness(on_new_scene="preempt", preempt_margin=margin)
    market.run()
    market.scene("s2")
    bid(market, guide=(5.0 - better, 1.0, 3.0), express=(5.0, 1.0, 3.0))

    assert (outcome(market) is AuctionOutcome.PREEMPTS) == stops


@pytest.mark.parametrize(
    ("bids", "words"),
    [
        ({"declined": {GUIDE: "needs scene.person"}}, "who runs declines (needs scene.person)"),
        ({}, "who runs is refused (/agents says nothing about it)"),
    ],
)
def test_running_agent_without_bid_is_infinitely_far(
    market: MarketHarness, bids: dict[str, Any], words: str
) -> None:
    market.scene("s2")
    market.bid(vectors={EXPRESS: FAR}, round=2, **bids)

    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert words in market.auction.reason


def test_running_agent_with_silent_host_is_infinitely_far() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.register()
    market.register("/others", PLAIN)
    market.award()
    market.bid("/others", {PLAIN: FAR})
    market.accept()
    market.scene("s2")
    market.bid("/others", {PLAIN: FAR}, round=2)
    assert outcome(market) is AuctionOutcome.AWARDED, "it is still open"
    market.wait(0.6)

    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert market.auction.decision.closed_by is ClosedBy.DEADLINE
    assert market.auction.reason == (
        "plain 4.0 for the new scene, attentive_guide who runs does not bid: attentive_guide is "
        "stopped; no answer in time from /agents"
    )


def test_run_continues_without_bids(market: MarketHarness) -> None:
    market.scene("s2")
    market.bid(
        vectors={},
        declined=dict.fromkeys((GUIDE, EXPRESS), "needs scene.person"),
        unmet=("scene.person", "scene.person"),
        round=2,
    )

    assert outcome(market) is AuctionOutcome.WAITS
    assert market.auction.decision.winner is None
    assert market.auction.reason == (
        "nobody bids: attentive_guide and professional_express need scene.person; "
        "attentive_guide goes on, the scene waits"
    )


@pytest.mark.parametrize("express", [NEAR, FAR])
def test_urgent_scene_stops_run_for_any_winner(
    market: MarketHarness, express: tuple[float, ...]
) -> None:
    challenge(market, MIDDLE, express, urgent=True)

    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert market.auction.reason.startswith("urgent: ")
    assert market.auction.reason.endswith("attentive_guide is stopped")
    market.end(outcome=3)
    assert market.status.scene_id == "s2"


def test_urgent_scene_without_bids_stops_nothing(market: MarketHarness) -> None:
    market.scene("s2", urgent=True)
    market.bid(vectors={}, declined=dict.fromkeys((GUIDE, EXPRESS), "needs scene.person"), round=2)

    assert outcome(market) is AuctionOutcome.WAITS


def preempted(market: MarketHarness) -> None:
    """Let s2 preempt the run of s1, and its agent run."""
    challenge(market, MIDDLE, NEAR)
    market.end(outcome=3)
    market.bid()
    market.accept()


def test_preemption_cooldown_blocks_next_preemption(market: MarketHarness) -> None:
    preempted(market)
    challenge(market, MIDDLE, NEAR, "s3")

    assert outcome(market) is AuctionOutcome.WAITS
    assert market.auction.reason == (
        "professional_express 0.5 for the new scene, attentive_guide who runs has 2.0: better by "
        "1.5, margin 1.0: the next stop may come in 5.0 s at the earliest: attentive_guide goes "
        "on, the scene waits"
    )
    market.wait(5.1)
    challenge(market, MIDDLE, NEAR, "s4")
    assert outcome(market) is AuctionOutcome.PREEMPTS
    market.end(outcome=3)
    assert market.status.scene_id == "s4", "ahead of the line"


def test_urgent_scene_ignores_cooldown(market: MarketHarness) -> None:
    preempted(market)
    challenge(market, NEAR, FAR, "s3", urgent=True)

    assert outcome(market) is AuctionOutcome.PREEMPTS


def test_run_succeeding_before_stop_is_not_preempted(market: MarketHarness) -> None:
    challenge(market, MIDDLE, NEAR)
    market.end(outcome=1)

    assert market.ends == [("s1", "SUCCEEDED")]
    assert market.status.scene_id == "s2"


@pytest.mark.parametrize("phase", ["bidding", "awarding"])
def test_scene_arriving_before_run_challenges_once_it_runs(phase: str) -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.register()
    market.scene("s1")
    if phase == "awarding":
        market.bid()
    market.scene("s2")
    market.scene("s3", urgent=True)
    assert len(market.calls) == 1
    if phase == "bidding":
        market.bid()
    market.accept()

    assert market.calls[-1].scene.scene_id == "s3", "the urgent one first"
    bid(market, guide=NEAR, express=NEAR)
    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert len(market.calls) == 2, "s2 is not asked about while the run is stopped"


def test_challenges_open_one_at_a_time(market: MarketHarness) -> None:
    market.scene("s2")
    market.scene("s3")
    assert len(market.calls) == 2
    bid(market, guide=NEAR, express=NEAR)

    assert [call.scene.scene_id for call in market.calls] == ["s1", "s2", "s3"]
    bid(market, guide=NEAR, express=NEAR)
    market.wait(1.0)
    assert len(market.calls) == 3, "each scene is asked about once"


def test_challenge_needs_no_queue_slot_until_it_waits() -> None:
    market = MarketHarness(on_new_scene="preempt", queue_limit=0, preempt_cooldown_s=0.0)
    market.run()
    market.scene("s2")
    market.scene("s3")
    assert market.ends == [("s3", "QUEUE_FULL")]
    bid(market, guide=NEAR, express=NEAR)
    assert market.ends[-1] == ("s2", "QUEUE_FULL")
    assert market.end_words == (
        "professional_express 0.5 for the new scene, attentive_guide who runs has 0.5: better by "
        "0.0, margin 1.0: attentive_guide goes on, but 0 wait already and at most 0 may"
    )

    challenge(market, MIDDLE, NEAR, "s4")
    market.end(outcome=3)
    assert market.status.scene_id == "s4"


def test_full_queue_holds_one_extra_urgent_scene() -> None:
    market = MarketHarness(on_new_scene="preempt", queue_limit=1)
    market.run()
    for name, urgent in (("s2", False), ("s3", False), ("s4", True), ("s5", True)):
        market.scene(name, urgent=urgent)

    assert market.ends == [("s5", "QUEUE_FULL")]
    bid(market, guide=NEAR, express=NEAR)
    assert market.ends[-1] == ("s2", "QUEUE_FULL")
    assert market.calls[-1].scene.scene_id == "s4"


@pytest.mark.parametrize(
    ("what", "words", "end"),
    [
        ("ends", "the run ended", "SUCCEEDED"),
        ("lost", "the run ended", "LOST"),
        ("cancel", "the run is being stopped", "CANCELLED"),
        ("again", "the run is being stopped", "CANCELLED"),
    ],
)
def test_a_challenge_ends_with_the_run(
    market: MarketHarness, what: str, words: str, end: str
) -> None:
    market.scene("s2")
    if what == "ends":
        market.end()
    elif what == "lost":
        market.die()
        market.now += 1.0
        market.do(market.market.tick(market.now))
        market.busy["/agents"] = 0
    else:
        market.cancel("button", again=what == "again", round_number=1)
        market.end(outcome=3)

    (auction,) = (a for a in market.all(PublishAuction) if a.decision.terms.round == 2)
    assert auction.decision.outcome is AuctionOutcome.WAITS
    assert auction.decision.closed_by is ClosedBy.STOPPED
    assert auction.reason == f"stopped before the round closed: {words}"
    market.collect()
    if what == "again":
        assert market.status.scene_id == "s1", "another agent takes over first"
        market.bid(vectors={EXPRESS: FAR})
        market.accept()
        assert market.calls[-1].scene.scene_id == "s2", "then it is asked about anew"
        market.finish(goal=market.goal)
    assert market.ends[0] == ("s1", end if what != "again" else "SUCCEEDED")


def test_late_or_foreign_challenge_responses_change_nothing(market: MarketHarness) -> None:
    market.scene("s2")
    market.bid(round=1)
    assert len(market.notes) == 1
    market.bid(round=9)
    bid(market, guide=NEAR, express=NEAR)

    assert [bid.code for bid in market.auction.decision.refused] == ["FOREIGN_ROUND"]
    market.bid(round=2)
    assert len(market.notes) == 2


def test_cancel_names_run_instead_of_challenge(market: MarketHarness) -> None:
    market.scene("s2")

    assert market.cancel(round_number=2) == (False, "round 2 does not run; the current one is 1")
    assert market.cancel(round_number=1)[0]


def test_shutdown_ends_challenge_and_its_scene(market: MarketHarness) -> None:
    market.scene("s2")
    market.do(market.market.shut_down("shutting down", market.now))

    assert market.ends == [("s2", "SHUTTING_DOWN")]
    assert market.auction.reason == "stopped before the round closed: shutting down"
    market.end(outcome=3)
    assert market.ends[-1] == ("s1", "CANCELLED")
    assert market.status.state is State.IDLE, "nobody waits for feedback any more"


def test_challenge_opens_only_in_preempt_mode() -> None:
    market = MarketHarness()
    market.run()
    market.scene("s2", urgent=True)

    assert len(market.calls) == 1


def test_switch_to_preempt_challenges_with_queued_scene() -> None:
    market = MarketHarness()
    market.run()
    market.scene("s2")
    market.do(market.market.configure(Settings(on_new_scene="preempt"), market.now))

    assert market.calls[-1].scene.scene_id == "s2"


def test_unpublished_call_still_decides_challenge(market: MarketHarness) -> None:
    effects = market.market.scene(market.calls[0].scene.with_id("s2"), market.now)
    market.effects += effects
    assert any(isinstance(effect, OpenCall) for effect in effects)
    market.wait(1.1)

    assert outcome(market) is AuctionOutcome.WAITS
    assert math.isnan(market.auction.decision.margin)


def test_switch_to_queue_prevents_preemption_by_open_challenge() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.run()
    market.scene("s2", 3.0, 5.0, 3.5)
    market.do(market.market.configure(Settings(on_new_scene="queue"), market.now))
    assert market.auction.decision.outcome is AuctionOutcome.WAITS
    assert "on_new_scene is 'queue' now" in market.auction.reason
    market.bid(round=2)

    assert market.status.state is State.RUNNING
    assert market.status.queued == 1


def stopped_for_s2(market: MarketHarness, **first: tuple[float, ...]) -> tuple[str, str, str]:
    """Let s2 preempt; return the agent that ran, the one named for s2, and its winner."""
    ran = market.goal.agent
    market.scene("s2", 3.25, 4.5, 3.0)
    market.bid(vectors=first or None, round=market.calls[-1].round)
    named = market.auction.decision
    if named.outcome is not AuctionOutcome.PREEMPTS or named.winner is None:
        return ran, "", ""
    market.end(outcome=3)
    market.bid()
    return ran, named.winner.agent, market.goal.agent


@pytest.mark.parametrize(
    ("strategy", "options"),
    [
        ("softmax", {"softmax.temperature": 2.0}),
        ("epsilon_greedy", {"epsilon_greedy.epsilon": 0.5}),
        ("thompson", {"thompson.sigma": 0.5}),
    ],
)
def test_named_preempting_agent_wins_under_random_strategies(
    strategy: str, options: dict[str, float]
) -> None:
    stops = 0
    for skipped in range(40):
        market = MarketHarness(
            on_new_scene="preempt", preempt_cooldown_s=0.0, strategy=strategy, options=options
        )
        market.register()
        for number in range(skipped % 8):
            market.scene(f"before{number}")
            market.cancel()
        market.scene("s1", 5.0 - skipped / 64, 1.0, 3.0)
        market.bid()
        market.accept()
        ran, named, gets = stopped_for_s2(market)
        stops += bool(named)
        assert gets == named
        assert not named or gets != ran
    assert stops > 3


def test_unresponsive_running_agent_is_excluded_after_preemption() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.run()

    ran, named, gets = stopped_for_s2(market, **{EXPRESS: (3.0, 5.0, 3.5)})
    assert (ran, named, gets) == (GUIDE, EXPRESS, EXPRESS)
    assert market.calls[-1].excluded == (GUIDE,)
    assert "its run was stopped for scene 's2'" in market.auction.explanation


def ranked_outside() -> MarketHarness:
    """Return a market in which the guide runs by an external ranking."""
    market = MarketHarness(on_new_scene="preempt", strategy="external")
    market.register()
    market.award()
    market.ranked(GUIDE)
    market.accept()
    return market


def test_external_ranking_cannot_preempt_agent_for_itself() -> None:
    market = ranked_outside()
    market.scene("s2", 3.25, 4.5, 3.0)
    market.bid(round=2)
    market.ranked(EXPRESS)
    assert outcome(market) is AuctionOutcome.PREEMPTS
    market.end(outcome=3)

    assert market.calls[-1].excluded == (GUIDE,)


def test_urgent_scene_does_not_await_external_ranking() -> None:
    market = ranked_outside()
    market.scene("s2", urgent=True)
    market.bid(round=2)

    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert [question.round for question in market.questions] == [1]
