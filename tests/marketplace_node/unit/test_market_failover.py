# SPDX-License-Identifier: Apache-2.0
"""Failover: runs of an earlier market are recorded once, and repeated once if cut off."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents_core.stop_cause import StopCause
from market_harness import GUIDE, MarketHarness, scene
from marketplace_node.effects import AnnounceEarlierRun, EarlierRun, SceneEnded, State
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.outcomes import RunOutcome


def run(**changes: Any) -> EarlierRun:
    """Return a run that was cut off a second ago, apart from ``changes``."""
    goal = {"round": 7, "agent": GUIDE, "agent_id": 3, "host": "/agents", "instance": "first"}
    goal |= {name: changes.pop(name) for name in tuple(changes) if name in goal}
    values: dict[str, Any] = {
        "epoch": "earlier",
        "goal": RunGoal(**goal),
        "outcome": RunOutcome.CANCELLED,
        "scene": scene("old"),
        "message": "its market is gone",
        "stop_cause": StopCause.MARKET_LOST,
        "age_s": 1.0,
    }
    return EarlierRun(**(values | changes))


def tell(market: MarketHarness, *runs: EarlierRun, host: str = "/agents") -> None:
    market.do(market.market.unreported(host, runs, market.now))


@pytest.mark.parametrize("outcome", [RunOutcome.CANCELLED, RunOutcome.LOST])
def test_interrupted_run_is_recorded_and_scene_auctioned_again(
    market: MarketHarness, outcome: RunOutcome
) -> None:
    cut_off = run(outcome=outcome)
    tell(market, cut_off)

    assert market.all(AnnounceEarlierRun) == [AnnounceEarlierRun(run=cut_off)]
    assert market.ends == [("old", "LOST")]
    assert market.end_words == ("the marketplace was restarted; asked again as scene 'old+again'")
    assert market.calls == [], "other hosts may still be on their way"
    market.wait(1.6)
    assert (market.status.scene_id, market.status.state) == ("old+again", State.BIDDING)
    assert market.calls[-1].scene.vector == cut_off.scene.vector
    assert market.calls[-1].round == 1


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        (RunOutcome.SUCCEEDED, "SUCCEEDED"),
        (RunOutcome.FAILED, "FAILED"),
        (RunOutcome.CANCELLED, "CANCELLED"),
    ],
)
def test_run_ending_by_itself_ends_its_scene(
    market: MarketHarness, outcome: RunOutcome, code: str
) -> None:
    tell(market, run(outcome=outcome, message="done", stop_cause=StopCause.NOT_STOPPED))

    (end,) = market.all(SceneEnded)
    assert (end.scene_id, end.code, end.agent, end.round) == ("old", code, GUIDE, 0)
    assert end.message == f"attentive_guide {code.lower()}: done"
    market.wait(1.6)
    assert market.calls == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"age_s": 12.0}, "it was cut off 12 s ago, more than 10 s"),
        ({"age_s": -3600.0}, "it was cut off -3600 s ago"),
        ({"age_s": float("nan")}, "it was cut off nan s ago"),
        ({"scene": scene("old+again")}, "it was asked again once already"),
    ],
)
def test_scene_not_auctioned_again_says_why(
    market: MarketHarness, changes: dict[str, Any], words: str
) -> None:
    tell(market, run(**changes))

    (end,) = market.all(SceneEnded)
    assert end.code == "LOST"
    assert words in end.message
    market.wait(1.6)
    assert market.calls == []


def test_market_shutting_down_repeats_no_auction(market: MarketHarness) -> None:
    market.do(market.market.shut_down("the marketplace is shutting down", market.now))
    tell(market, run())

    assert market.ends == [("old", "LOST")]
    assert market.end_words.endswith("not asked again, as the marketplace is shutting down")


def test_pending_repeat_auction_ends_at_market_shutdown(market: MarketHarness) -> None:
    tell(market, run())
    market.do(market.market.shut_down("shutting down", market.now))
    market.wait(1.6)

    assert market.ends == [("old", "LOST"), ("old+again", "SHUTTING_DOWN")]


def test_interrupted_scene_is_auctioned_again_only_once(market: MarketHarness) -> None:
    tell(market, run(), run(message="once more"))
    tell(market, run())
    tell(market, run(round=5, scene=scene("old")))
    market.wait(1.4)
    tell(market, run())
    market.wait(0.2)

    assert len(market.calls) == 1
    assert market.ends == [("old", "LOST")]
    assert [effect.run.goal.round for effect in market.all(AnnounceEarlierRun)] == [7, 5]
    assert len([n for n in market.notes if "once more; it is left out" in n]) == 3


def test_last_run_determines_scene_end(market: MarketHarness) -> None:
    follow_up = run(
        round=9,
        scene=scene("old+1"),
        outcome=RunOutcome.SUCCEEDED,
        stop_cause=StopCause.NOT_STOPPED,
    )
    tell(market, run(round=8), follow_up)

    assert market.ends == [("old", "SUCCEEDED")]
    assert market.calls == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"epoch": "epoch"}, "this market knows its own runs"),
        ({"host": "/others"}, "it was a run of '/others'"),
    ],
)
def test_runs_unknown_to_host_are_ignored(
    market: MarketHarness, changes: dict[str, Any], words: str
) -> None:
    tell(market, run(**changes))

    assert words in market.notes[-1]
    assert market.all(AnnounceEarlierRun) == []
    assert market.ends == []


def test_repeated_scene_queues_like_any_other(market: MarketHarness) -> None:
    market.run()
    tell(market, run())
    market.wait(1.6)

    assert market.ends == [("old", "LOST")]
    assert (market.status.scene_id, market.status.queued) == ("s1", 1)
