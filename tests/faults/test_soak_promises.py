# SPDX-License-Identifier: Apache-2.0
"""The checker of a soak finds every broken promise, and no kept one."""

from __future__ import annotations

from dataclasses import replace

import pytest

import soak_promises as soak

SCENE = soak.SceneAcknowledged(at=1.0, scene="s1")
SHOWN = soak.SceneShown(at=1.1, scene="s1")
END = soak.SceneEnded(at=2.0, scene="s1", code="SUCCEEDED", epoch="e1")
KILL = soak.Fault(at=5.0, component="marketplace", kind="killed", over=5.0)
KILL_OF_SCENE_LAYER = soak.Fault(at=1.5, component="scene_layer", kind="killed", over=1.5)
HANG = soak.Fault(at=5.0, component="agents", kind="hung", over=7.0)


def broken(*events: soak.Event) -> dict[str, list[str]]:
    """Return each broken promise, and how it was broken."""
    return {
        verdict.promise: [breach.text for breach in verdict.breaches]
        for verdict in soak.check(events)
        if verdict.breaches
    }


def request(at: float, value: object, *, acknowledged: bool = True) -> soak.SettingRequested:
    return soak.SettingRequested(at=at, name="alma.pause", value=value, acknowledged=acknowledged)


def read(at: float, value: object) -> soak.SettingRead:
    return soak.SettingRead(at=at, name="alma.pause", value=value)


def served(fault: soak.Fault, silence_s: float, *, overloaded: bool = False) -> soak.Served:
    return soak.Served(at=fault.over + 5, fault=fault, silence_s=silence_s, overloaded=overloaded)


def life(grows_by: float = 0.0, seconds: int = 600, **others: int) -> list[soak.Event]:
    """Return the measurements of a process that grows by this many MB a minute."""
    return [
        soak.Measured(
            at=float(at),
            component="marketplace",
            pid=1,
            memory_mb=80.0 + grows_by * at / 60,
            descriptors=40 + others.get("descriptors", 0) * at // 60,
            threads=9 + others.get("threads", 0) * at // 60,
        )
        for at in range(0, seconds, 5)
    ]


def test_correct_history_checks_every_promise_without_violation() -> None:
    events = [
        SCENE, SHOWN, END, KILL, served(KILL, 2.0),
        soak.FeedbackAcknowledged(at=3.0, feedback="f1"),
        soak.LedgerRead(at=9.0, feedback=frozenset({"f1"})),
        request(3.0, 0.2), read(8.0, 0.2),
        soak.Acted(at=1.0, until=2.0, run="/agents 1", what="/say"),
        soak.Acted(at=2.0, until=3.0, run="/agents 2", what="/say"),
        soak.Replayed(at=9.0, item="round 3", difference=""),
        *life(), *(soak.FilesCounted(at=float(at), files=12) for at in range(0, 600, 5)),
    ]  # fmt: skip
    assert broken(*events) == {}
    checked = {verdict.promise for verdict in soak.check(events) if verdict.checked}
    assert checked == set(soak.PROMISES)


def test_scene_without_end_is_reported() -> None:
    assert broken(SCENE, SHOWN) == {soak.ONE_END: ["scene s1 has no end"]}
    assert broken(SCENE) == {soak.ONE_END: ["scene s1 has no end"]}


def test_scene_with_two_ends_is_reported_without_request() -> None:
    again = soak.SceneEnded(at=3.0, scene="s1", code="LOST", epoch="e2")
    assert broken(SCENE, END, again) == {soak.ONE_END: ["scene s1 ends as SUCCEEDED and LOST"]}
    assert broken(END, again) == {soak.ONE_END: ["scene s1 ends as SUCCEEDED and LOST"]}


def test_refusal_of_duplicate_scene_is_no_end() -> None:
    again = soak.SceneEnded(at=3.0, scene="s1", code="DUPLICATE", epoch="e1")
    assert broken(SCENE, END, again) == {}


def test_end_repeated_by_next_market_counts_once() -> None:
    assert broken(SCENE, END, replace(END, at=9.0)) == {}


