# SPDX-License-Identifier: Apache-2.0
"""Operators: pinned, vetoed and directly awarded agents, and previews without side effects."""

from __future__ import annotations

import json

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, scene, with_host
from marketplace_node.effects import AnnounceRun, PublishAuction, SendGoal, State, StoreOverrides
from marketplace_node.hosts.host_effects import CancelGoal
from marketplace_node.market_state import PREVIEWS
from marketplace_node.operator_overrides import OperatorAction
from marketplace_node.operators import MOST_PREVIEWS
from marketplace_node.outcomes import AuctionOutcome

Order = tuple[OperatorAction, str]
EXPRESS_BID = {EXPRESS: (3.0, 5.0, 3.5)}


def refusals(market: MarketHarness) -> dict[str, tuple[str, str]]:
    return {bid.agent: (bid.code, bid.reason) for bid in market.auction.decision.refused}


def test_only_a_pinned_agent_may_bid(market: MarketHarness) -> None:
    words = market.operate(
        OperatorAction.PIN, EXPRESS, author="anna", reason="a film crew is here"
    )
    market.scene()
    market.bid(vectors=EXPRESS_BID)

    assert (
        words == "only professional_express may bid from the next round on, until it is unpinned"
    )
    assert (market.calls[0].excluded, market.goal.agent) == ((GUIDE,), EXPRESS)
    said = "anna pins professional_express: a film crew is here"
    assert refusals(market) == {GUIDE: ("NOT_PINNED", said)}
    assert (market.auction.decision.terms.intervention, market.status.pinned) == (said, EXPRESS)
    market.perform()
    market.award("s2")
    assert [bid.agent for bid in market.auction.decision.ranking] == [EXPRESS]
    assert {code for code, _ in refusals(market).values()} == {"NOT_PINNED"}


def test_all_agents_may_bid_after_unpin(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, EXPRESS)
    market.operate(OperatorAction.UNPIN)
    market.run()

    assert (market.goal.agent, market.auction.decision.terms.intervention) == (GUIDE, "")


def test_pin_does_not_stop_running_agent(running: MarketHarness) -> None:
    words = running.operate(OperatorAction.PIN, EXPRESS)

    assert words.endswith("; attentive_guide goes on until its run ends")
    assert running.status.state is State.RUNNING


def test_vetoed_agent_cannot_bid_until_allowed(market: MarketHarness) -> None:
    market.operate(OperatorAction.VETO, GUIDE, author="anna", reason="too loud")
    market.scene()
    market.bid(vectors=EXPRESS_BID)
    assert market.goal.agent == EXPRESS
    assert refusals(market) == {GUIDE: ("VETOED", "anna vetoes attentive_guide: too loud")}
    assert market.status.vetoed == (GUIDE,)

    market.perform()
    answer = market.operate(OperatorAction.ALLOW, GUIDE)
    assert answer == "attentive_guide may bid again from the next round on"
    assert market.status.vetoed == ()
    market.run("s2")
    assert market.goal.agent == GUIDE


def test_veto_stops_running_agent_and_asks_others(running: MarketHarness) -> None:
    assert running.operate(OperatorAction.VETO, GUIDE, author="anna") == (
        "attentive_guide may not bid; stopping attentive_guide, and asking the others"
    )
    assert running.all(AnnounceRun)[-1].stopped_by is StoppedBy.OPERATOR
    running.finish(3)
    running.bid(vectors=EXPRESS_BID)
    running.accept()

    assert running.events[-1] == "2 professional_express STARTED"
    terms = running.auction.decision.terms
    assert (terms.follows, terms.scene.scene_id) == (1, "s1+1")
    assert running.auction.explanation.count("attentive_guide may not bid") == 1


def test_veto_before_start_reassigns_run(market: MarketHarness) -> None:
    market.award()
    goal = market.goal
    market.operate(OperatorAction.VETO, GUIDE)
    assert market.all(CancelGoal) == [CancelGoal(goal=goal)]
    market.refuse(goal)
    market.bid(vectors=EXPRESS_BID)

    assert (market.goal.agent, market.ends) == (EXPRESS, [])


def test_veto_during_bidding_applies_at_award(market: MarketHarness) -> None:
    market.scene()
    market.operate(OperatorAction.VETO, GUIDE, author="anna")
    market.bid()

    assert (market.events, market.goal.agent) == (["1 attentive_guide REFUSED"], EXPRESS)


def test_no_agent_wins_when_all_are_vetoed(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, EXPRESS)
    market.operate(OperatorAction.VETO, GUIDE)
    assert "nobody may bid" in market.operate(OperatorAction.VETO, EXPRESS)
    market.scene()

    assert (market.ends, market.calls) == ([("s1", "NO_BIDS")], [])
    assert {code for code, _ in refusals(market).values()} == {"VETOED"}


