# SPDX-License-Identifier: Apache-2.0
"""Ends of scenes with their codes, and hosts that die around an award."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bt_agents_core.errors import Refused
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness
from marketplace_node.effects import AnnounceRun as Announced
from marketplace_node.effects import SceneEnded, State
from marketplace_node.hosts.host_effects import CancelGoal
from marketplace_node.outcomes import RunEventKind


def nobody(market: MarketHarness) -> None:
    market.bid(vectors={}, declined=dict.fromkeys((GUIDE, EXPRESS), "is tired"))


def refused(market: MarketHarness) -> None:
    market.bid()
    market.refuse()
    market.refuse()


def run_to(outcome: int) -> Callable[[MarketHarness], None]:
    def play(market: MarketHarness) -> None:
        market.bid()
        market.accept()
        market.finish(outcome=outcome)

    return play


def lost(market: MarketHarness) -> None:
    market.bid()
    market.accept()
    market.lose()


def stopped_while_bidding(market: MarketHarness) -> None:
    market.cancel()


def stopped_while_awarding(market: MarketHarness) -> None:
    market.bid()
    market.cancel()
    market.accept()
    market.end(outcome=3)


def stopped_while_running(market: MarketHarness) -> None:
    market.bid()
    market.accept()
    market.cancel()
    market.finish(outcome=3)


def stopped_without_a_follower(market: MarketHarness) -> None:
    market.bid()
    market.accept()
    market.cancel(again=True)
    market.finish(outcome=3)
    market.bid(vectors={}, declined={EXPRESS: "is tired"})


def shut_while_bidding(market: MarketHarness) -> None:
    market.do(market.market.shut_down("shutting down", market.now))


@pytest.mark.parametrize(
    ("play", "code", "round_number", "agent"),
    [
        (nobody, "NO_BIDS", 1, ""),
        (refused, "NOT_TAKEN", 1, ""),
        (run_to(1), "SUCCEEDED", 1, GUIDE),
        (run_to(2), "FAILED", 1, GUIDE),
        (run_to(3), "CANCELLED", 1, GUIDE),
        (lost, "LOST", 2, GUIDE),
        (stopped_while_bidding, "STOPPED", 1, ""),
        (stopped_while_awarding, "STOPPED", 1, ""),
        (stopped_while_running, "CANCELLED", 1, GUIDE),
        (stopped_without_a_follower, "CANCELLED", 2, GUIDE),
        (shut_while_bidding, "SHUTTING_DOWN", 1, ""),
    ],
)
def test_every_scene_has_exactly_one_end(
    play: Callable[[MarketHarness], None], code: str, round_number: int, agent: str
) -> None:
    market = MarketHarness(host_wait_s=0)
    market.register()
    market.scene()
    play(market)

    (end,) = market.all(SceneEnded)
    assert (end.scene_id, end.code, end.round, end.agent) == ("s1", code, round_number, agent)
    assert end.message
    assert market.status.state is State.IDLE


def test_unreadable_scene_ends_with_its_refusal_code() -> None:
    market = MarketHarness()
    market.do(market.market.malformed("bad", Refused("NOT_FINITE", "age is nan"), market.now))

    assert market.all(SceneEnded) == [
        SceneEnded(scene_id="bad", code="NOT_FINITE", message="age is nan")
    ]


def test_scene_without_id_is_noted_without_end() -> None:
    market = MarketHarness()
    market.do(market.market.malformed("", Refused("EMPTY", "scene: no scene_id"), market.now))

    assert market.all(SceneEnded) == []
    assert market.notes == ["EMPTY: scene: no scene_id; no end is announced"]


def test_dead_host_promptly_loses_goal_to_next_best(two: MarketHarness) -> None:
    two.wait(0.125)
    two.die()
    died = two.now
    while two.goal.agent != PLAIN:
        two.wait(1 / 16)
    assert two.now - died < 1.0
    assert two.events == ["1 attentive_guide REFUSED", "1 professional_express REFUSED"]
    two.accept()

    starts = [run.goal.agent for run in two.all(Announced) if run.event is RunEventKind.STARTED]
    assert starts == [PLAIN]


@pytest.mark.parametrize("when", ["before", "during", "after"])
def test_late_host_never_runs_reassigned_goal(two: MarketHarness, when: str) -> None:
    first = two.goal
    two.lose(away_s=0.9)
    second = two.goal
    assert second.agent == PLAIN
    assert two.all(CancelGoal) == [CancelGoal(goal=first)], "it finds the cancel beside the goal"
    if when != "before":
        two.accept(second)
    if when == "after":
        two.finish(goal=second)
    two.busy["/agents"] = 0
    two.beat("/agents")
    two.accept(first)

    assert two.effects[-1] == CancelGoal(goal=first)
    starts = [run.goal for run in two.all(Announced) if run.event is RunEventKind.STARTED]
    assert starts == ([] if when == "before" else [second])
    two.scene("s2")
    two.end(outcome=3, goal=first)
    if when == "before":
        assert two.goal == second, "the end of the old goal takes nothing from the new one"


def test_restarted_host_does_not_receive_earlier_goal(two: MarketHarness) -> None:
    two.lose(away_s=0.9)
    two.register(instance="second")
    two.accept()

    assert two.status.agent == PLAIN
    assert [run.goal.agent for run in two.all(Announced)][-1] == PLAIN


def test_host_death_during_run_is_noticed_promptly(two: MarketHarness) -> None:
    two.accept()
    two.wait(0.125)
    two.die()
    died = two.now
    while two.events[-1] != "1 attentive_guide ENDED LOST":
        two.wait(1 / 16)

    assert two.now - died < 1.0


def test_lost_run_is_announced_after_stall_extension(two: MarketHarness) -> None:
    two.accept()
    two.die()
    two.stall(5.0)
    two.do(two.market.tick(two.now))
    assert two.status.state is State.RUNNING, "nobody has listened to its heartbeats"
    two.now += 0.5
    two.do(two.market.tick(two.now))
    assert two.events[-1] == "1 attentive_guide ENDED LOST"
