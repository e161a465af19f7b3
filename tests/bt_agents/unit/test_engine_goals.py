# SPDX-License-Identifier: Apache-2.0
"""Goals on a manual clock: their outcomes for leaves, and the state of their servers."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bt_agents.engine.environment import GoalState, SkillGoal
from bt_agents.engine.scripted_environment import ManualClock, ScriptedReply
from bt_agents.host.environment.goal import GRAPH_S, SECOND_POLL_S, GoalTrack
from bt_agents_core.field_types import BindingKind
from bt_agents_language.model.specs import HeartbeatSpec, Timeouts
from tree_harness import TreeHarness, failure, started

BEAT = HeartbeatSpec(topic="robot/heartbeat", type="std_msgs/msg/Empty", within_s=1.0)


class Followed:
    """A goal whose server does what the test says."""

    def __init__(self, kind: BindingKind = BindingKind.ACTION, **how: Any) -> None:
        self.clock = ManualClock()
        self.beat = -math.inf
        goal = SkillGoal(kind=kind, name="say", type="", fields={}, **how)
        hear = (lambda: self.beat) if goal.heartbeat is not None else None
        self.track = GoalTrack(goal, self.clock, hear)

    def after(self, seconds: float, there: bool = True) -> GoalState:
        """Let time pass and poll."""
        self.clock.advance(seconds)
        self.track.poll(there)
        return self.track.state

    def standing(self) -> tuple[GoalState, bool, int]:
        """Return the state, whether its end is confirmed, and the number of new cancels."""
        cancels = sum(self.track.take_cancel() for _ in range(3))
        return self.track.state, self.track.confirmed, cancels


def sent(**how: Any) -> Followed:
    """Return a goal that was sent to its server."""
    subject = Followed(**how)
    subject.track.sent()
    return subject


@pytest.fixture
def running() -> Followed:
    """A goal that its server has accepted."""
    subject = sent()
    subject.track.accepted()
    return subject


def test_missing_server_is_unreachable_and_needs_no_cancel() -> None:
    subject = Followed(timeouts=Timeouts(server_s=2.0))
    subject.after(1.9, there=False)
    assert subject.standing() == (GoalState.PENDING, False, 0)
    subject.after(0.1, there=False)
    assert subject.standing() == (GoalState.UNREACHABLE, True, 0)
    assert subject.track.message == "its server is not there (looked for 2 s)"


def test_abandoned_goal_is_cancelled_on_late_acceptance() -> None:
    subject = sent(timeouts=Timeouts(accept_s=2.0))
    subject.after(2.0)
    assert subject.standing() == (GoalState.UNREACHABLE, False, 0)
    assert subject.track.message == ("its server does not answer (no word about the goal for 2 s)")
    subject.track.accepted()
    assert subject.standing() == (GoalState.UNREACHABLE, False, 1)
    subject.track.ended(GoalState.CANCELLED)
    assert subject.standing() == (GoalState.UNREACHABLE, True, 0)


def test_rejected_goal_needs_no_cancel() -> None:
    abandoned, cancelled = sent(), sent()
    abandoned.after(3.0)
    cancelled.track.cancel()
    for subject in (abandoned, cancelled):
        subject.track.ended(GoalState.REJECTED)
    assert abandoned.standing() == (GoalState.UNREACHABLE, True, 0)
    assert cancelled.standing() == (GoalState.REJECTED, True, 0)


@pytest.mark.parametrize("subject", [Followed(), sent(kind=BindingKind.SERVICE)])
def test_cancel_ends_unsent_goal_and_request(subject: Followed) -> None:
    subject.track.cancel()
    assert subject.standing() == (GoalState.CANCELLED, True, 0)


def test_early_cancel_takes_effect_once_on_acceptance() -> None:
    subject = sent()
    subject.track.cancel()
    assert subject.standing() == (GoalState.PENDING, False, 0)
    subject.track.accepted()
    assert subject.standing() == (GoalState.ACTIVE, False, 1)
    subject.track.cancel()
    assert subject.standing() == (GoalState.ACTIVE, False, 0)
    subject.track.ended(GoalState.CANCELLED)
    assert subject.standing() == (GoalState.CANCELLED, True, 0)


@pytest.mark.parametrize("state", [GoalState.SUCCEEDED, GoalState.ABORTED, GoalState.CANCELLED])
def test_server_result_confirms_goal_end(running: Followed, state: GoalState) -> None:
    running.track.ended(state)
    running.track.cancel()
    assert running.standing() == (state, True, 0)


def pauses(subject: Followed, servers: frozenset[str], seconds: float) -> list[float]:
    """Return the pauses between repeats within some time, with these servers on the graph."""
    found = []
    last = now = 0.0
    while now < seconds:
        if subject.track.take_repeat(servers):
            found.append(now - last)
            last = now
        subject.clock.advance(GRAPH_S)
        now += GRAPH_S
    return found


@pytest.mark.parametrize("accepted", [False, True])
def test_joined_server_is_asked_after_ever_longer_pauses(accepted: bool) -> None:
    subject = Followed(timeouts=Timeouts(accept_s=60.0))
    subject.track.sent(frozenset({"a"}))
    if accepted:
        subject.track.accepted()
    assert not subject.track.take_look(), "it looks at the graph only now and then"
    subject.clock.advance(GRAPH_S)
    assert subject.track.take_look()
    assert not subject.track.take_repeat(frozenset({"a"}))

    found = pauses(subject, frozenset({"a", "b"}), 60.0)

    assert found[:3] == [0.0, GRAPH_S, 2 * GRAPH_S]
    assert found == sorted(found)
    assert 8 < len(found) < 15
    assert not subject.track.take_repeat(frozenset({"b"})), "the lease of the first has ended"
    assert subject.track.take_repeat(frozenset({"b", "c"}))


def test_several_servers_are_asked_again_from_the_start() -> None:
    subject = Followed()
    subject.track.sent(frozenset({"a", "b"}))
    assert pauses(subject, frozenset({"a", "b"}), 1.0) == [0.0, GRAPH_S, 2 * GRAPH_S]


def test_graph_is_polled_only_while_goal_is_open() -> None:
    subject = Followed()
    assert not subject.track.take_look()
    subject.track.sent()
    subject.track.accepted()
    subject.clock.advance(GRAPH_S)
    assert subject.track.take_look()
    subject.clock.advance(GRAPH_S)
    subject.track.ended(GoalState.SUCCEEDED)
    assert not subject.track.take_look()


def test_action_has_no_default_result_timeout(running: Followed) -> None:
    assert running.after(1e6) is GoalState.ACTIVE


def test_late_result_times_out_and_cancels_goal() -> None:
    subject = sent(timeouts=Timeouts(result_s=60.0))
    subject.after(2.0)
    subject.track.accepted()
    assert subject.after(59.9) is GoalState.ACTIVE
    subject.after(0.1)
    assert subject.standing() == (GoalState.TIMED_OUT, False, 1)
    subject.track.ended(GoalState.SUCCEEDED)
    assert subject.standing() == (GoalState.TIMED_OUT, True, 0)
    assert subject.track.message == "no result within 60 s"


def test_goal_survives_only_brief_server_absence(running: Followed) -> None:
    for _ in range(3):
        assert running.after(100.0) is GoalState.ACTIVE
        assert running.after(2.9, there=False) is GoalState.ACTIVE
    running.after(0.1, there=False)
    assert running.standing() == (GoalState.UNREACHABLE, False, 1)
    assert running.track.message == "its server has left the graph (gone for 3 s)"


def silent_goal() -> Followed:
    subject = sent(heartbeat=BEAT)
    subject.clock.advance(2.0)
    subject.track.accepted()
    return subject


def test_heartbeat_timeout_starts_at_acceptance() -> None:
    subject = silent_goal()
    assert subject.after(0.99) is GoalState.ACTIVE
    assert subject.after(0.01) is GoalState.ACTIVE  # the first poll of a silence shows nothing
    assert subject.track.due == subject.clock() + SECOND_POLL_S
    subject.after(SECOND_POLL_S)
    assert subject.standing() == (GoalState.UNREACHABLE, False, 1)
    assert subject.track.message == (
        "its server has gone silent (no heartbeat for 1.0 s, nor ever one on robot/heartbeat)"
    )


def test_heartbeats_keep_server_alive() -> None:
    subject = silent_goal()
    for _ in range(20):
        assert subject.after(0.9) is GoalState.ACTIVE
        subject.beat = subject.clock()
    subject.after(1.2)
    assert subject.after(SECOND_POLL_S) is GoalState.UNREACHABLE
    assert subject.track.message == "its server has gone silent (no heartbeat for 1.2 s)"


def test_stalled_process_reads_queued_heartbeats_first() -> None:
    subject = silent_goal()
    assert subject.after(5.0) is GoalState.ACTIVE
    subject.beat = subject.clock()
    assert subject.after(SECOND_POLL_S) is GoalState.ACTIVE
    assert subject.after(0.9) is GoalState.ACTIVE


def test_goal_is_due_at_its_next_deadline() -> None:
    subject = sent(heartbeat=BEAT, timeouts=Timeouts(accept_s=2.0, result_s=1.1))
    assert subject.track.due == GRAPH_S
    subject.after(1.9)
    assert subject.track.due == pytest.approx(2.0)
    subject.track.accepted()
    subject.beat = subject.clock()
    subject.after(0.9)
    assert subject.track.due == pytest.approx(2.9)
    subject.beat = subject.clock()
    assert subject.track.due == pytest.approx(3.0)
    subject.after(0.2)
    assert subject.track.state is GoalState.TIMED_OUT
    assert subject.track.due == math.inf


def test_service_has_default_timeout_and_needs_no_cancel() -> None:
    subject = sent(kind=BindingKind.SERVICE)
    assert subject.after(9.9) is GoalState.ACTIVE
    subject.after(0.1)
    assert subject.standing() == (GoalState.TIMED_OUT, True, 0)
    assert subject.track.message == "no answer within 10 s"


# The author's text, and its meaning in a run.

RAW = """
action:
  name: dance
  type: bt_agents_interfaces/action/Say
  timeouts: {accept: 2 s, result: 60 s}
