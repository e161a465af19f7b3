# SPDX-License-Identifier: Apache-2.0
"""Operators: pinned, vetoed and directly awarded agents."""

from __future__ import annotations

import json

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, scene
from marketplace_node.effects import AnnounceRun, SendGoal, State, StoreOverrides
from marketplace_node.hosts.host_effects import CancelGoal
from marketplace_node.operator_overrides import OperatorAction
from marketplace_node.outcomes import AuctionOutcome


def refusals(market: MarketHarness) -> dict[str, tuple[str, str]]:
    return {bid.agent: (bid.code, bid.reason) for bid in market.auction.decision.refused}


def test_only_a_pinned_agent_may_bid(market: MarketHarness) -> None:
    words = market.operate(
        OperatorAction.PIN, EXPRESS, author="anna", reason="a film crew is here"
    )
    market.scene()
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert (
        words == "only professional_express may bid from the next round on, until it is unpinned"
    )
    assert market.calls[0].excluded == (GUIDE,)
    assert market.goal.agent == EXPRESS
    said = "anna pins professional_express: a film crew is here"
    assert refusals(market) == {GUIDE: ("NOT_PINNED", said)}
    assert market.auction.decision.terms.intervention == said
    assert market.status.pinned == EXPRESS


def test_bid_against_pin_is_refused(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, EXPRESS)
    market.award()

    assert [bid.agent for bid in market.auction.decision.ranking] == [EXPRESS]
    assert {code for code, _ in refusals(market).values()} == {"NOT_PINNED"}


def test_all_agents_may_bid_after_unpin(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, EXPRESS)
    market.operate(OperatorAction.UNPIN)
    market.run()

    assert market.goal.agent == GUIDE
    assert market.auction.decision.terms.intervention == ""


def test_pin_does_not_stop_running_agent(market: MarketHarness) -> None:
    market.run()
    words = market.operate(OperatorAction.PIN, EXPRESS)

    assert words.endswith("; attentive_guide goes on until its run ends")
    assert market.status.state is State.RUNNING


def test_vetoed_agent_cannot_bid_until_allowed(market: MarketHarness) -> None:
    market.operate(OperatorAction.VETO, GUIDE, author="anna", reason="too loud")
    market.scene()
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    assert market.goal.agent == EXPRESS
    assert refusals(market) == {GUIDE: ("VETOED", "anna vetoes attentive_guide: too loud")}
    assert market.status.vetoed == (GUIDE,)

    market.perform()
    assert market.operate(OperatorAction.ALLOW, GUIDE) == (
        "attentive_guide may bid again from the next round on"
    )
    assert market.status.vetoed == ()
    market.run("s2")
    assert market.goal.agent == GUIDE


def test_veto_stops_running_agent_and_asks_others(market: MarketHarness) -> None:
    market.run()
    words = market.operate(OperatorAction.VETO, GUIDE, author="anna")
    assert words == (
        "attentive_guide may not bid; stopping attentive_guide, and asking the others"
    )
    assert market.all(AnnounceRun)[-1].stopped_by is StoppedBy.OPERATOR
    market.finish(3)
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    market.accept()

    assert market.events[-1] == "2 professional_express STARTED"
    assert market.auction.decision.terms.follows == 1
    assert market.auction.decision.terms.scene.scene_id == "s1+1"


def test_veto_before_start_reassigns_run(market: MarketHarness) -> None:
    market.award()
    goal = market.goal
    market.operate(OperatorAction.VETO, GUIDE)
    assert market.all(CancelGoal) == [CancelGoal(goal=goal)]
    market.refuse(goal)
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert market.goal.agent == EXPRESS
    assert market.ends == []


def test_veto_during_bidding_applies_at_award(market: MarketHarness) -> None:
    market.scene()
    market.operate(OperatorAction.VETO, GUIDE, author="anna")
    market.bid()

    assert market.events == ["1 attentive_guide REFUSED"]
    assert market.goal.agent == EXPRESS


def test_no_agent_wins_when_all_are_vetoed(market: MarketHarness) -> None:
    market.operate(OperatorAction.VETO, GUIDE)
    market.operate(OperatorAction.VETO, EXPRESS)
    market.scene()

    assert market.ends == [("s1", "NO_BIDS")]
    assert market.calls == []
    assert {code for code, _ in refusals(market).values()} == {"VETOED"}


def test_operator_award_beats_nearer_agents(market: MarketHarness) -> None:
    market.run()
    market.finish()
    words = market.operate(OperatorAction.AWARD, EXPRESS, author="anna", reason="she asked for it")
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert words == "professional_express gets the run for scene 's1' if it bids"
    assert market.goal.agent == EXPRESS
    said = "anna gives the run to professional_express: she asked for it"
    assert refusals(market) == {GUIDE: ("NOT_AWARDED", said)}
    assert market.auction.decision.terms.scene.vector == scene().vector


def test_operator_award_can_bring_its_own_scene(market: MarketHarness) -> None:
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("theirs", 5.0, 1.0, 3.0))
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert market.auction.decision.terms.scene.scene_id == "theirs"
    assert market.goal.agent == EXPRESS


