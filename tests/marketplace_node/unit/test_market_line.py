# SPDX-License-Identifier: Apache-2.0
"""Scenes in line: they wait a limited time for a missing host, and outlive the market.

So do runs: a later market records each once, and repeats its scene once if it was cut off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.stop_cause import StopCause
from market_harness import EXPRESS, GUIDE, PLAIN, SPACE, MarketHarness, scene, with_host
from marketplace_node.effects import (
    AnnounceEarlierRun,
    AnnounceRun,
    EarlierRun,
    PublishAuction,
    SceneEnded,
    State,
)
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.interaction.market_failover import GATHER_S, KEPT_S
from marketplace_node.interaction.scene_admission import ROUNDS_IN_VAIN
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes, read_scenes
from marketplace_node.market import Market
from marketplace_node.operator_overrides import OperatorAction
from marketplace_node.outcomes import RunEventKind, RunOutcome

CROWD = tuple(f"s{number}" for number in range(1, 11))


@pytest.fixture
def waiting(market: MarketHarness) -> MarketHarness:
    """A market with a scene that waits for its only host."""
    market.lose()
    market.scene("s1")
    return market


def serve(market: MarketHarness, epoch: str = "epoch") -> None:
    """Let the host run every goal."""
    for _ in range(80):
        if market.status.state is State.BIDDING:
            market.bid(epoch=epoch)
            market.perform()
        market.wait(0.0625)


@pytest.mark.parametrize("away_s", [0.9, 1.5, 5.0])
def test_queued_scenes_run_when_only_host_returns(running: MarketHarness, away_s: float) -> None:
    for name in CROWD[1:]:
        running.scene(name)
    running.lose(away_s=away_s)
    assert running.ends == [("s1", "LOST")]
    assert (running.status.state, running.status.queued) == (State.IDLE, 9)
    assert running.status.awaited_hosts == ("/agents",)
    assert running.status.message == "waiting for /agents (it has no heartbeat)"
    running.register(instance="second")
    assert running.status.awaited_hosts == ()
    serve(running)

    assert running.ends[1:] == [(name, "SUCCEEDED") for name in CROWD[1:]]


def test_absent_host_is_awaited_for_configured_time(waiting: MarketHarness) -> None:
    waiting.wait(4.7)
    assert waiting.over == []
    waiting.wait(0.3)

    assert waiting.ends == [("s1", "NO_BIDS")]
    waiting.scene("s2")
    assert waiting.ends[-1] == ("s2", "NO_BIDS"), "it is not expected any more"


def test_wait_uses_current_setting(waiting: MarketHarness) -> None:
    waiting.configure(host_wait_s=0)

    assert waiting.ends == [("s1", "NO_BIDS")]


def test_new_market_waits_for_first_host() -> None:
    market = MarketHarness()
    market.scene("s1")
    assert market.status.message == "waiting for hosts to register"
    assert market.status.awaited_hosts == ()
    market.wait(4.9)
    assert market.over == []
    market.register()
    serve(market)

    assert market.ends == [("s1", "SUCCEEDED")]
    other = MarketHarness()
    other.scene("s1")
    other.wait(5.1)
    assert other.ends == [("s1", "NO_BIDS")]


def test_host_silent_during_round_is_asked_on_return(market: MarketHarness) -> None:
    market.scene("s1")
    market.scene("s2")
    market.lose(away_s=0.6)
    assert (market.over, market.status.awaited_hosts) == ([], ("/agents",))
    assert market.status.waiting == ("s1", "s2"), "its place is kept"
    market.busy["/agents"] = 0
    market.wait(0.0625)
    serve(market)

    assert market.ends == [("s1", "SUCCEEDED"), ("s2", "SUCCEEDED")]


@pytest.mark.parametrize("how", ["refused", "unanswered", "gone"])
def test_scene_with_refused_run_is_auctioned_again(how: str) -> None:
    market = MarketHarness()
    market.register("/agents", GUIDE)
    market.scene("s1")
    market.bid(vectors={GUIDE: (4.0, 1.5, 3.0)})
    if how == "refused":
        market.refuse()
    elif how == "gone":
        market.die()
    market.wait({"refused": 0.0625, "unanswered": 2.1, "gone": 1.0}[how])
    if how == "gone":
        market.register(instance="second")
    market.bid(vectors={GUIDE: (4.0, 1.5, 3.0)})
    market.perform()

    assert market.ends == [("s1", "SUCCEEDED")]


@pytest.mark.parametrize("between_s", [0.0625, 4.0])
def test_repeatedly_refused_scene_ends(between_s: float) -> None:
    market = with_host(bid_deadline_s=10.0)
    market.scene("s1")
    began, rounds = market.now, 0
    while not market.over:
        assert rounds < 100
        market.bid()
        market.refuse()
        market.refuse()
        rounds += 1
        if not market.over:
            market.wait(between_s)

    assert market.ends == [("s1", "NOT_TAKEN")]
    assert rounds >= ROUNDS_IN_VAIN
    assert market.now - began >= market.market.settings.host_wait_s


def test_runnable_scenes_overtake_scenes_awaiting_host() -> None:
    market = MarketHarness()
    market.register("/agents", GUIDE)
    market.register("/others", PLAIN)
    market.lose()
    market.scene("s1")
    market.bid("/others", {}, {PLAIN: "is not for this"})
    assert (market.over, market.status.awaited_hosts) == ([], ("/agents",))
    market.scene("s2")
    market.bid("/others", {PLAIN: (5.0, 1.0, 3.0)})
    market.accept()
    market.register("/agents", GUIDE, instance="second")
    assert (market.status.scene_id, market.status.waiting) == ("s2", ("s1",))
    market.finish()
    market.bid("/others", {}, {PLAIN: "is not for this"})
    market.bid("/agents", {GUIDE: (4.0, 1.5, 3.0)})
    market.perform()

    assert market.ends == [("s2", "SUCCEEDED"), ("s1", "SUCCEEDED")]


def test_host_with_only_vetoed_agents_is_not_awaited() -> None:
    market = MarketHarness()
    market.register("/agents", GUIDE)
    market.operate(OperatorAction.VETO, GUIDE)
    market.lose()
    market.scene("s1")

    assert market.ends == [("s1", "NO_BIDS")]


def test_pinned_agent_with_absent_host_is_awaited(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.operate(OperatorAction.PIN, PLAIN)
    market.lose("/others")
    market.scene("s1")

    assert (market.over, market.status.awaited_hosts) == ([], ("/others",))


def test_scenes_awaiting_host_can_be_cancelled(waiting: MarketHarness) -> None:
    waiting.scene("s2")
    assert waiting.cancel(round_number=7)[0] is False
    assert waiting.cancel("enough") == (True, "nothing runs; dropped 2 waiting scenes")

    assert waiting.ends == [("s1", "STOPPED"), ("s2", "STOPPED")]
    assert waiting.cancel("enough") == (False, "nothing runs")


@pytest.mark.parametrize(
    ("mode", "limit", "ends"),
    [("reject", 10, [("s2", "BUSY"), ("s3", "BUSY")]), ("queue", 1, [("s3", "QUEUE_FULL")])],
)
def test_queue_limit_applies_while_awaiting_host(
    mode: str, limit: int, ends: list[tuple[str, str]]
) -> None:
    market = with_host(on_new_scene=mode, queue_limit=limit)
    market.lose()
    for name in ("s1", "s2", "s3"):
        market.scene(name)

    assert market.ends == ends
    assert "scene 's1' waits for a host" in market.end_words


def test_urgent_preempting_scene_goes_first_when_host_returns() -> None:
    market = with_host(on_new_scene="preempt")
    market.lose()
    market.scene("s1")
    market.scene("s2", urgent=True)
    market.register(instance="second")

    assert (market.status.scene_id, market.status.waiting) == ("s2", ("s1",))


def test_stalled_market_extends_wait_for_host(waiting: MarketHarness) -> None:
    waiting.stall(30.0)
    assert waiting.over == []
    waiting.register(instance="second")
    serve(waiting)

    assert waiting.ends == [("s1", "SUCCEEDED")]


def test_scene_waits_until_run_of_host_ends(running: MarketHarness) -> None:
    running.scene("s2")
    running.cancel(round_number=1)
    running.wait(14.1)
    assert running.ends == [("s1", "LOST")]
    assert running.status.message == ("waiting for /agents (its run of round 1 has not ended)")
    running.busy["/agents"] = 0
    running.wait(0.0625)
    serve(running)

    assert running.ends[-1] == ("s2", "SUCCEEDED")


# The market is started again.


def restarted(
    market: MarketHarness, away_s: float = 1.0, *, host: bool = True, at_once: bool = False
) -> MarketHarness:
    """Return the next start of a killed market, with the state that it stored.

    It was killed ``at_once`` after its last event, or after storing that all ends were announced.
    """
    if not at_once:
        market.do(market.market.tick(market.now))
    after = MarketHarness()
    after.now = market.now + away_s
    after.market = Market(SPACE, "next", after.market.settings, secret=b"")
    text = format_scenes(market.all(StoreScenes)[-1])
    after.do(after.market.restore_scenes(text, away_s, after.now)[1])
    if host:
        after.register()
    return after


GOAL = RunGoal(round=7, agent=GUIDE, agent_id=3, host="/agents", instance="first")


def earlier(**changes: Any) -> EarlierRun:
    """Return a run of an earlier market that was cut off a second ago, apart from ``changes``."""
    values: dict[str, Any] = {
        "epoch": "earlier",
        "goal": GOAL,
        "outcome": RunOutcome.CANCELLED,
        "scene": scene("old"),
        "message": "its market is gone",
        "stop_cause": StopCause.MARKET_LOST,
        "age_s": 1.0,
    }
    return EarlierRun(**(values | changes))


def tell(market: MarketHarness, *runs: EarlierRun) -> None:
    market.do(market.market.unreported("/agents", runs, market.now))


def report(market: MarketHarness, goal: RunGoal, outcome: RunOutcome) -> None:
    tell(market, earlier(epoch="epoch", goal=goal, scene=scene("s1"), outcome=outcome))


def test_queue_resumes_when_all_earlier_hosts_return(market: MarketHarness) -> None:
    market.register("/b", "other")
    market.scene("s1")
    after = restarted(market)
    assert after.status.state is State.IDLE, "the other host is still to come"
    after.register("/b", "other")
    assert (after.status.state, after.status.scene_id) == (State.BIDDING, "s1")
    late = restarted(market)
    late.wait(GATHER_S - 0.1)
    assert late.status.state is State.IDLE
    late.wait(0.2)
    assert late.status.state is State.BIDDING, "it has waited long enough"


def test_known_scene_is_a_duplicate_after_restart() -> None:
    market = MarketHarness(queue_limit=1)
    market.run()
    for name in ("s2", "s3", "s3"):
        market.scene(name)
    assert market.ends == [("s3", "QUEUE_FULL"), ("s3", "DUPLICATE")]
    market.finish()
    after = restarted(market)
    for name in ("s1", "s2", "s3"):
        after.scene(name)

    assert after.ends == [("s1", "DUPLICATE"), ("s2", "DUPLICATE"), ("s3", "DUPLICATE")]


def test_queue_survives_market_restart(market: MarketHarness) -> None:
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("first", urgent=True))
    market.scene("s2")
    market.scene("s3", float("nan"), 2.0, 3.0)
    after = restarted(market, host=False)
    assert after.status.waiting == ("first", "s2", "s3")
    after.register()
    serve(after, "next")

    assert after.ends == [(name, "SUCCEEDED") for name in ("first", "s2", "s3")]
    winner = after.all(PublishAuction)[0].decision.ranking[0]
    assert winner.agent == EXPRESS, "an award outlives the market, too"


def test_run_is_lost_once_if_host_also_restarts(running: MarketHarness) -> None:
    after = restarted(running, host=False)
    after.register(instance="second")
    report(after, running.goal, RunOutcome.SUCCEEDED)
    after.wait(20.0)

    assert [(run.epoch, run.goal, run.outcome) for run in earlier_runs(after)] == [
        ("epoch", running.goal, RunOutcome.LOST)
    ]
    assert after.ends == [("s1", "LOST")]
    assert after.end_words == "the marketplace was restarted, and /agents was started again, too"


def test_unreported_run_is_lost_after_wait(running: MarketHarness) -> None:
    after = restarted(running)
    after.wait(4.9)
    assert after.over == []
    after.wait(0.2)
    assert after.ends == [("s1", "LOST")]
    report(after, running.goal, RunOutcome.SUCCEEDED)
    after.wait(60.0)

    assert after.over == ["s1"], "a report that comes too late ends nothing again"
    assert [run.outcome for run in earlier_runs(after)] == [RunOutcome.LOST]


def test_run_still_stopping_on_host_is_awaited(running: MarketHarness) -> None:
    after = restarted(running)
    for _ in range(20):
        after.beat(epoch="epoch", round_number=running.goal.round)
        after.now += 0.5
        after.do(after.market.tick(after.now))
    assert after.over == []
    report(after, running.goal, RunOutcome.SUCCEEDED)

    assert after.ends == [("s1", "SUCCEEDED")]


def test_scene_gets_outcome_of_run_ended_before_crash(running: MarketHarness) -> None:
    running.end(outcome=2, message="it fell")
    assert running.over == []
    after = restarted(running)
    after.wait(6.0)

    assert after.ends == [("s1", "FAILED")]
    assert after.end_words == "attentive_guide failed: it fell; the marketplace was restarted"


def test_scene_with_unstarted_run_goes_first_after_restart(market: MarketHarness) -> None:
    market.award("s1")
    market.scene("s2")
    after = restarted(market)
    report(after, market.goal, RunOutcome.LOST)
    assert after.ends == [], "this run has never begun"
    serve(after, "next")

    assert after.ends == [("s1", "SUCCEEDED"), ("s2", "SUCCEEDED")]


def test_pending_repeat_auction_survives_second_restart(running: MarketHarness) -> None:
    after = restarted(running)
    report(after, running.goal, RunOutcome.LOST)
    assert after.ends == [("s1", "LOST")]
    again = restarted(after)
    serve(again, "next")

    assert again.ends == [("s1+again", "SUCCEEDED")]


def test_unreported_run_survives_second_restart(running: MarketHarness) -> None:
    again = restarted(restarted(running, host=False))
    report(again, running.goal, RunOutcome.SUCCEEDED)

    assert again.ends == [("s1", "SUCCEEDED")]


def test_queued_scenes_are_lost_after_long_outage(waiting: MarketHarness) -> None:
    after = restarted(waiting, away_s=KEPT_S + 1)

    assert after.ends == [("s1", "LOST")]
    assert after.end_words == "there was no marketplace for 61 s, expected 60 s at most"


def test_ended_scene_id_is_reusable_after_long_outage(running: MarketHarness) -> None:
    running.finish()
    after = restarted(running, away_s=KEPT_S + 1)
    after.scene("s1")

    assert after.ends == []
    assert after.status.scene_id == "s1", "nothing is waited for, as no scene was in line"


def test_market_shutdown_ends_unreported_runs(running: MarketHarness) -> None:
    after = restarted(running)
    after.shut_down()

    assert (after.ends, after.all(StoreScenes)[-1].scenes) == ([("s1", "LOST")], ())


def test_scene_is_stored_and_removed_before_announcements(market: MarketHarness) -> None:
    market.scene("s1")
    stored = next(one for one in market.all(StoreScenes) if one.scenes)
    assert [one.scene.scene_id for one in stored.scenes] == ["s1"]
    before = len(market.effects)
    market.bid(vectors={}, declined=dict.fromkeys((GUIDE, EXPRESS), "is tired"))
    news = market.effects[before:]
    removed = next(one for one in news if isinstance(one, StoreScenes) and not one.scenes)

    assert news.index(removed) < news.index(market.all(SceneEnded)[0])


def test_next_market_repeats_end_without_stored_announcement(running: MarketHarness) -> None:
    running.scene("s2")
    running.finish()
    once = restarted(running, host=False, at_once=True)
    again = restarted(once, at_once=True)
    later = restarted(once)

    first = running.all(SceneEnded)[0]
    for after in (once, again):
        assert after.all(SceneEnded)[0] == replace(first, epoch=running.market.epoch)
        assert after.ends.count(("s1", "SUCCEEDED")) == 1
    assert "s1" not in later.over


def test_end_is_announced_again_after_any_outage(running: MarketHarness) -> None:
    running.finish()
    after = restarted(running, away_s=KEPT_S + 1, at_once=True)

    assert (after.ends, after.all(StoreScenes)[-1].ends) == ([("s1", "SUCCEEDED")], ())


def test_possibly_unannounced_run_end_is_announced_again(running: MarketHarness) -> None:
    running.end()
    once = restarted(running, host=False, at_once=True)
    later = restarted(once)
    report(once, running.goal, RunOutcome.SUCCEEDED)

    (run,) = earlier_runs(once)
    (end,) = (run for run in running.all(AnnounceRun) if run.event is RunEventKind.ENDED)
    assert {**vars(run), "epoch": ""} == {**vars(end), "epoch": "", "age_s": 0.0}
    assert run.epoch == "epoch"
    assert earlier_runs(later) == []


def earlier_runs(market: MarketHarness) -> list[EarlierRun]:
    return [effect.run for effect in market.all(AnnounceEarlierRun)]


def test_unchanged_state_is_not_stored(running: MarketHarness) -> None:
    before = len(running.all(StoreScenes))
    running.wait(2.0)

    assert len(running.all(StoreScenes)) == before


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"scenes": [], "taken": [1]}',
        '{"scenes": [{}], "taken": []}',
        '{"scenes": [{"scene": {}, "award": null, "run": null}], "taken": []}',
        "[" * 100_000,
    ],
)
def test_unreadable_stored_scenes_change_nothing(market: MarketHarness, text: str) -> None:
    with pytest.raises(Refused, match="cannot be read"):
        market.market.restore_scenes(text, 1.0, market.now)

    assert market.status.queued == 0


def test_stored_scene_round_trips(running: MarketHarness) -> None:
    running.scene("s2", float("nan"), 2.0, 3.0, urgent=True)
    stored = running.all(StoreScenes)[-1]

    assert repr(read_scenes(format_scenes(stored), SPACE)) == repr(stored)


# Hosts report runs of a market that has stored nothing.


@pytest.mark.parametrize("outcome", [RunOutcome.CANCELLED, RunOutcome.LOST])
def test_interrupted_run_is_recorded_and_scene_auctioned_again(
    market: MarketHarness, outcome: RunOutcome
) -> None:
    cut_off = earlier(outcome=outcome)
    tell(market, cut_off)

    assert market.all(AnnounceEarlierRun) == [AnnounceEarlierRun(run=cut_off)]
    assert market.ends == [("old", "LOST")]
    assert market.end_words == ("the marketplace was restarted; asked again as scene 'old+again'")
    assert market.calls == [], "other hosts may still be on their way"
    market.wait(1.6)
    assert (market.status.scene_id, market.status.state) == ("old+again", State.BIDDING)
    assert (market.calls[-1].scene.vector, market.calls[-1].round) == (cut_off.scene.vector, 1)


BY_ITSELF = {"message": "done", "stop_cause": StopCause.NOT_STOPPED}


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"outcome": RunOutcome.SUCCEEDED, **BY_ITSELF}, "SUCCEEDED", f"{GUIDE} succeeded: done"),
        ({"outcome": RunOutcome.FAILED, **BY_ITSELF}, "FAILED", f"{GUIDE} failed: done"),
        ({"outcome": RunOutcome.CANCELLED, **BY_ITSELF}, "CANCELLED", f"{GUIDE} cancelled: done"),
        ({"age_s": 12.0}, "LOST", "it was cut off 12 s ago, more than 10 s"),
        ({"age_s": -3600.0}, "LOST", "it was cut off -3600 s ago"),
        ({"age_s": float("nan")}, "LOST", "it was cut off nan s ago"),
        ({"scene": scene("old+again")}, "LOST", "it was asked again once already"),
    ],
)
def test_scene_not_auctioned_again_ends_with_words(
    market: MarketHarness, changes: dict[str, Any], code: str, words: str
) -> None:
    run = earlier(**changes)
    tell(market, run)

    (end,) = market.all(SceneEnded)
    assert (end.scene_id, end.code, end.round, end.agent) == (run.scene.scene_id, code, 0, GUIDE)
    assert words in end.message
    market.wait(1.6)
    assert market.calls == []


def test_market_shutting_down_repeats_no_auction(market: MarketHarness) -> None:
    market.shut_down("the marketplace is shutting down")
    tell(market, earlier())

    assert market.ends == [("old", "LOST")]
    assert market.end_words.endswith("not asked again, as the marketplace is shutting down")


def test_pending_repeat_auction_ends_at_market_shutdown(market: MarketHarness) -> None:
    tell(market, earlier())
    market.shut_down()
    market.wait(1.6)

    assert market.ends == [("old", "LOST"), ("old+again", "SHUTTING_DOWN")]


def test_interrupted_scene_is_auctioned_again_only_once(market: MarketHarness) -> None:
    tell(market, earlier(), earlier(message="once more"))
    tell(market, earlier())
    tell(market, earlier(goal=replace(GOAL, round=5)))
    market.wait(1.4)
    tell(market, earlier())
    market.wait(0.2)

    assert (len(market.calls), market.ends) == (1, [("old", "LOST")])
    assert [effect.run.goal.round for effect in market.all(AnnounceEarlierRun)] == [7, 5]
    assert len([n for n in market.notes if "once more; it is left out" in n]) == 3


def test_last_run_determines_scene_end(market: MarketHarness) -> None:
    follow_up = earlier(
        goal=replace(GOAL, round=9),
        scene=scene("old+1"),
        outcome=RunOutcome.SUCCEEDED,
        stop_cause=StopCause.NOT_STOPPED,
    )
    tell(market, earlier(goal=replace(GOAL, round=8)), follow_up)

    assert (market.ends, market.calls) == ([("old", "SUCCEEDED")], [])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"epoch": "epoch"}, "this market knows its own runs"),
        ({"goal": replace(GOAL, host="/others")}, "it was a run of '/others'"),
    ],
)
def test_runs_unknown_to_host_are_ignored(
    market: MarketHarness, changes: dict[str, Any], words: str
) -> None:
    tell(market, earlier(**changes))

    assert words in market.notes[-1]
    assert (market.all(AnnounceEarlierRun), market.ends) == ([], [])


def test_repeated_scene_queues_like_any_other(running: MarketHarness) -> None:
    tell(running, earlier())
    running.wait(1.6)

    assert running.ends == [("old", "LOST")]
    assert (running.status.scene_id, running.status.queued) == ("s1", 1)