"""


@pytest.mark.parametrize(
    ("answer", "after_s", "words"),
    [
        (ScriptedReply(state=GoalState.UNREACHABLE, message="gone"), 0, "unreachable: gone"),
        (
            ScriptedReply(accept_s=9.0, after_s=99.0),
            2,
            "unreachable: its server does not answer (no word about the goal for 2 s)",
        ),
        (
            ScriptedReply(state=GoalState.REJECTED),
            0,
            "rejected: its server did not take the goal and says nothing about why",
        ),
        (
            ScriptedReply(state=GoalState.ABORTED),
            0,
            "aborted: its server gave up and says nothing about why",
        ),
        (ScriptedReply(state=GoalState.CANCELLED), 0, "cancelled: somebody else has stopped it"),
        (ScriptedReply(accept_s=1.0, after_s=99.0), 61, "timed out: no result within 60 s"),
    ],
)
def test_each_goal_failure_has_its_own_message(
    answer: ScriptedReply, after_s: float, words: str
) -> None:
    harness = started(RAW, answers={"dance": [answer]})
    harness.after(after_s)
    assert harness.reports("tree")[-1] == ("FAILURE", f"dance {words}")


def test_long_server_message_is_truncated() -> None:
    huge = ScriptedReply(state=GoalState.ABORTED, message="x" * 10_000_000)
    harness = TreeHarness(RAW, answers={"dance": [huge]})
    harness.tick(2)
    assert len(harness.message) < 400


@pytest.mark.parametrize(
    ("reply", "orphans"),
    [
        (ScriptedReply(after_s=99.0, cancel_s=math.inf), ("tree",)),
        (ScriptedReply(after_s=99.0, vanishes=True), ("tree",)),
        (ScriptedReply(accept_s=math.inf, after_s=math.inf), ("tree",)),
        (ScriptedReply(state=GoalState.UNREACHABLE), ()),
    ],
)
def test_sent_unconfirmed_goal_is_an_orphan(
    reply: ScriptedReply, orphans: tuple[str, ...]
) -> None:
    harness = started(RAW, answers={"dance": [reply]})
    harness.outcomes(60, 2)
    assert (harness.outcome, harness.result.orphans) == ("failed", orphans)


def test_outputs_include_last_feedback_at_action_end() -> None:
    action = "name: dance, type: bt_agents_interfaces/action/Say, outputs: {n: feedback.progress}"
    tree = f"sequence: [{{action: {{{action}}}}}, {{say: '${{n}}'}}]"
    told = ScriptedReply(after_s=1.0, feedback=((0.5, {"progress": 1.0}),))
    harness = started(tree, answers={"dance": [told]})
    assert (harness.after(1.0), harness.said) == ("succeeded", ["1"])
    assert failure(tree).startswith("'n' has no value")


@pytest.mark.parametrize(
    "told", [{}, {"progress": math.nan}, {"progress": "x" * 10_000_000}, {"other": [1, 2]}]
)
def test_malformed_feedback_neither_ends_goal_nor_raises(told: dict[str, object]) -> None:
    answer = ScriptedReply(after_s=1.0, feedback=((0.0, told),))  # type: ignore[arg-type]
    tree = RAW + "  outputs: {done: feedback.progress}"
    harness = TreeHarness(tree, answers={"dance": [answer]})
    assert harness.tick() == "running"
    assert harness.after(1.0) == "succeeded"
    assert len(str(harness.changes)) < 10_000


@pytest.mark.parametrize(
    "result", [{"answer": math.nan}, {"answer": "x" * 10_000_000}, {"answer": ""}, {}]
)
def test_malformed_result_does_not_raise(result: dict[str, object]) -> None:
    harness = TreeHarness("ask: Yes?", answers={"ask": [ScriptedReply(result=result)]})  # type: ignore[arg-type]
    assert harness.tick() in ("succeeded", "failed")
    assert len(str(harness.changes)) < 10_000


LATCHED = "wait_for: {topic: door, type: std_msgs/msg/Bool, until: msg.data, latched: %s}"


def test_latched_topic_delivers_last_message_at_first_tick() -> None:
    harness = TreeHarness(LATCHED % "true")
    harness.environment.arrive("door", {"data": False})
    harness.environment.arrive("door", {"data": True})
    assert harness.tick() == "succeeded"


def test_remark_on_a_server_follows_the_text(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = "sequence: [{set: {n: 2}}, {say: 'Take ${n}.'}]"
    harness = started(tree, answers={"say": [ScriptedReply(after_s=9.0)]})
    [goal] = harness.environment.goals
    monkeypatch.setattr(type(goal), "message", "its server is busy")
    harness.tick()
    told = [change.message for change in harness.changes if change.path == "tree/1.say"]
    assert told[-1] == "Take 2. (its server is busy)"