def test_operator_award_beats_nearer_agents(running: MarketHarness) -> None:
    running.finish()
    words = running.operate(
        OperatorAction.AWARD, EXPRESS, author="anna", reason="she asked for it"
    )
    running.bid(vectors=EXPRESS_BID)

    assert words == "professional_express gets the run for scene 's1' if it bids"
    assert running.goal.agent == EXPRESS
    said = "anna gives the run to professional_express: she asked for it"
    assert refusals(running) == {GUIDE: ("NOT_AWARDED", said)}
    assert running.auction.decision.terms.scene.vector == scene().vector
    assert "'s1'" in running.operate(OperatorAction.AWARD, EXPRESS), "named after the first scene"


def test_any_agent_may_take_over_lost_awarded_run(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("s1"))
    market.bid(vectors=EXPRESS_BID)
    market.accept()
    market.lose()
    market.bid("/others", {PLAIN: (1.0, 1.0, 1.0)})

    assert market.goal.agent == PLAIN


def test_operator_award_queues_like_scene(running: MarketHarness) -> None:
    words = running.operate(OperatorAction.AWARD, EXPRESS, scene=scene("theirs"))
    assert words.endswith("; it waits, number 1 in line: scene 's1' is under way")
    assert running.status.queued == 1
    running.scene("theirs")
    assert running.operate(OperatorAction.AWARD, GUIDE, scene=scene("theirs")) == "DUPLICATE"
    running.finish()
    running.bid(vectors=EXPRESS_BID)

    assert running.goal.agent == EXPRESS, "a duplicate does not affect it"


def test_operator_award_stops_run_in_preempt_mode() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.run()
    words = market.operate(OperatorAction.AWARD, EXPRESS)
    assert words.endswith(
        "; scene 's1' is under way and may be stopped for it, otherwise it waits"
    )
    market.bid(vectors=EXPRESS_BID, round=2)

    assert market.auction.decision.outcome is AuctionOutcome.PREEMPTS
    market.end(3)
    market.bid(vectors=EXPRESS_BID)
    assert market.goal.agent == EXPRESS


@pytest.mark.parametrize(
    ("before", "action", "agent", "code"),
    [
        ([], OperatorAction.PIN, "guide", "UNKNOWN_AGENT"),
        ([], OperatorAction.VETO, "", "UNKNOWN_AGENT"),
        ([], OperatorAction.AWARD, "guide", "UNKNOWN_AGENT"),
        ([], OperatorAction.UNPIN, "", "NOT_PINNED"),
        ([], OperatorAction.ALLOW, GUIDE, "NOT_VETOED"),
        ([], OperatorAction.AWARD, GUIDE, "NO_SCENE"),
        ([(OperatorAction.VETO, GUIDE)], OperatorAction.PIN, GUIDE, "VETOED"),
        ([(OperatorAction.VETO, GUIDE)], OperatorAction.AWARD, GUIDE, "VETOED"),
        ([(OperatorAction.PIN, EXPRESS)], OperatorAction.AWARD, GUIDE, "NOT_PINNED"),
    ],
)
def test_impossible_operator_action_is_refused_without_effect(
    market: MarketHarness, before: list[Order], action: OperatorAction, agent: str, code: str
) -> None:
    for first, whom in before:
        market.operate(first, whom)
    status = market.status
    assert market.operate(action, agent) == code
    assert (market.status, market.all(SendGoal)) == (status, [])


def test_operator_award_is_refused_when_queue_is_full() -> None:
    market = MarketHarness(on_new_scene="reject")
    market.run()
    assert market.operate(OperatorAction.AWARD, EXPRESS) == "BUSY"
    assert market.ends == []


def restarted(market: MarketHarness, again: MarketHarness) -> str:
    """Restore the stored orders and counts in the next market; return the orders in words."""
    words, effects = again.market.restore_overrides(market.all(StoreOverrides)[-1].text, again.now)
    again.do(effects)
    return words


def test_restarted_market_keeps_pins_and_vetoes(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, EXPRESS, author="anna")
    market.operate(OperatorAction.VETO, GUIDE, reason="too loud")
    again = MarketHarness()

    assert restarted(market, again) == (
        "anna pins professional_express; the operator vetoes attentive_guide: too loud"
    )
    assert (again.status.pinned, again.status.vetoed) == (EXPRESS, (GUIDE,))


def test_restarted_market_continues_run_counts(running: MarketHarness) -> None:
    again = with_host(starvation_rounds=1, strategy="ucb")
    restarted(running, again)
    assert again.status.starved == (EXPRESS,)
    again.award()

    terms = again.auction.decision.terms
    assert (terms.runs, terms.last_run) == ({GUIDE: 1}, {GUIDE: 1})
    assert (terms.rounds_run, terms.earlier_runs) == (1, 1)
    again.accept()
    assert json.loads(again.all(StoreOverrides)[-1].text)["runs"] == {GUIDE: 2}


