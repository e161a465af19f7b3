# SPDX-License-Identifier: Apache-2.0
"""Scenes in line wait for a host that is away, for a bounded time, and outlive the market."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from market_harness import EXPRESS, GUIDE, PLAIN, SPACE, Driver, scene
from marketplace_node.effects import AnnounceEarlierRun, AnnounceRun, EarlierRun, SceneEnded, State
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.interaction.market_failover import GATHER_S, KEPT_S
from marketplace_node.interaction.scene_admission import ROUNDS_IN_VAIN
from marketplace_node.interaction.stored_scenes import StoreScenes, format_scenes, read_scenes
from marketplace_node.operator_overrides import OperatorAction
from marketplace_node.outcomes import RunEventKind, RunOutcome

CROWD = tuple(f"s{number}" for number in range(1, 11))


@pytest.fixture
def market() -> Driver:
    driver = Driver()
    driver.register()
    return driver


def come_back(market: Driver, instance: str = "second") -> None:
    market.register(instance=instance)


def serve(market: Driver, *, rounds: int = 40) -> None:
    """Let the host run whatever it is asked about."""
    for _ in range(rounds):
        if market.status.state is State.BIDDING:
            market.bid()
            market.accept()
            market.end()
            market.collect()
        market.wait(0.0625)


@pytest.mark.parametrize("away_s", [0.9, 1.5, 5.0])
def test_all_scenes_in_line_run_after_their_only_host_was_away(
    market: Driver, away_s: float
) -> None:
    market.run()
    for name in CROWD[1:]:
        market.scene(name)
    market.die()
    market.wait(away_s)
    assert market.ends == [("s1", "LOST")]
    assert (market.status.state, market.status.queued) == (State.IDLE, 9)
    assert market.status.awaited_hosts == ("/agents",)
    assert market.status.message == "waiting for /agents (it has no heartbeat)"
    come_back(market)
    assert market.status.awaited_hosts == ()
    serve(market)

    assert market.ends[1:] == [(name, "SUCCEEDED") for name in CROWD[1:]]


def test_a_host_that_stays_away_is_waited_for_as_long_as_is_set(market: Driver) -> None:
    market.die()
    market.wait(1.0)
    market.scene("s1")
    market.wait(4.7)
    assert market.over == []
    market.wait(0.3)

    assert market.ends == [("s1", "NO_BIDS")]
    market.scene("s2")
    assert market.ends[-1] == ("s2", "NO_BIDS"), "it is not expected any more"


def test_the_wait_counts_as_it_is_set_now(market: Driver) -> None:
    market.die()
    market.wait(1.0)
    market.scene("s1")
    settings = market.market.settings
    market.do(market.market.configure(type(settings)(host_wait_s=0), market.now))

    assert market.ends == [("s1", "NO_BIDS")]


def test_a_market_that_was_just_started_waits_for_its_first_host() -> None:
    market = Driver()
    market.scene("s1")
    assert market.status.message == "waiting for hosts to register"
    assert market.status.awaited_hosts == ()
    market.wait(4.9)
    assert market.over == []
    market.register()
    serve(market)

    assert market.ends == [("s1", "SUCCEEDED")]
    other = Driver()
    other.scene("s1")
    other.wait(5.1)
    assert other.ends == [("s1", "NO_BIDS")]


def test_a_scene_that_no_agent_of_a_living_host_wants_ends_at_once(market: Driver) -> None:
    market.scene("s1")
    market.bid(vectors={}, declined=dict.fromkeys((GUIDE, EXPRESS), "is tired"))

    assert market.ends == [("s1", "NO_BIDS")]


def test_a_host_that_falls_silent_in_a_round_is_asked_again_when_it_is_back(
    market: Driver,
) -> None:
    market.scene("s1")
    market.scene("s2")
    market.die()
    market.wait(0.6)
    assert market.over == []
    assert market.status.awaited_hosts == ("/agents",)
    assert market.status.waiting == ("s1", "s2"), "its place is kept"
    market.busy["/agents"] = 0
    market.wait(0.0625)
    serve(market)

    assert market.ends == [("s1", "SUCCEEDED"), ("s2", "SUCCEEDED")]


def test_a_host_that_beats_and_does_not_answer_is_there_and_bids_nothing(market: Driver) -> None:
    market.scene("s1")
    market.wait(0.6)

    assert market.ends == [("s1", "NO_BIDS")]


@pytest.mark.parametrize("how", ["refused", "unanswered", "gone"])
def test_a_scene_whose_run_nobody_has_taken_is_asked_about_again(how: str) -> None:
    market = Driver()
    market.register("/agents", GUIDE)
    market.scene("s1")
    market.bid(vectors={GUIDE: (4.0, 1.5, 3.0)})
    if how == "refused":
        market.refuse()
    elif how == "gone":
        market.die()
    market.wait({"refused": 0.0625, "unanswered": 2.1, "gone": 1.0}[how])
    if how == "gone":
        come_back(market)
    market.bid(vectors={GUIDE: (4.0, 1.5, 3.0)})
    market.accept()
    market.end()
    market.collect()

    assert market.ends == [("s1", "SUCCEEDED")]


@pytest.mark.parametrize("between_s", [0.0625, 4.0])
def test_a_scene_that_is_refused_again_and_again_ends(between_s: float) -> None:
    market = Driver(bid_deadline_s=10.0)
    market.register()
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


def test_scenes_that_others_can_run_pass_those_that_wait_for_a_host() -> None:
    market = Driver()
    market.register("/agents", GUIDE)
    market.register("/others", PLAIN)
    market.die()
    market.wait(1.0)
    market.scene("s1")
    market.bid("/others", {}, {PLAIN: "is not for this"})
    assert market.over == []
    assert market.status.awaited_hosts == ("/agents",)
    market.scene("s2")
    market.bid("/others", {PLAIN: (5.0, 1.0, 3.0)})
    market.accept()
    market.register("/agents", GUIDE, instance="second")
    assert (market.status.scene_id, market.status.waiting) == ("s2", ("s1",))
    market.end()
    market.collect()
    market.bid("/others", {}, {PLAIN: "is not for this"})
    market.bid("/agents", {GUIDE: (4.0, 1.5, 3.0)})
    market.accept()
    market.end()
    market.collect()

    assert market.ends == [("s2", "SUCCEEDED"), ("s1", "SUCCEEDED")]


def test_a_host_whose_agents_are_vetoed_is_not_waited_for() -> None:
    market = Driver()
    market.register("/agents", GUIDE)
    market.operate(OperatorAction.VETO, GUIDE)
    market.die()
    market.wait(1.0)
    market.scene("s1")

    assert market.ends == [("s1", "NO_BIDS")]


def test_a_pinned_agent_whose_host_is_away_is_waited_for(market: Driver) -> None:
    market.register("/others", PLAIN)
    market.operate(OperatorAction.PIN, PLAIN)
    market.die("/others")
    market.wait(1.0)
    market.scene("s1")

    assert market.over == []
    assert market.status.awaited_hosts == ("/others",)


def test_scenes_that_wait_for_a_host_can_be_cancelled(market: Driver) -> None:
    market.die()
    market.wait(1.0)
    market.scene("s1")
    market.scene("s2")
    assert market.cancel(round_number=7)[0] is False
    assert market.cancel("enough") == (True, "nothing runs; dropped 2 waiting scenes")

    assert market.ends == [("s1", "STOPPED"), ("s2", "STOPPED")]
    assert market.cancel("enough") == (False, "nothing runs")


def test_scenes_that_wait_for_a_host_end_when_the_market_shuts_down(market: Driver) -> None:
    market.die()
    market.wait(1.0)
    market.scene("s1")
    market.do(market.market.shut_down("shutting down", market.now))

    assert market.ends == [("s1", "SHUTTING_DOWN")]


@pytest.mark.parametrize(
    ("mode", "limit", "code"), [("reject", 10, "BUSY"), ("queue", 1, "QUEUE_FULL")]
)
def test_a_line_that_waits_for_a_host_is_no_longer_than_any(
    mode: str, limit: int, code: str
) -> None:
    market = Driver(on_new_scene=mode, queue_limit=limit)
    market.register()
    market.die()
    market.wait(1.0)
    for name in ("s1", "s2", "s3"):
        market.scene(name)

    assert market.over == (["s2", "s3"] if mode == "reject" else ["s3"])
    assert market.ends[-1] == ("s3", code)
    assert "scene 's1' waits for a host" in market.end_words


def test_an_urgent_scene_that_preempts_is_asked_about_first_when_a_host_is_back() -> None:
    market = Driver(on_new_scene="preempt")
    market.register()
    market.die()
    market.wait(1.0)
    market.scene("s1")
    market.scene("s2", urgent=True)
    come_back(market)

    assert (market.status.scene_id, market.status.waiting) == ("s2", ("s1",))


def test_a_market_that_was_held_up_waits_for_longer(market: Driver) -> None:
    market.die()
    market.wait(1.0)
    market.scene("s1")
    since, market.now = market.now, market.now + 30.0
    market.do(market.market.extend_after_stall(since, market.now))
    assert market.over == []
    come_back(market)
    serve(market)

    assert market.ends == [("s1", "SUCCEEDED")]


def test_a_scene_is_not_asked_about_while_the_run_of_its_host_has_not_ended(
    market: Driver,
) -> None:
    market.run()
    market.scene("s2")
    market.cancel(round_number=1)
    market.wait(14.1)
    assert market.ends == [("s1", "LOST")]
    assert market.status.message == ("waiting for /agents (its run of round 1 has not ended)")
    market.busy["/agents"] = 0
    market.wait(0.0625)
    serve(market)

    assert market.ends[-1] == ("s2", "SUCCEEDED")


# The market is started again.


def restarted(
    market: Driver, away_s: float = 1.0, *, host: bool = True, at_once: bool = False
) -> Driver:
    """Return the next start of a killed market, with what it has stored.

    It was killed ``at_once`` after its last event, or has stored that all ends were announced.
    """
    if not at_once:
        market.do(market.market.tick(market.now))
    after = Driver()
    after.now = market.now + away_s
    stored = market.all(StoreScenes)[-1]
    after.market = type(after.market)(SPACE, "next", after.market.settings, new_key=bytes)
    _, effects = after.market.restore_scenes(format_scenes(stored), away_s, after.now)
    after.do(effects)
    if host:
        after.register()
    return after


def serve_next(market: Driver) -> None:
    for _ in range(80):
        if market.status.state is State.BIDDING:
            market.bid(epoch="next")
            market.accept()
            market.end()
            market.collect()
        market.wait(0.0625)


def report(market: Driver, goal: RunGoal, outcome: RunOutcome) -> None:
    run = EarlierRun(
        event=RunEventKind.ENDED,
        outcome=outcome,
        goal=goal,
        scene=scene("s1"),
        message="it is over",
        epoch="epoch",
        age_s=1.0,
    )
    market.do(market.market.unreported("/agents", [run], market.now))


def test_the_line_is_asked_about_as_soon_as_all_hosts_of_the_earlier_market_are_back(
    market: Driver,
) -> None:
    market.register("/b", "other")
    market.scene("s1")
    after = restarted(market)
    assert after.status.state is State.IDLE, "the other host is still to come"
    after.register("/b", "other")
    assert (after.status.state, after.status.scene_id) == (State.BIDDING, "s1")


def test_the_line_waits_for_a_host_that_does_not_come_back_for_a_moment_only(
    market: Driver,
) -> None:
    market.register("/b", "other")
    market.scene("s1")
    after = restarted(market)
    after.wait(GATHER_S - 0.1)
    assert after.status.state is State.IDLE
    after.wait(0.2)
    assert after.status.state is State.BIDDING


def test_a_scene_that_was_refused_and_comes_in_again_has_had_its_end() -> None:
    market = Driver(queue_limit=0)
    market.register()
    market.run()
    market.scene("s2")
    market.scene("s2")
    assert market.ends == [("s2", "QUEUE_FULL"), ("s2", "DUPLICATE")]
    after = restarted(market)
    after.scene("s2")
    assert after.ends == [("s2", "DUPLICATE")]


def test_the_line_outlives_the_market(market: Driver) -> None:
    market.operate(OperatorAction.AWARD, EXPRESS, scene=scene("first", urgent=True))
    market.scene("s2")
    market.scene("s3", float("nan"), 2.0, 3.0)
    after = restarted(market, host=False)
    assert after.status.waiting == ("first", "s2", "s3")
    after.register()
    serve_next(after)

    assert after.ends == [(name, "SUCCEEDED") for name in ("first", "s2", "s3")]
    first = next(e for e in after.effects if getattr(e, "decision", None) is not None)
    assert first.decision.winner.agent == EXPRESS, "an award outlives the market, too"


def test_a_scene_that_was_taken_before_the_restart_is_a_duplicate_after_it(market: Driver) -> None:
    market.run("s1")
    market.end()
    market.collect()
    market.scene("s2")
    after = restarted(market)
    for name in ("s1", "s2"):
        after.scene(name)

    assert after.ends == [("s1", "DUPLICATE"), ("s2", "DUPLICATE")]


def test_a_run_whose_host_reports_its_end_ends_its_scene_once(market: Driver) -> None:
    goal = market.run()
    after = restarted(market)
    report(after, goal, RunOutcome.SUCCEEDED)
    report(after, goal, RunOutcome.SUCCEEDED)
    after.wait(20.0)

    assert after.ends == [("s1", "SUCCEEDED")]


def test_a_run_whose_host_was_started_again_with_the_market_is_lost_once(market: Driver) -> None:
    market.run()
    after = restarted(market, host=False)
    come_back(after)
    after.wait(20.0)

    assert after.ends == [("s1", "LOST")]
    assert after.end_words == "the marketplace was restarted, and /agents was started again, too"


def test_a_run_that_no_host_reports_is_lost_after_the_wait(market: Driver) -> None:
    goal = market.run()
    after = restarted(market)
    after.wait(4.9)
    assert after.over == []
    after.wait(0.2)
    assert after.ends == [("s1", "LOST")]
    report(after, goal, RunOutcome.SUCCEEDED)

    assert after.over == ["s1"], "a report that comes too late ends nothing again"


def test_a_run_that_its_host_is_still_stopping_is_waited_for(market: Driver) -> None:
    goal = market.run()
    after = restarted(market)
    for _ in range(20):
        after.beat(epoch="epoch", round_number=goal.round)
        after.now += 0.5
        after.do(after.market.tick(after.now))
    assert after.over == []
    report(after, goal, RunOutcome.SUCCEEDED)

    assert after.ends == [("s1", "SUCCEEDED")]


def test_a_run_that_had_ended_before_the_market_died_ends_its_scene_like_it(
    market: Driver,
) -> None:
    market.run()
    market.end(outcome=2, message="it fell")
    assert market.over == []
    after = restarted(market)
    after.wait(6.0)

    assert after.ends == [("s1", "FAILED")]
    assert after.end_words == "attentive_guide failed: it fell; the marketplace was restarted"


def test_a_scene_whose_run_had_not_begun_is_asked_about_first(market: Driver) -> None:
    market.scene("s1")
    market.scene("s2")
    market.bid()
    after = restarted(market)
    serve_next(after)

    assert after.ends == [("s1", "SUCCEEDED"), ("s2", "SUCCEEDED")]


def test_a_scene_in_line_is_not_ended_by_the_report_of_a_run_that_nobody_knew_of(
    market: Driver,
) -> None:
    market.scene("s1")
    market.bid()
    goal = market.goal
    after = restarted(market)
    report(after, goal, RunOutcome.LOST)
    serve_next(after)

    assert after.ends == [("s1", "SUCCEEDED")]


def test_what_is_to_be_asked_for_again_outlives_the_next_restart_too(market: Driver) -> None:
    goal = market.run()
    after = restarted(market)
    report(after, goal, RunOutcome.LOST)
    assert after.ends == [("s1", "LOST")]
    again = restarted(after)
    serve_next(again)

    assert again.ends == [("s1+again", "SUCCEEDED")]


def test_a_run_that_is_not_reported_yet_outlives_the_next_restart_too(market: Driver) -> None:
    goal = market.run()
    again = restarted(restarted(market, host=False))
    report(again, goal, RunOutcome.SUCCEEDED)

    assert again.ends == [("s1", "SUCCEEDED")]


def test_after_a_long_outage_nobody_waits_any_more(market: Driver) -> None:
    market.die()
    market.wait(1.0)
    market.scene("s1")
    after = restarted(market, away_s=KEPT_S + 1)

    assert after.ends == [("s1", "LOST")]
    assert after.end_words == "there was no marketplace for 61 s, expected 60 s at most"


def test_after_a_long_outage_the_id_of_a_scene_that_is_over_may_come_again(market: Driver) -> None:
    market.run()
    market.end()
    market.collect()
    after = restarted(market, away_s=KEPT_S + 1)
    after.scene("s1")

    assert after.ends == []
    assert after.status.scene_id == "s1", "nothing is waited for, as no scene was in line"


def test_a_market_that_shuts_down_ends_the_runs_that_are_not_reported(market: Driver) -> None:
    market.run()
    after = restarted(market)
    after.do(after.market.shut_down("shutting down", after.now))

    assert after.ends == [("s1", "LOST")]
    assert after.all(StoreScenes)[-1].scenes == ()


def test_a_scene_is_stored_before_and_removed_before_anybody_hears_of_it(market: Driver) -> None:
    market.scene("s1")
    first = next(
        i for i, e in enumerate(market.effects) if isinstance(e, StoreScenes) and e.scenes
    )
    assert [one.scene.scene_id for one in market.effects[first].scenes] == ["s1"]
    market.bid(vectors={}, declined=dict.fromkeys((GUIDE, EXPRESS), "is tired"))
    kinds = [type(effect).__name__ for effect in market.effects]
    last = len(kinds) - 1 - kinds[::-1].index("StoreScenes")

    assert market.effects[last].scenes == ()
    assert last < kinds.index("SceneEnded")


def test_an_end_whose_announcement_is_not_stored_is_announced_by_the_next_market(
    market: Driver,
) -> None:
    market.run()
    market.scene("s2")
    market.end()
    market.collect()
    once = restarted(market, host=False, at_once=True)
    again = restarted(once, at_once=True)
    later = restarted(once)

    first = market.all(SceneEnded)[0]
    for after in (once, again):
        assert after.all(SceneEnded)[0] == replace(first, epoch=market.market.epoch)
        assert after.ends.count(("s1", "SUCCEEDED")) == 1
    assert "s1" not in later.over


def test_an_end_is_announced_again_however_long_there_was_no_market(market: Driver) -> None:
    market.run()
    market.end()
    market.collect()
    after = restarted(market, away_s=KEPT_S + 1, at_once=True)

    assert after.ends == [("s1", "SUCCEEDED")]
    assert after.all(StoreScenes)[-1].ends == ()


def test_a_run_whose_market_and_host_died_is_lost_once(market: Driver) -> None:
    goal = market.run()
    after = restarted(market, host=False)
    after.register(instance="second")
    report(after, goal, RunOutcome.SUCCEEDED)

    assert [(run.epoch, run.goal, run.outcome) for run in earlier_runs(after)] == [
        ("epoch", goal, RunOutcome.LOST)
    ]
    assert after.ends == [("s1", "LOST")]


def test_a_run_that_nobody_reports_is_lost_once(market: Driver) -> None:
    market.run()
    after = restarted(market)
    after.wait(60.0)

    assert [run.outcome for run in earlier_runs(after)] == [RunOutcome.LOST]
    assert after.ends == [("s1", "LOST")]


def test_an_end_of_a_run_that_may_be_unannounced_is_announced_next(market: Driver) -> None:
    goal = market.run()
    market.end()
    once = restarted(market, host=False, at_once=True)
    later = restarted(once)
    report(once, goal, RunOutcome.SUCCEEDED)

    (run,) = earlier_runs(once)
    (end,) = (run for run in market.all(AnnounceRun) if run.event is RunEventKind.ENDED)
    assert {**vars(run), "epoch": ""} == {**vars(end), "epoch": "", "age_s": 0.0}
    assert run.epoch == "epoch"
    assert earlier_runs(later) == []


def earlier_runs(market: Driver) -> list[EarlierRun]:
    return [effect.run for effect in market.all(AnnounceEarlierRun)]


def test_without_a_change_nothing_is_stored(market: Driver) -> None:
    market.run()
    before = len(market.all(StoreScenes))
    market.wait(2.0)

    assert len(market.all(StoreScenes)) == before


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{",
        '{"scenes": [], "taken": [1]}',
        '{"scenes": [{}], "taken": []}',
        '{"scenes": [{"scene": {}, "award": null, "run": null}], "taken": []}',
        "[" * 100_000,
    ],
)
def test_stored_scenes_that_cannot_be_read_change_nothing(market: Driver, text: str) -> None:
    with pytest.raises(Refused, match="cannot be read"):
        market.market.restore_scenes(text, 1.0, market.now)

    assert market.status.queued == 0


def test_a_stored_scene_is_read_as_it_was(market: Driver) -> None:
    market.run()
    market.scene("s2", float("nan"), 2.0, 3.0, urgent=True)
    stored = market.all(StoreScenes)[-1]
    found = read_scenes(format_scenes(stored), SPACE)

    assert repr(found) == repr(stored)