def test_scene_lost_with_scene_layer_needs_no_end() -> None:
    killed = [KILL_OF_SCENE_LAYER, served(KILL_OF_SCENE_LAYER, 1.0)]
    assert broken(SCENE, *killed) == {}
    assert broken(SCENE, SHOWN, *killed) == {soak.ONE_END: ["scene s1 has no end"]}


def test_scene_needs_end_when_market_dies_immediately() -> None:
    soon = soak.Fault(at=1.05, component="marketplace", kind="killed", over=1.05)
    assert broken(SCENE, SHOWN, soon)[soak.ONE_END] == ["scene s1 has no end"]


def test_feedback_missing_from_ledger_is_reported() -> None:
    given = soak.FeedbackAcknowledged(at=1.0, feedback="f1")
    lost = {soak.FEEDBACK_STORED: ["feedback f1 is not in the ledger"]}
    assert broken(given, soak.LedgerRead(at=2.0, feedback=frozenset({"f0"}))) == lost
    assert broken(given) == lost, "a ledger that was never read holds nothing"
    assert broken(given, soak.LedgerRead(at=2.0, feedback=frozenset({"f1"}))) == {}


def test_setting_older_than_last_acknowledged_is_reported() -> None:
    asked = [request(1.0, 0.2), request(2.0, 0.4)]
    assert broken(*asked, read(3.0, 0.2)) == {
        soak.SETTINGS_STORED: ["alma.pause is 0.2, but 0.4 was acknowledged at 2.0 s"]
    }
    assert broken(*asked, read(3.0, 0.4)) == {}


def test_setting_without_answer_may_apply_or_not() -> None:
    asked = [request(1.0, 0.2), request(2.0, 0.4, acknowledged=False)]
    assert broken(*asked, read(3.0, 0.2), read(4.0, 0.4)) == {}
    assert soak.SETTINGS_STORED in broken(*asked, read(3.0, 0.3))
    later = request(40.0, 0.6)
    assert soak.SETTINGS_STORED in broken(*asked, later, read(41.0, 0.4))


def test_two_agents_acting_simultaneously_are_reported() -> None:
    first = soak.Acted(at=1.0, until=3.0, run="/agents 1", what="/say")
    second = soak.Acted(at=2.5, until=4.0, run="/others 2", what="/drive")
    assert broken(first, second) == {
        soak.ONE_ACTS: ["/drive of /others 2 beside /say of /agents 1, for 0.50 s"]
    }


def test_short_act_does_not_hide_longer_one() -> None:
    long = soak.Acted(at=1.0, until=9.0, run="/agents 1", what="/drive")
    short = soak.Acted(at=2.0, until=3.0, run="/agents 1", what="/say")
    other = soak.Acted(at=5.0, until=6.0, run="/others 2", what="/say")
    assert broken(long, short) == {}
    assert soak.ONE_ACTS in broken(long, short, other)


@pytest.mark.parametrize(
    ("measured", "named"),
    [
        (life(grows_by=3.0), "memory_mb +3.00 a minute (at most 1)"),
        (life(descriptors=4), "descriptors +4.0"),
        (life(threads=2), "threads +2.0"),
    ],
)
def test_growing_process_is_reported(measured: list[soak.Event], named: str) -> None:
    [text] = broken(*measured)[soak.NO_GROWTH]
    assert text.startswith("marketplace (process 1, since 0 s): ")
    assert named in text


def test_short_lifetime_and_single_peak_are_no_growth() -> None:
    assert broken(*life(grows_by=30.0, seconds=200)) == {}
    peak = soak.Measured(
        at=300.5, component="marketplace", pid=1, memory_mb=900.0, descriptors=400, threads=90
    )
    assert broken(*life(), peak) == {}


def test_growth_of_filling_caches_does_not_count() -> None:
    filled = [
        replace(one, memory_mb=min(one.memory_mb, 85.0))
        for one in life(grows_by=2.0)
        if isinstance(one, soak.Measured)
    ]
    assert broken(*filled) == {}


