# SPDX-License-Identifier: Apache-2.0
"""The market from a scene to its only end, on a manual clock."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest

from bt_agents.engine.run import RunLimits
from bt_agents_core.errors import Refused
from bt_agents_core.health import Health
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_language.model.specs import MOST_CLEAN_UP_S
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, scene
from marketplace_node.effects import (
    AnnounceRun,
    Collect,
    PublishAuction,
    SceneEnded,
    State,
    StatusChanged,
)
from marketplace_node.health import hosts_health, queue_health
from marketplace_node.hosts.host_effects import CancelAll, CancelGoal, Connect
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy
from marketplace_node.settings import RANGES, Settings

ROOT = Path(__file__).parents[3]


def test_interaction_passes_through_all_states(running: MarketHarness) -> None:
    running.wait(3.0)
    running.end()
    running.collect("moved")

    states = dict.fromkeys(effect.state.name for effect in running.all(StatusChanged))
    assert " ".join(states) == "IDLE BIDDING AWARDING RUNNING COLLECTING"
    assert running.events == ["1 attentive_guide STARTED", "1 attentive_guide ENDED SUCCEEDED"]
    ended = running.all(AnnounceRun)[-1]
    assert (ended.message, ended.orphans, ended.ticks) == ("done", ("tree/0.say",), 7)
    assert (ended.duration_s, ended.stopped_by, ended.stop_reason) == (3.0, StoppedBy.NOT_SAID, "")
    status = running.status
    assert (status.state, status.finished_scene_id) == (State.IDLE, "s1")
    assert status.message == "scene 's1' is over: attentive_guide succeeded: done; moved"
    assert (status.scene_id, status.agent, status.host) == ("", "", "")


def test_dead_host_is_neither_counted_nor_asked(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    assert (market.status.hosts, market.status.agents) == (2, 3)
    market.lose(away_s=1.1)
    assert (market.status.hosts, market.status.agents) == (1, 1)
    market.scene()
    market.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})

    assert (market.auction.decision.closed_by, market.goal.agent) == (ClosedBy.ALL_ANSWERED, PLAIN)


def test_round_closes_at_its_deadline_despite_silent_host(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    assert market.market.due == math.inf
    began = market.now
    market.award()
    assert market.market.due == began + 0.5
    market.do(market.market.tick(began + 0.4999))
    assert market.status.state is State.BIDDING
    market.now = began + 0.5
    market.do(market.market.tick(market.now))
    decision = market.auction.decision
    assert (decision.closed_by, decision.duration_s) == (ClosedBy.DEADLINE, 0.5)
    assert decision.silent_hosts == ("/others",)
    assert (market.status.state, market.goal.agent) == (State.AWARDING, GUIDE)
    assert market.market.due == market.now + market.market.settings.goal_deadline_s
    market.accept()
    assert market.market.due == math.inf
    market.end()
    assert market.market.due == market.now + market.market.settings.collect_deadline_s


def test_round_deadline_counts_from_publication(market: MarketHarness) -> None:
    market.effects += market.market.scene(scene(), market.now)
    market.wait(0.4)
    market.effects += market.market.called(1, market.now)
    market.wait(0.4)
    assert market.status.state is State.BIDDING

    market.wait(0.2)
    assert market.auction.decision.closed_by is ClosedBy.DEADLINE


def test_unpublished_call_still_ends(market: MarketHarness) -> None:
    market.effects += market.market.scene(scene(), market.now)
    market.wait(1.1)

    assert (market.auction.decision.outcome, market.over) == (AuctionOutcome.NO_BIDS, ["s1"])


@pytest.mark.parametrize("changes", [{"epoch": "x"}, {"round": 0}, {"round": 9}])
def test_bids_without_open_round_are_noted(market: MarketHarness, changes: dict[str, Any]) -> None:
    market.bid(**changes)

    assert "refused" in market.notes[-1]
    assert market.all(PublishAuction) == []


def test_silent_host_loses_award_and_late_acceptance(two: MarketHarness) -> None:
    first = two.goal
    two.wait(2.1)

    assert two.goal.agent == PLAIN, "the other agent of the silent host is passed over"
    two.accept()
    cancelled = len(two.all(CancelGoal))
    two.accept(first)
    assert two.all(CancelGoal)[cancelled:] == [CancelGoal(goal=first)]
    two.end(outcome=3, goal=first)
    assert two.status.state is State.RUNNING, "the end of an old goal ends nothing else"
    assert two.status.agent == PLAIN


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


def test_restarted_host_ends_run_of_earlier_start(running: MarketHarness) -> None:
    running.die()
    running.now += 1.1
    running.register(instance="second")

    assert running.events[-1] == "1 attentive_guide ENDED LOST"
    assert running.all(Connect)[-1].entry.instance == "second"
    assert running.calls[-1].excluded == (GUIDE,)


def test_host_forgetting_its_run_loses_it(running: MarketHarness) -> None:
    running.busy["/agents"] = 0
    running.wait(0.75)
    assert running.status.state is State.RUNNING
    running.wait(0.2)

    assert running.events[-1] == "1 attentive_guide ENDED LOST"
    running.bid(vectors={EXPRESS: (1.0, 1.0, 1.0)})
    running.accept()
    assert running.status.state is State.RUNNING


def test_delayed_idle_heartbeat_does_not_end_run(running: MarketHarness) -> None:
    running.beat(round_number=0)
    running.wait(5.0)

    assert running.status.state is State.RUNNING


@pytest.mark.parametrize("outcome", [1, 2, 3])
def test_feedback_is_collected_after_every_ended_run(running: MarketHarness, outcome: int) -> None:
    running.end(outcome=outcome)
    request = running.all(Collect)[-1]

    assert (request.goal.agent, request.outcome, request.scene.scene_id) == (GUIDE, outcome, "s1")
    assert running.over == []
    running.wait(2.1)
    assert running.over == ["s1"]
    assert running.status.message.endswith("feedback is kept until the feedback node is back")


def test_unknown_outcome_counts_as_explained_failure(running: MarketHarness) -> None:
    running.end(outcome=77)

    assert running.events[-1] == "1 attentive_guide ENDED FAILED"
    assert "unknown outcome 77" in running.all(AnnounceRun)[-1].message


def test_registering_again_connects_only_on_change(market: MarketHarness) -> None:
    market.register()
    market.register("/agents", GUIDE)
    assert len(market.all(Connect)) == 1

    market.register(heartbeat="/agents/heartbeat_probe")
    assert len(market.all(Connect)) == 2


def test_unreachable_host_is_forgotten(running: MarketHarness) -> None:
    running.do(running.market.disconnect("/agents", running.now))

    assert running.events[-1] == "1 attentive_guide ENDED LOST"
    assert (running.status.hosts, running.status.state) == (0, State.IDLE)


# Ends of scenes


BID, ACCEPT, REFUSE, STOP = ("bid",), ("accept",), ("refuse",), ("cancel",)
AGAIN = ("cancel", "enough", True)
DECLINE = ("bid", "/agents", {}, {GUIDE: "is tired", EXPRESS: "is tired"})


@pytest.mark.parametrize(
    ("steps", "code", "number", "agent", "words"),
    [
        ([DECLINE], "NO_BIDS", 1, "", "nobody bids: "),
        ([BID, REFUSE, REFUSE], "NOT_TAKEN", 1, "", f"run: {GUIDE} (busy); {EXPRESS} (busy)"),
        ([BID, ACCEPT, ("finish", 1)], "SUCCEEDED", 1, GUIDE, "attentive_guide succeeded: "),
        ([BID, ACCEPT, ("finish", 2)], "FAILED", 1, GUIDE, "attentive_guide failed: "),
        ([BID, ACCEPT, ("finish", 3)], "CANCELLED", 1, GUIDE, "attentive_guide cancelled: "),
        ([BID, ACCEPT, ("lose",)], "LOST", 2, GUIDE, ""),
        ([STOP], "STOPPED", 1, "", "stopped before the round closed: enough"),
        ([AGAIN], "STOPPED", 1, "", "stopped before the round closed: enough"),
        ([BID, STOP, ACCEPT, ("end", 3)], "STOPPED", 1, "", ""),
        ([BID, ACCEPT, STOP, ("finish", 3)], "CANCELLED", 1, GUIDE, "cancelled: enough"),
        ([BID, ACCEPT, AGAIN, ("finish", 3), DECLINE], "CANCELLED", 2, GUIDE, ""),
        ([("shut_down",)], "SHUTTING_DOWN", 1, "", ""),
    ],
)
def test_every_scene_has_exactly_one_end(
    impatient: MarketHarness, steps: list[Any], code: str, number: int, agent: str, words: str
) -> None:
    impatient.scene()
    for step, *values in steps:
        getattr(impatient, step)(*values)

    (end,) = impatient.all(SceneEnded)
    assert (end.scene_id, end.code, end.round, end.agent) == ("s1", code, number, agent)
    assert end.message
    assert words in end.message
    assert impatient.status.state is State.IDLE


def test_unreadable_scene_ends_only_with_an_id() -> None:
    market = MarketHarness()
    for scene_id in ("", "bad"):
        market.do(
            market.market.malformed(scene_id, Refused("NOT_FINITE", "age is nan"), market.now)
        )

    assert market.notes == ["NOT_FINITE: age is nan; no end is announced"]
    assert market.all(SceneEnded) == [
        SceneEnded(scene_id="bad", code="NOT_FINITE", message="age is nan")
    ]


def test_late_host_never_runs_reassigned_goal(two: MarketHarness) -> None:
    first = two.goal
    two.lose(away_s=0.9)
    assert two.goal.agent == PLAIN
    assert two.all(CancelGoal) == [CancelGoal(goal=first)], "it finds the cancel beside the goal"
    two.busy["/agents"] = 0
    two.beat("/agents")
    two.accept(first)
    assert two.effects[-1] == CancelGoal(goal=first)
    two.end(outcome=3, goal=first)
    state = (two.status.state, two.status.agent)
    assert state == (State.AWARDING, PLAIN), "the end of the old goal ends nothing else"


# A stalled market reads queued messages before it acts on a deadline.


def hold_up(market: MarketHarness, lasted_s: float) -> None:
    """Let time pass without the market; then it reads the queued messages."""
    market.stall(lasted_s)
    market.do(market.market.tick(market.now))


def test_messages_received_during_stall_count(market: MarketHarness) -> None:
    market.scene()
    hold_up(market, 3.0)
    assert market.status.state is State.BIDDING
    market.bid()
    hold_up(market, 5.0)
    market.accept()

    assert market.events == ["1 attentive_guide STARTED"]


def test_result_after_idle_heartbeat_counts(running: MarketHarness) -> None:
    running.busy["/agents"] = 0
    running.beat()
    hold_up(running, 3.0)
    running.end()

    assert running.events[-1] == "1 attentive_guide ENDED SUCCEEDED"
    assert len(running.calls) == 1, "nobody is served twice"


def test_run_cancelled_during_stall_is_not_lost(running: MarketHarness) -> None:
    running.cancel()
    hold_up(running, 20.0)
    running.end(outcome=3)

    assert running.events[-1] == "1 attentive_guide ENDED CANCELLED"


def test_challenge_bids_received_during_stall_count() -> None:
    market = MarketHarness(on_new_scene="preempt")
    market.run()
    market.scene("s2", 3.0, 5.0, 3.5)
    hold_up(market, 3.0)
    market.bid(round=2)

    assert market.auction.decision.outcome is AuctionOutcome.PREEMPTS


def test_deadlines_still_expire_after_stall(market: MarketHarness) -> None:
    market.scene()
    hold_up(market, 3.0)
    market.wait(0.6)

    assert market.ends == [("s1", "NO_BIDS")]


def test_cancel_deadline_exceeds_slowest_run_end() -> None:
    limits, slowest_tick_s = RunLimits(), 1.0

    needed_s = limits.explain_s + MOST_CLEAN_UP_S + limits.settle_s + slowest_tick_s
    assert Settings().cancel_deadline_s > needed_s


def test_lost_run_is_announced_after_stall_extension(two: MarketHarness) -> None:
    two.accept()
    two.die()
    hold_up(two, 5.0)
    assert two.status.state is State.RUNNING, "nobody has listened to its heartbeats"
    two.now += 0.5
    two.do(two.market.tick(two.now))
    assert two.events[-1] == "1 attentive_guide ENDED LOST"


def test_deferred_feedback_delays_no_scene(running: MarketHarness) -> None:
    running.scene("s2")
    running.end()
    assert running.status.state is State.COLLECTING
    running.do(running.market.feedback_deferred(1, running.now))

    assert running.ends == [("s1", "SUCCEEDED")]
    assert running.end_words.endswith("feedback is kept until the feedback node is back")
    assert (running.status.scene_id, running.status.state) == ("s2", State.BIDDING)


# Health


def test_hosts_health_names_silent_hosts() -> None:
    none = hosts_health({}, {})
    assert (none.part, none.level) == ("hosts", Health.WARN)
    assert none.message == "no host has registered, so nobody bids"
    agents = {"/agents": 9, "/others": 5}
    good = hosts_health(agents, {})
    assert (good.level, good.message) == (Health.OK, "hosts: 2, agents: 14")
    assert good.values == {"/agents": "9 agents", "/others": "5 agents"}
    bad = hosts_health(agents, {"/others": "it has no heartbeat"})
    assert bad.level is Health.ERROR
    assert bad.message == "1 of 2 hosts cannot be asked: /others (it has no heartbeat)"
    assert bad.values == {"/agents": "9 agents", "/others": "it has no heartbeat"}


def test_queued_scenes_warn_only_when_awaiting_host() -> None:
    assert queue_health(3, ()).level is Health.OK
    waiting = queue_health(2, ["/agents"])
    assert (waiting.level, waiting.message) == (Health.WARN, "scenes in line: 2, for /agents")


def test_settings_apply_from_next_decision(market: MarketHarness) -> None:
    market.configure(tie_break="name", bid_deadline_s=3.0)
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
        ({"tie_break": "random"}, "UNKNOWN_CHOICE"),
        ({"bid_deadline_s": float("nan")}, "OUT_OF_RANGE"),
        ({"host_lease_s": 0.0}, "OUT_OF_RANGE"),
        ({"queue_limit": 101}, "OUT_OF_RANGE"),
        ({"on_new_scene": "refuse"}, "UNKNOWN_CHOICE"),
    ],
)
def test_invalid_settings_are_refused(changes: dict[str, Any], code: str) -> None:
    with pytest.raises(Refused, match=f"^{code}:"):
        Settings(**changes)


def test_market_document_lists_settings_with_defaults_and_ranges() -> None:
    text = (ROOT / "docs" / "market.md").read_text()
    section = text.partition("## Settings")[2].partition("\n## ")[0]
    rows = [[cell.strip(" `") for cell in line.split("|")] for line in section.splitlines()]
    told = {row[1]: (row[2], row[3]) for row in rows if len(row) > 3}
    settings = dataclasses.asdict(Settings())
    assert settings.pop("options") == {}, "each strategy tells of its own"
    for name, default in settings.items():
        value, span = told[name.removesuffix("_s")]
        if name.endswith("_s"):
            least, most = RANGES[name]
            assert (value, span) == (f"{default:g} s", f"{least:g} to {most:g} s"), name
        else:
            assert value == str(default), name