@pytest.mark.parametrize(
    "text",
    [
        "",
        '{"pinned": null, "vetoed": {}, "runs": {"ann": -1}}',
        '{"pinned": null, "vetoed": {}, "in_vain": [1]}',
        "[]",
        "{}",
        '{"pinned": 1, "vetoed": {}}',
        '{"pinned": {"agent": 1, "words": ""}, "vetoed": {}}',
        "[" * 100_000,
    ],
)
def test_unreadable_stored_orders_change_nothing(market: MarketHarness, text: str) -> None:
    market.operate(OperatorAction.PIN, EXPRESS)
    with pytest.raises(Refused, match=r"^MALFORMED:"):
        market.market.restore_overrides(text, market.now)
    assert market.status.pinned == EXPRESS


# Previews: the winner, without any side effect
def previewed(market: MarketHarness) -> PublishAuction:
    ended = market.previews[-1].outcome
    assert isinstance(ended, PublishAuction), ended
    return ended


def test_preview_ranks_real_bids_without_awarding(market: MarketHarness) -> None:
    number = market.preview(strategy="euclidean")
    market.bid(round=number)

    assert number == PREVIEWS + 1
    decision = previewed(market).decision
    assert [bid.agent for bid in decision.ranking] == [GUIDE, EXPRESS]
    assert (decision.terms.preview, decision.terms.strategy) == (True, "euclidean")
    assert (market.all(SendGoal), market.all(PublishAuction)) == ([], [])
    assert (market.status.state, market.status.strategy) == (State.IDLE, "manhattan")


def test_preview_changes_no_counters(running: MarketHarness) -> None:
    running.finish()
    for _ in range(3):
        running.bid(round=running.preview())
    running.run("s2")

    terms = running.auction.decision.terms
    assert (terms.round, terms.rounds_run, dict(terms.runs)) == (2, 1, {GUIDE: 1})


def test_preview_predicts_random_draws() -> None:
    market = with_host(strategy="softmax", options={"softmax.temperature": 5.0})
    for number in range(12):
        market.bid(round=market.preview())
        foretold = [bid.agent for bid in previewed(market).decision.ranking]
        market.award(f"s{number}")
        assert [bid.agent for bid in market.auction.decision.ranking] == foretold
        market.perform()
    winners = {publish.decision.ranking[0].agent for publish in market.all(PublishAuction)}
    assert winners == {GUIDE, EXPRESS}, "chance has to have a say in this test"


def test_preview_does_not_disturb_run(running: MarketHarness) -> None:
    running.bid(round=running.preview(3.0, 5.0, 3.5))

    assert previewed(running).decision.ranking[0].agent == EXPRESS
    assert running.events == ["1 attentive_guide STARTED"]
    running.bid(round=running.preview(last=True))
    assert previewed(running).decision.terms.scene.scene_id == "s1"


def test_preview_respects_pins_and_vetoes(market: MarketHarness) -> None:
    market.operate(OperatorAction.VETO, GUIDE)
    market.bid(round=market.preview())

    assert [bid.agent for bid in previewed(market).decision.ranking] == [EXPRESS]


def test_preview_waits_for_external_ranking(market: MarketHarness) -> None:
    market.bid(round=market.preview(strategy="external"))
    assert market.previews == []
    market.ranked(EXPRESS)

    assert previewed(market).decision.ranking[0].agent == EXPRESS


def test_late_or_foreign_preview_bids_change_nothing(market: MarketHarness) -> None:
    market.scene()
    number = market.preview()
    market.bid(round=number, vectors={EXPRESS: (5.0, 1.0, 3.0)}, declined={GUIDE: "tired"})
    before = list(market.previews)
    market.bid(round=number)

    assert market.previews == before
    market.bid(round=1)
    assert market.goal.agent == GUIDE, "bids for a preview never enter the round"
    for other in (number + 1, PREVIEWS):
        market.bid(round=other)
    assert (market.previews, len(market.all(SendGoal))) == (before, 1)


@pytest.mark.parametrize(
    ("strategy", "last", "code"), [("magic", False, "UNKNOWN_STRATEGY"), ("", True, "NO_SCENE")]
)
def test_invalid_preview_is_refused(
    market: MarketHarness, strategy: str, last: bool, code: str
) -> None:
    with pytest.raises(Refused, match=f"^{code}:"):
        market.preview(strategy=strategy, last=last)


def test_concurrent_previews_are_limited(market: MarketHarness) -> None:
    for _ in range(MOST_PREVIEWS):
        market.preview()
    with pytest.raises(Refused, match=r"^BUSY:"):
        market.preview()

    market.wait(0.6)
    assert len(market.previews) == MOST_PREVIEWS
    decision = previewed(market).decision
    assert (decision.ranking, decision.silent_hosts) == ((), ("/agents",))
    market.preview()


def test_market_shutdown_ends_every_preview(market: MarketHarness) -> None:
    market.preview()
    market.shut_down()

    [ended] = market.previews
    assert isinstance(ended.outcome, Refused)
    assert ended.outcome.code == "SHUTTING_DOWN"
    with pytest.raises(Refused):
        market.preview()