def test_award_declined_by_its_agent_has_no_winner(market: MarketHarness) -> None:
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("s1"))
    market.bid(vectors={}, declined={EXPRESS: "needs scene.person"})

    assert market.auction.decision.outcome is AuctionOutcome.NO_BIDS
    assert market.ends == [("s1", "NO_BIDS")]


def test_any_agent_may_take_over_lost_awarded_run(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("s1"))
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    market.accept()
    market.lose()
    market.bid("/others", {PLAIN: (1.0, 1.0, 1.0)})

    assert market.goal.agent == PLAIN


def test_operator_award_queues_like_scene(market: MarketHarness) -> None:
    market.run()
    words = market.operate(OperatorAction.AWARD, EXPRESS)
    assert words.endswith("; it waits, number 1 in line: scene 's1' is under way")
    assert market.status.queued == 1
    market.finish()
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert market.goal.agent == EXPRESS


def test_operator_award_stops_run_in_preempt_mode() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.run()
    words = market.operate(OperatorAction.AWARD, EXPRESS)
    assert words.endswith(
        "; scene 's1' is under way and may be stopped for it, otherwise it waits"
    )
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)}, round=2)

    assert market.auction.decision.outcome is AuctionOutcome.PREEMPTS
    market.end(3)
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})
    assert market.goal.agent == EXPRESS


def test_duplicate_does_not_affect_awarded_scene(market: MarketHarness) -> None:
    market.run()
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("theirs"))
    market.scene("theirs")
    assert market.operate(OperatorAction.AWARD, GUIDE, scene=scene("theirs")) == "DUPLICATE"
    market.finish()
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

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
    market: MarketHarness,
    before: list[tuple[OperatorAction, str]],
    action: OperatorAction,
    agent: str,
    code: str,
) -> None:
    for first, whom in before:
        market.operate(first, whom)
    status = market.status
    assert market.operate(action, agent) == code
    assert market.status == status
    assert market.all(SendGoal) == []


def test_operator_award_is_refused_when_queue_is_full() -> None:
    market = MarketHarness(on_new_scene="reject")
    market.run()
    assert market.operate(OperatorAction.AWARD, EXPRESS) == "BUSY"
    assert market.ends == []


def test_veto_of_pinned_agent_explains_its_consequence(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, GUIDE)
    assert "nobody may bid" in market.operate(OperatorAction.VETO, GUIDE)


def test_restarted_market_keeps_pins_and_vetoes(market: MarketHarness) -> None:
    market.operate(OperatorAction.PIN, EXPRESS, author="anna")
    market.operate(OperatorAction.VETO, GUIDE, reason="too loud")
    again = MarketHarness()
    words, effects = again.market.restore_overrides(market.all(StoreOverrides)[-1].text, again.now)
    again.do(effects)

    assert words == "anna pins professional_express; the operator vetoes attentive_guide: too loud"
    assert (again.status.pinned, again.status.vetoed) == (EXPRESS, (GUIDE,))


def test_restarted_market_continues_run_counts() -> None:
    market = MarketHarness(starvation_rounds=1, strategy="ucb")
    market.run()
    again = MarketHarness(starvation_rounds=1, strategy="ucb")
    again.register()
    _, effects = again.market.restore_overrides(market.all(StoreOverrides)[-1].text, again.now)
    again.do(effects)
    assert again.status.starved == (EXPRESS,)
    again.award()

    terms = again.auction.decision.terms
    assert (terms.runs, terms.last_run) == ({GUIDE: 1}, {GUIDE: 1})
    assert (terms.rounds_run, terms.earlier_runs) == (1, 1)
    again.accept()
    assert json.loads(again.all(StoreOverrides)[-1].text)["runs"] == {GUIDE: 2}


def test_operator_award_is_named_after_original_scene(market: MarketHarness) -> None:
    market.run()
    market.finish()
    market.operate(OperatorAction.AWARD, EXPRESS)

    assert "'s1'" in market.operate(OperatorAction.AWARD, EXPRESS)


def test_veto_during_run_is_explained_once(market: MarketHarness) -> None:
    market.run()
    market.operate(OperatorAction.VETO, GUIDE, reason="too slow")
    market.finish(outcome=3)
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    lines = market.auction.explanation.splitlines()
    assert sum("attentive_guide may not bid" in line for line in lines) == 1


@pytest.mark.parametrize(
    "text",
    [
        "",
        '{"pinned": null, "vetoed": {}, "runs": {"ann": -1}}',
        '{"pinned": null, "vetoed": {}, "in_vain": [1]}',
        "{",
        "[]",
        "{}",
        '{"pinned": 1, "vetoed": {}}',
        '{"pinned": {"agent": 1, "words": ""}, "vetoed": {}}',
        '{"pinned": null, "vetoed": {"ann": 2}}',
        "[" * 100_000,
    ],
)
def test_unreadable_stored_orders_change_nothing(market: MarketHarness, text: str) -> None:
    market.operate(OperatorAction.PIN, EXPRESS)
    with pytest.raises(Refused, match=r"^MALFORMED:"):
        market.market.restore_overrides(text, market.now)
    assert market.status.pinned == EXPRESS