@pytest.mark.parametrize(
    ("wanted", "waited_s"),
    [
        ([], 0.0),
        ([(0.0, 20.0)], 4.0),
        ([(0.0, 10.0)], 0.0),
        ([(17.0, 17.5)], 0.5),
        ([(17.0, 30.0)], 3.0),
        ([(9.0, 12.0), (11.0, 13.0), (13.5, 15.0)], 3.0),
    ],
)
def test_wait_begins_with_request_or_act(
    wanted: list[tuple[float, float]], waited_s: float
) -> None:
    assert soak.longest_wait(10.0, 20.0, [8.0, 14.0, 16.0, 22.0], wanted) == waited_s


def test_accumulating_state_files_are_reported() -> None:
    files = [soak.FilesCounted(at=float(at), files=10 + at // 20) for at in range(0, 600, 5)]
    assert broken(*files) == {soak.NO_GROWTH: ["files +3.00 a minute"]}


def test_missing_or_slow_recovery_after_fault_is_reported() -> None:
    assert broken(KILL) == {soak.RECOVERY: ["marketplace killed: no scene was served after it"]}
    late = broken(HANG, served(HANG, 4.0))
    assert late == {soak.RECOVERY: ["agents hung: nobody acted for 4.0 s"]}
    assert broken(HANG, served(HANG, 2.0)) == {}


def test_restart_of_all_processes_may_take_longer() -> None:
    all_at_once = replace(KILL, component=soak.EVERYTHING)
    assert broken(all_at_once, served(all_at_once, 5.0)) == {}
    assert broken(all_at_once, served(all_at_once, 7.0)) == {
        soak.RECOVERY: ["everything killed: nobody acted for 7.0 s"]
    }


def test_recovery_time_is_ignored_on_overloaded_machine() -> None:
    assert broken(KILL, served(KILL, 30.0, overloaded=True)) == {}


def test_process_ending_by_itself_is_reported() -> None:
    assert broken(soak.Failed(at=4.0, component="feedback", text="ended with exit code 1")) == {
        soak.NO_FAILURE: ["feedback: ended with exit code 1"]
    }


def test_slope_follows_majority_of_points() -> None:
    line = [(float(at), 2.0 * at) for at in range(1000)]
    assert soak.slope(line) == 2.0
    assert soak.slope([*line, (1000.0, 1e9)]) == 2.0
    assert soak.slope([(1.0, 5.0)]) == 0.0


def test_different_replay_is_reported() -> None:
    event = soak.Replayed(at=9.0, item="round 3", difference="the winner is alma, not bruno")
    assert broken(event) == {soak.REPLAY: ["round 3: the winner is alma, not bruno"]}


def spans(goals: soak.RobotGoals) -> list[tuple[float, float, bool]]:
    return [(goal.at, goal.until, goal.over) for goal in goals.all.values()]


def test_goals_end_with_their_robot() -> None:
    goals = soak.RobotGoals()
    goals.take("say", 1.0, {b"1": True})
    goals.end(3.0)
    goals.take("say", 5.0, {})
    goals.take("say", 6.0, {b"1": False})
    assert spans(goals) == [(1.0, 3.0, True)]


def test_late_messages_of_dead_robot_still_count() -> None:
    goals = soak.RobotGoals()
    goals.take("say", 1.0, {b"1": True})
    goals.end(3.0)
    goals.take("say", 2.0, {b"1": False})
    goals.take("say", 2.5, {b"1": False, b"2": True})
    goals.take("say", 5.0, {})
    assert spans(goals) == [(1.0, 2.0, True), (2.5, 3.0, True)]


def test_restarted_robot_does_not_know_earlier_goals() -> None:
    goals = soak.RobotGoals()
    goals.take("say", 1.0, {b"0": False, b"1": True})
    goals.take("show", 2.0, {})
    assert spans(goals) == [(1.0, 1.0, False)]
    goals.take("say", 4.0, {b"2": True})
    assert spans(goals) == [(1.0, 1.0, True), (4.0, 4.0, False)]
