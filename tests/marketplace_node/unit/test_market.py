# SPDX-License-Identifier: Apache-2.0
"""The market from a scene to its only end, on a manual clock."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.stop_cause import StoppedBy
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, registration, scene
from marketplace_node.effects import AnnounceRun, Collect, PublishAuction, State, StatusChanged
from marketplace_node.hosts.host_effects import CancelAll, CancelGoal, Connect
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy
from marketplace_node.settings import RANGES, Settings

ROOT = Path(__file__).parents[3]


@pytest.fixture
def impatient() -> MarketHarness:
    """A market that does not wait for hosts."""
    harness = MarketHarness(host_wait_s=0)
    harness.register()
    return harness


def test_interaction_passes_through_all_states(market: MarketHarness) -> None:
    market.run()
    market.wait(3.0)
    market.end()
    market.collect("moved")

    states = [effect.state for effect in market.all(StatusChanged)]
    assert list(dict.fromkeys(states)) == [
        State.IDLE,
        State.BIDDING,
        State.AWARDING,
        State.RUNNING,
        State.COLLECTING,
    ]
    assert market.events == ["1 attentive_guide STARTED", "1 attentive_guide ENDED SUCCEEDED"]
    ended = market.all(AnnounceRun)[-1]
    assert (ended.message, ended.orphans, ended.ticks) == ("done", ("tree/0.say",), 7)
    assert ended.duration_s == 3.0
    assert (ended.stopped_by, ended.stop_reason) == (StoppedBy.NOT_SAID, "")
    assert market.over == ["s1"]
    assert market.status.state is State.IDLE
    assert market.status.finished_scene_id == "s1"
    assert market.status.message == ("scene 's1' is over: attentive_guide succeeded: done; moved")
    assert (market.status.scene_id, market.status.agent, market.status.host) == ("", "", "")


def test_status_names_live_hosts_and_agents(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    assert (market.status.hosts, market.status.agents) == (2, 3)

    market.lose("/others", away_s=1.1)
    assert (market.status.hosts, market.status.agents) == (1, 2)


def test_round_closes_at_deadline_despite_silent_host(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.award()
    market.wait(0.4)
    assert market.status.state is State.BIDDING

    market.wait(0.2)
    decision = market.auction.decision
    assert decision.closed_by is ClosedBy.DEADLINE
    assert decision.duration_s == 0.5
    assert decision.silent_hosts == ("/others",)
    assert market.goal.agent == GUIDE


def test_market_reports_its_next_deadline(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    assert market.market.due == math.inf
    began = market.now
    market.scene()
    assert market.market.due == began + 0.5
    market.bid()
    market.do(market.market.tick(began + 0.4999))
    assert market.status.state is State.BIDDING
    market.now = began + 0.5
    market.do(market.market.tick(market.now))
    assert market.status.state is State.AWARDING
    assert market.market.due == market.now + market.market.settings.goal_deadline_s
    market.accept()
    assert market.market.due == math.inf
    market.end()
    assert market.market.due == market.now + market.market.settings.collect_deadline_s


def test_round_deadline_counts_from_publication(market: MarketHarness) -> None:
    effects = market.market.scene(scene(), market.now)
    market.effects += effects
    market.wait(0.4)
    market.effects += market.market.called(1, market.now)
    market.wait(0.4)
    assert market.status.state is State.BIDDING

    market.wait(0.2)
    assert market.auction.decision.closed_by is ClosedBy.DEADLINE


def test_unpublished_call_still_ends(market: MarketHarness) -> None:
    market.effects += market.market.scene(scene(), market.now)
    market.wait(1.1)

    assert market.auction.decision.outcome is AuctionOutcome.NO_BIDS
    assert market.over == ["s1"]


def test_agents_of_dead_hosts_are_not_asked(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.lose(away_s=1.1)
    market.scene()
    market.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})

    assert market.auction.decision.closed_by is ClosedBy.ALL_ANSWERED
    assert market.goal.agent == PLAIN


def test_late_response_is_noted_but_changes_nothing(market: MarketHarness) -> None:
    market.run()
    market.bid(vectors={EXPRESS: (5.0, 1.0, 3.0)})

    assert market.notes == ["bids of /agents are late: round 1 is closed"]
    assert len(market.all(PublishAuction)) == 1


@pytest.mark.parametrize("changes", [{"epoch": "x"}, {"round": 0}, {"round": 9}])
def test_bids_without_an_open_round_are_only_noted(
    market: MarketHarness, changes: dict[str, Any]
) -> None:
    market.bid(**changes)

    assert "refused" in market.notes[-1]
    assert market.all(PublishAuction) == []


def test_a_refused_goal_goes_to_the_next_best(market: MarketHarness) -> None:
    market.award()
    market.refuse()
    assert market.goal.agent == EXPRESS
    market.accept()

    assert market.events == ["1 attentive_guide REFUSED", "1 professional_express STARTED"]
    assert len(market.all(PublishAuction)) == 1
    assert market.status.agent == EXPRESS


def test_interaction_ends_when_all_hosts_refuse_run(impatient: MarketHarness) -> None:
    impatient.award()
    impatient.refuse()
    impatient.refuse()

    assert impatient.events == ["1 attentive_guide REFUSED", "1 professional_express REFUSED"]
    assert impatient.status.message == (
        "scene 's1' is over: nobody took the run: attentive_guide (busy); "
        "professional_express (busy)"
    )


def test_silent_host_loses_award_and_late_acceptance(two: MarketHarness) -> None:
    first = two.goal
    two.wait(2.1)

    assert two.goal.agent == PLAIN, "the other agent of the silent host is passed over"
    two.accept()
    cancelled = len(two.all(CancelGoal))
    two.accept(first)
    assert two.all(CancelGoal)[cancelled:] == [CancelGoal(goal=first)]
    assert two.status.state is State.RUNNING
    assert two.status.agent == PLAIN

    two.end(outcome=3, goal=first)
    assert two.status.state is State.RUNNING, "the end of an old goal ends nothing else"


def test_acceptance_after_interaction_is_cancelled(impatient: MarketHarness) -> None:
    impatient.award()
    first = impatient.goal
    impatient.wait(2.1)
    assert impatient.status.state is State.IDLE
    impatient.accept(first)

    assert impatient.effects[-1] == CancelGoal(goal=first)
    impatient.scene("s2")
    assert "took the run of round 1 too late" in impatient.auction.reason
    impatient.end(outcome=3, goal=first)
    impatient.scene("s3")
    assert impatient.status.state is State.BIDDING


def test_lost_host_triggers_round_among_remaining_hosts(two: MarketHarness) -> None:
    two.accept()
    two.lose(away_s=1.1)

    assert two.events[-1] == "1 attentive_guide ENDED LOST"
    assert "no heartbeat" in two.all(AnnounceRun)[-1].message
    assert two.all(Collect) == [], "a lost run teaches nothing"
    call = two.calls[-1]
    assert (call.round, call.scene.scene_id, call.excluded) == (2, "s1", (GUIDE,))
    two.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})
    two.accept()
    assert two.auction.decision.terms.follows == 1
    two.finish()
    assert two.over == ["s1"]


def test_returning_host_is_stopped_before_next_call(impatient: MarketHarness) -> None:
    first = impatient.run()
    impatient.lose(away_s=1.1)
    assert impatient.status.state is State.IDLE, "there was nobody else"
    assert impatient.all(CancelGoal) == [CancelGoal(goal=first)]

    impatient.busy["/agents"] = 1
    impatient.wait(1.1)
    assert impatient.all(CancelAll) == [CancelAll(host="/agents")]
    impatient.scene("s2")
    assert "has not ended" in impatient.auction.reason
    impatient.busy["/agents"] = 0
    impatient.wait(0.1)
    impatient.scene("s3")
    assert impatient.status.state is State.BIDDING


def test_restarted_host_ends_run_of_earlier_start(market: MarketHarness) -> None:
    market.run()
    market.die()
    market.now += 1.1
    market.register(instance="second")

    assert market.events[-1] == "1 attentive_guide ENDED LOST"
    assert market.all(Connect)[-1].entry.instance == "second"
    assert market.calls[-1].excluded == (GUIDE,)


def test_host_forgetting_its_run_loses_it(market: MarketHarness) -> None:
    market.run()
    market.busy["/agents"] = 0
    market.wait(0.75)
    assert market.status.state is State.RUNNING
    market.wait(0.2)

    assert market.events[-1] == "1 attentive_guide ENDED LOST"
    market.bid(vectors={EXPRESS: (1.0, 1.0, 1.0)})
    market.accept()
    assert market.status.state is State.RUNNING


def test_delayed_idle_heartbeat_does_not_end_run(market: MarketHarness) -> None:
    market.run()
    market.beat(round_number=0)
    market.wait(5.0)

    assert market.status.state is State.RUNNING


def test_host_running_for_earlier_market_is_not_asked(impatient: MarketHarness) -> None:
    impatient.beat(epoch="earlier", round_number=3)
    impatient.scene()
    assert "another market" in impatient.auction.reason

    impatient.beat()
    impatient.scene("s2")
    assert impatient.status.state is State.BIDDING


@pytest.mark.parametrize("outcome", [1, 2, 3])
def test_feedback_is_collected_after_every_ended_run(market: MarketHarness, outcome: int) -> None:
    market.run()
    market.end(outcome=outcome)
    request = market.all(Collect)[-1]

    assert (request.goal.agent, request.outcome, request.scene.scene_id) == (GUIDE, outcome, "s1")
    assert market.over == []
    market.wait(2.1)
    assert market.over == ["s1"]
    assert market.status.message.endswith("feedback is kept until the feedback node is back")


def test_unknown_outcome_counts_as_explained_failure(market: MarketHarness) -> None:
    market.run()
    market.end(outcome=77)

    assert market.events[-1] == "1 attentive_guide ENDED FAILED"
    assert "unknown outcome 77" in market.all(AnnounceRun)[-1].message


def test_registering_again_connects_only_on_change(market: MarketHarness) -> None:
    market.register()
    market.register("/agents", GUIDE)
    assert len(market.all(Connect)) == 1

    market.register(heartbeat="/agents/heartbeat_probe")
    assert len(market.all(Connect)) == 2


def test_unreachable_host_is_forgotten(market: MarketHarness) -> None:
    market.run()
    market.do(market.market.disconnect("/agents", market.now))

    assert market.events[-1] == "1 attentive_guide ENDED LOST"
    assert (market.status.hosts, market.status.state) == (0, State.IDLE)


def test_settings_apply_from_next_decision(market: MarketHarness) -> None:
    market.do(market.market.configure(Settings(tie_break="name", bid_deadline_s=3.0), market.now))
    market.scene()
    market.wait(2.9)
    assert market.status.state is State.BIDDING
    market.wait(0.2)

    assert market.auction.decision.terms.tie_break == "name"


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"strategy": "magic"}, "UNKNOWN_STRATEGY"),
        ({"shadow_strategy": "magic"}, "UNKNOWN_STRATEGY"),
        ({"shadow_strategy": "external"}, "NO_SHADOW"),
        ({"options": {"softmax.heat": 1.0}}, "UNKNOWN_OPTION"),
        ({"options": {"softmax.temperature": 0.0}}, "OUT_OF_RANGE"),
        ({"options": {"softmax.temperature": float("nan")}}, "OUT_OF_RANGE"),
        ({"starvation_rounds": -1}, "OUT_OF_RANGE"),
        ({"on_new_scene": ""}, "UNKNOWN_CHOICE"),
        ({"tie_break": "random"}, "UNKNOWN_CHOICE"),
        ({"bid_deadline_s": float("nan")}, "OUT_OF_RANGE"),
        ({"host_lease_s": 0.0}, "OUT_OF_RANGE"),
        ({"queue_limit": 101}, "OUT_OF_RANGE"),
        ({"on_new_scene": "refuse"}, "UNKNOWN_CHOICE"),
        ({"preempt_margin": -0.1}, "OUT_OF_RANGE"),
        ({"preempt_margin": float("nan")}, "OUT_OF_RANGE"),
        ({"preempt_cooldown_s": 601.0}, "OUT_OF_RANGE"),
    ],
)
def test_invalid_settings_are_refused(changes: dict[str, Any], code: str) -> None:
    with pytest.raises(Refused, match=f"^{code}:"):
        Settings(**changes)


def test_refused_registration_changes_nothing(market: MarketHarness) -> None:
    request = registration("/strangers", parameters=("age",))
    answer, effects = market.market.register(request, market.now)

    assert not answer.accepted
    assert effects == []


def test_market_document_lists_settings_with_defaults_and_ranges() -> None:
    text = (ROOT / "docs" / "market.md").read_text()
    rows = [
        line.split("|")[1:-1]
        for line in text.partition("## Settings")[2].partition("\n## ")[0].splitlines()
    ]
    told = {
        name.strip(" `"): (value.strip(" `"), span.strip())
        for name, value, span, _ in (row for row in rows if row)
    }
    settings = dataclasses.asdict(Settings())
    assert settings.pop("options") == {}, "each strategy tells of its own"
    for name, default in settings.items():
        value, span = told[name.removesuffix("_s")]
        if name.endswith("_s"):
            least, most = RANGES[name]
            assert (value, span) == (f"{default:g} s", f"{least:g} to {most:g} s"), name
        else:
            assert value == str(default), name
