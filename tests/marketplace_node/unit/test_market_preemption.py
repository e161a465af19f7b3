# SPDX-License-Identifier: Apache-2.0
"""Preemption by a scene during a run: which run is stopped, and when."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bt_agents_core.scene import Vector
from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, with_host
from marketplace_node.effects import AnnounceRun, Collect, PublishAuction, State
from marketplace_node.hosts.host_effects import CancelGoal
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy

# The scene of the tests is [5, 1, 3].
NEAR, MIDDLE, FAR = (5.0, 1.0, 3.5), (5.0, 1.0, 5.0), (3.0, 1.0, 5.0)  # 0.5, 2.0 and 4.0 away
WAITS = "attentive_guide goes on, the scene waits"
STOPS = "attentive_guide is stopped"
HAS = "professional_express 0.5 for the new scene, attentive_guide who runs has"


def preempting(**settings: Any) -> MarketHarness:
    """Return a market with preemption in which the guide runs."""
    market = MarketHarness(on_new_scene="preempt", **settings)
    market.run()
    return market


@pytest.fixture
def market() -> MarketHarness:
    return preempting()


def bid(market: MarketHarness, guide: Vector, express: Vector) -> None:
    """Answer the open challenge."""
    market.bid(vectors={GUIDE: guide, EXPRESS: express}, round=market.calls[-1].round)


def challenge(
    market: MarketHarness,
    guide: Vector,
    express: Vector,
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

    call, status = market.calls[-1], market.status
    assert (call.round, call.scene.scene_id, call.excluded) == (2, "s2", ())
    assert (status.state, status.round, status.scene_id) == (State.RUNNING, 1, "s1")
    assert status.queued == 1
    assert market.market.due < math.inf


def test_better_agent_preempts_run_and_opens_fresh_round(market: MarketHarness) -> None:
    challenge(market, MIDDLE, NEAR)

    assert market.all(AnnounceRun)[-1].stopped_by is StoppedBy.OTHER_SCENE
    market.end(outcome=3)
    assert market.ends == [("s1", "PREEMPTED")]
    assert market.end_words.startswith("attentive_guide cancelled: preempted by scene 's2'")
    assert (market.calls[-1].round, market.calls[-1].scene.scene_id) == (3, "s2")
    assert (market.status.scene_id, market.status.round, len(market.all(Collect))) == ("s2", 3, 1)
    effects = market.market.collected(1, "late", market.now)
    assert effects == [], "feedback on the preempted run delays no scene"
    market.bid()
    assert outcome(market) is AuctionOutcome.AWARDED


OWN = "attentive_guide 0.5 for the new scene, it is the one that runs"
FARTHER = "professional_express 4.0 for the new scene, attentive_guide who runs"
NO = "/agents says nothing about it"
REFUSED = f"refused: attentive_guide (NO_ANSWER: {NO})"
DECLINED = {"declined": dict.fromkeys((GUIDE, EXPRESS), "no"), "unmet": ("scene.person",) * 2}


@pytest.mark.parametrize(
    ("vectors", "others", "reason"),
    [
        ({GUIDE: MIDDLE, EXPRESS: NEAR}, {}, f"{HAS} 2.0: better by 1.5, margin 1.0: {STOPS}"),
        ({GUIDE: NEAR, EXPRESS: MIDDLE}, {}, f"{OWN}: {WAITS}"),
        (
            {GUIDE: (5.0, 1.0, 4.25), EXPRESS: NEAR},
            {},
            f"{HAS} 1.25: better by 0.75, margin 1.0: {WAITS}",
        ),
        ({EXPRESS: FAR}, {"declined": {GUIDE: "no"}}, f"{FARTHER} declines (no): {STOPS}"),
        ({EXPRESS: FAR}, {}, f"{FARTHER} is refused ({NO}): {STOPS}; {REFUSED}"),
        ({}, DECLINED, f"nobody bids: {GUIDE} and {EXPRESS} need scene.person; {WAITS}"),
    ],
)
def test_challenge_is_decided_by_the_distances(
    market: MarketHarness, vectors: dict[str, Vector], others: dict[str, Any], reason: str
) -> None:
    market.scene("s2")
    market.bid(vectors=vectors, round=2, **others)

    assert market.auction.reason == reason
    stops = STOPS in reason
    expected = (AuctionOutcome.PREEMPTS if stops else AuctionOutcome.WAITS, 1, stops)
    assert (outcome(market), market.status.queued, bool(market.all(CancelGoal))) == expected
    market.finish(outcome=3 if stops else 1)
    assert market.status.scene_id == "s2"


@pytest.mark.parametrize(
    ("margin", "better", "stops"),
    [(1.0, 1.0, True), (1.0, 0.9375, False), (0.0, 0.5, True), (100.0, 4.0, False)],
)
def test_margin_is_reached_or_missed(margin: float, better: float, stops: bool) -> None:
    market = preempting(preempt_margin=margin)
    challenge(market, (5.0 - better, 1.0, 3.0), (5.0, 1.0, 3.0))

    assert (outcome(market) is AuctionOutcome.PREEMPTS) == stops


def test_running_agent_with_silent_host_is_infinitely_far() -> None:
    market = with_host(on_new_scene="preempt")
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


@pytest.mark.parametrize("express", [NEAR, FAR])
def test_urgent_scene_stops_run_for_any_winner(market: MarketHarness, express: Vector) -> None:
    challenge(market, MIDDLE, express, urgent=True)

    assert outcome(market) is AuctionOutcome.PREEMPTS
    assert market.auction.reason.startswith("urgent: ")
    assert market.auction.reason.endswith(STOPS)
    market.end(outcome=3)
    assert market.status.scene_id == "s2"


def test_urgent_scene_without_bids_stops_nothing(market: MarketHarness) -> None:
    market.scene("s2", urgent=True)
    market.bid(vectors={}, round=2, **DECLINED)

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
        f"{HAS} 2.0: better by 1.5, margin 1.0: the next stop may come in 5.0 s at the earliest: "
        f"{WAITS}"
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

    assert (market.ends, market.status.scene_id) == ([("s1", "SUCCEEDED")], "s2")


@pytest.mark.parametrize(("before", "between"), [(0, 1), (1, 0)])
def test_scene_arriving_before_run_challenges_once_it_runs(before: int, between: int) -> None:
    market = with_host(on_new_scene="preempt")
    market.scene("s1")
    for _ in range(before):
        market.bid()
    market.scene("s2")
    market.scene("s3", urgent=True)
    assert len(market.calls) == 1
    for _ in range(between):
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
    market = preempting(queue_limit=0, preempt_cooldown_s=0.0)
    market.scene("s2")
    market.scene("s3")
    assert market.ends == [("s3", "QUEUE_FULL")]
    bid(market, guide=NEAR, express=NEAR)
    assert market.ends[-1] == ("s2", "QUEUE_FULL")
    assert market.end_words == (
        f"{HAS} 0.5: better by 0.0, margin 1.0: attentive_guide goes on, but 0 wait already and "
        "at most 0 may"
    )

    challenge(market, MIDDLE, NEAR, "s4")
    market.end(outcome=3)
    assert market.status.scene_id == "s4"


def test_full_queue_holds_one_extra_urgent_scene() -> None:
    market = preempting(queue_limit=1)
    for name, urgent in (("s2", False), ("s3", False), ("s4", True), ("s5", True)):
        market.scene(name, urgent=urgent)

    assert market.ends == [("s5", "QUEUE_FULL")]
    bid(market, guide=NEAR, express=NEAR)
    assert (market.ends[-1], market.calls[-1].scene.scene_id) == (("s2", "QUEUE_FULL"), "s4")


@pytest.mark.parametrize(
    ("stopped", "words", "end"),
    [(False, "the run ended", "SUCCEEDED"), (True, "the run is being stopped", "CANCELLED")],
)
def test_a_challenge_ends_with_the_run(
    market: MarketHarness, stopped: bool, words: str, end: str
) -> None:
    market.scene("s2")
    if stopped:
        market.cancel("button", round_number=1)
    market.finish(outcome=3 if stopped else 1)

    (auction,) = (a for a in market.all(PublishAuction) if a.decision.terms.round == 2)
    assert auction.decision.outcome is AuctionOutcome.WAITS
    assert auction.decision.closed_by is ClosedBy.STOPPED
    assert auction.reason == f"stopped before the round closed: {words}"
    assert market.ends == [("s1", end)]


def test_another_agent_runs_before_challenge_opens_anew(market: MarketHarness) -> None:
    market.scene("s2")
    market.cancel("button", again=True, round_number=1)
    market.finish(outcome=3)
    assert market.status.scene_id == "s1"
    market.bid(vectors={EXPRESS: FAR})
    market.accept()
    assert market.calls[-1].scene.scene_id == "s2"
    market.finish()

    assert market.ends == [("s1", "SUCCEEDED")]


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
    market.shut_down()

    assert market.ends == [("s2", "SHUTTING_DOWN")]
    assert market.auction.reason == "stopped before the round closed: shutting down"
    market.end(outcome=3)
    assert market.ends[-1] == ("s1", "CANCELLED")
    assert market.status.state is State.IDLE, "nobody waits for feedback any more"


def test_switch_to_preempt_challenges_with_queued_scene() -> None:
    market = MarketHarness()
    market.run()
    market.scene("s2", urgent=True)
    assert len(market.calls) == 1, "without preemption it only waits"
    market.configure(on_new_scene="preempt")

    assert market.calls[-1].scene.scene_id == "s2"


def test_switch_to_queue_prevents_preemption_by_open_challenge(market: MarketHarness) -> None:
    market.scene("s2", 3.0, 5.0, 3.5)
    market.configure(on_new_scene="queue")
    assert outcome(market) is AuctionOutcome.WAITS
    assert "on_new_scene is 'queue' now" in market.auction.reason
    market.bid(round=2)

    assert (market.status.state, market.status.queued) == (State.RUNNING, 1)


def stopped_for_s2(market: MarketHarness, **first: Vector) -> tuple[str, str, str]:
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
    ("strategy", "option", "value"),
    [
        ("softmax", "temperature", 2.0),
        ("epsilon_greedy", "epsilon", 0.5),
        ("thompson", "sigma", 0.5),
    ],
)
def test_named_preempting_agent_wins_under_random_strategies(
    strategy: str, option: str, value: float
) -> None:
    stops = 0
    for skipped in range(40):
        market = with_host(
            on_new_scene="preempt", strategy=strategy, options={f"{strategy}.{option}": value}
        )
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


def test_unresponsive_running_agent_is_excluded_after_preemption(market: MarketHarness) -> None:
    ran, named, gets = stopped_for_s2(market, **{EXPRESS: (3.0, 5.0, 3.5)})
    assert (ran, named, gets, market.calls[-1].excluded) == (GUIDE, EXPRESS, EXPRESS, (GUIDE,))
    assert "its run was stopped for scene 's2'" in market.auction.explanation


@pytest.fixture
def outside() -> MarketHarness:
    """A market in which the guide runs by an external ranking."""
    market = with_host(on_new_scene="preempt", strategy="external")
    market.award()
    market.ranked(GUIDE)
    market.accept()
    return market


def test_external_ranking_cannot_preempt_agent_for_itself(outside: MarketHarness) -> None:
    outside.scene("s2", 3.25, 4.5, 3.0)
    outside.bid(round=2)
    outside.ranked(EXPRESS)
    assert outcome(outside) is AuctionOutcome.PREEMPTS
    outside.end(outcome=3)

    assert outside.calls[-1].excluded == (GUIDE,)


def test_urgent_scene_does_not_await_external_ranking(outside: MarketHarness) -> None:
    outside.scene("s2", urgent=True)
    outside.bid(round=2)

    assert outcome(outside) is AuctionOutcome.PREEMPTS
    assert [question.round for question in outside.questions] == [1]
