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
from tree_harness import TreeHarness, started

BEAT = HeartbeatSpec(topic="robot/heartbeat", type="std_msgs/msg/Empty", within_s=1.0)


class Followed:
    """A goal whose server does what the test says."""

    def __init__(
        self,
        kind: BindingKind = BindingKind.ACTION,
        timeouts: Timeouts | None = None,
        heartbeat: HeartbeatSpec | None = None,
    ) -> None:
        self.clock = ManualClock()
        self.beat = -math.inf
        goal = SkillGoal(
            kind=kind,
            name="say",
            type="",
            fields={},
            timeouts=timeouts or Timeouts(),
            heartbeat=heartbeat,
        )
        hear = (lambda: self.beat) if heartbeat is not None else None
        self.track = GoalTrack(goal, self.clock, hear)

    def after(self, seconds: float, there: bool = True) -> GoalState:
        """Let time pass and poll."""
        self.clock.advance(seconds)
        self.track.poll(there)
        return self.track.state

    def cancels(self) -> int:
        """Return the number of cancel requests so far."""
        return sum(self.track.take_cancel() for _ in range(3))


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
    assert subject.after(1.9, there=False) is GoalState.PENDING
    assert not subject.track.confirmed
    assert subject.after(0.1, there=False) is GoalState.UNREACHABLE
    assert subject.track.message == "its server is not there (looked for 2 s)"
    assert subject.track.confirmed
    assert subject.cancels() == 0


def test_abandoned_goal_is_cancelled_on_late_acceptance() -> None:
    subject = sent(timeouts=Timeouts(accept_s=2.0))
    assert subject.after(2.0) is GoalState.UNREACHABLE
    assert subject.track.message == ("its server does not answer (no word about the goal for 2 s)")
    assert (subject.track.confirmed, subject.cancels()) == (False, 0)
    subject.track.accepted()
    assert (subject.track.confirmed, subject.cancels()) == (False, 1)
    assert subject.track.state is GoalState.UNREACHABLE
    subject.track.ended(GoalState.CANCELLED)
    assert subject.track.confirmed
    assert subject.track.state is GoalState.UNREACHABLE


def test_abandoned_goal_needs_no_cancel_after_rejection() -> None:
    subject = sent()
    subject.after(3.0)
    subject.track.ended(GoalState.REJECTED)
    assert subject.track.confirmed
    assert subject.track.state is GoalState.UNREACHABLE
    assert subject.cancels() == 0


def test_cancel_ends_goal_before_sending() -> None:
    subject = Followed()
    subject.track.cancel()
    assert subject.track.state is GoalState.CANCELLED
    assert subject.track.confirmed


def test_early_cancel_takes_effect_once_on_acceptance() -> None:
    subject = sent()
    subject.track.cancel()
    assert (subject.track.state, subject.cancels()) == (GoalState.PENDING, 0)
    subject.track.accepted()
    assert (subject.track.state, subject.cancels()) == (GoalState.ACTIVE, 1)
    subject.track.cancel()
    assert subject.cancels() == 0
    assert not subject.track.confirmed
    subject.track.ended(GoalState.CANCELLED)
    assert (subject.track.state, subject.track.confirmed) == (GoalState.CANCELLED, True)


def test_cancelled_goal_needs_no_cancel_after_rejection() -> None:
    subject = sent()
    subject.track.cancel()
    subject.track.ended(GoalState.REJECTED)
    assert (subject.track.state, subject.track.confirmed) == (GoalState.REJECTED, True)
    assert subject.cancels() == 0


@pytest.mark.parametrize("state", [GoalState.SUCCEEDED, GoalState.ABORTED, GoalState.CANCELLED])
def test_server_result_confirms_goal_end(running: Followed, state: GoalState) -> None:
    running.track.ended(state)
    assert (running.track.state, running.track.confirmed) == (state, True)
    running.track.cancel()
    assert (running.track.state, running.cancels()) == (state, 0)


def pauses(subject: Followed, servers: frozenset[str], seconds: float) -> list[float]:
    """Return the pauses between repeats within some time, with these servers on the graph."""
    found = []
    last = now = 0.0
    while now < seconds:
        if subject.track.is_repeated(servers):
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
    assert not subject.track.is_repeated(frozenset({"a"}))

    found = pauses(subject, frozenset({"a", "b"}), 60.0)

    assert found[:3] == [0.0, GRAPH_S, 2 * GRAPH_S]
    assert found == sorted(found)
    assert 8 < len(found) < 15
    assert not subject.track.is_repeated(frozenset({"b"})), "the lease of the first has ended"
    assert subject.track.is_repeated(frozenset({"b", "c"}))


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
    assert subject.after(0.1) is GoalState.TIMED_OUT
    assert subject.track.message == "no result within 60 s"
    assert (subject.track.confirmed, subject.cancels()) == (False, 1)


def test_result_after_timeout_only_confirms_the_end() -> None:
    subject = sent(timeouts=Timeouts(result_s=60.0))
    subject.track.accepted()
    subject.after(60.0)
    subject.track.ended(GoalState.SUCCEEDED)
    assert (subject.track.state, subject.track.confirmed) == (GoalState.TIMED_OUT, True)
    assert subject.track.message == "no result within 60 s"
    assert subject.cancels() == 0


def test_goal_is_lost_after_server_leaves_graph(running: Followed) -> None:
    running.after(100.0)
    assert running.after(2.9, there=False) is GoalState.ACTIVE
    assert running.after(0.1, there=False) is GoalState.UNREACHABLE
    assert running.track.message == "its server has left the graph (gone for 3 s)"
    assert not running.track.confirmed


def test_goal_survives_brief_server_absence(running: Followed) -> None:
    for _ in range(3):
        assert running.after(2.9, there=False) is GoalState.ACTIVE
        assert running.after(0.1) is GoalState.ACTIVE


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
    assert subject.after(SECOND_POLL_S) is GoalState.UNREACHABLE
    assert subject.track.message == (
        "its server has gone silent (no heartbeat for 1.0 s, nor ever one on robot/heartbeat)"
    )
    assert (subject.track.confirmed, subject.cancels()) == (False, 1)


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
    assert subject.track.state is GoalState.ACTIVE
    assert subject.after(9.9) is GoalState.ACTIVE
    assert subject.after(0.1) is GoalState.TIMED_OUT
    assert subject.track.message == "no answer within 10 s"
    assert (subject.track.confirmed, subject.cancels()) == (True, 0)


def test_abandoned_request_is_over() -> None:
    subject = sent(kind=BindingKind.SERVICE)
    subject.track.cancel()
    assert (subject.track.state, subject.track.confirmed) == (GoalState.CANCELLED, True)


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
        (
            ScriptedReply(
                state=GoalState.UNREACHABLE, message="its server is not there (looked for 3 s)"
            ),
            0.0,
            "dance unreachable: its server is not there (looked for 3 s)",
        ),
        (
            ScriptedReply(accept_s=9.0, after_s=99.0),
            2.0,
            "dance unreachable: its server does not answer (no word about the goal for 2 s)",
        ),
        (
            ScriptedReply(state=GoalState.REJECTED),
            0.0,
            "dance rejected: its server did not take the goal and says nothing about why",
        ),
        (
            ScriptedReply(state=GoalState.ABORTED, message="motor off"),
            0.0,
            "dance aborted: motor off",
        ),
        (
            ScriptedReply(state=GoalState.ABORTED),
            0.0,
            "dance aborted: its server gave up and says nothing about why",
        ),
        (
            ScriptedReply(state=GoalState.CANCELLED),
            0.0,
            "dance cancelled: somebody else has stopped it",
        ),
        (
            ScriptedReply(accept_s=1.0, after_s=99.0),
            61.0,
            "dance timed out: no result within 60 s",
        ),
    ],
)
def test_each_goal_failure_has_its_own_message(
    answer: ScriptedReply, after_s: float, words: str
) -> None:
    harness = started(RAW, answers={"dance": [answer]})
    harness.after(after_s)
    assert harness.reports("tree")[-1] == ("FAILURE", words)


def test_long_server_message_is_truncated() -> None:
    huge = ScriptedReply(state=GoalState.ABORTED, message="x" * 10_000_000)
    harness = TreeHarness(RAW, answers={"dance": [huge]})
    harness.tick(2)
    assert len(harness.message) < 400


def test_run_settles_timed_out_goal_before_ending() -> None:
    stubborn = ScriptedReply(after_s=99.0, cancel_s=1.0)
    harness = started(RAW, answers={"dance": [stubborn]})
    assert harness.after(60.0) == "running"  # it settles
    assert harness.environment.running() == ["dance"]
    assert harness.after(1.0) == "failed"
    assert harness.result.orphans == ()


def test_unconfirmed_goal_is_an_orphan() -> None:
    for lost in (
        ScriptedReply(after_s=99.0, cancel_s=math.inf),
        ScriptedReply(after_s=99.0, vanishes=True),
        ScriptedReply(accept_s=math.inf, after_s=math.inf),
    ):
        harness = TreeHarness(RAW, answers={"dance": [lost]})
        harness.tick()
        harness.after(60.0)
        assert harness.after(2.0) == "failed"
        assert harness.result.orphans == ("tree",)


def test_unsent_goal_is_not_an_orphan() -> None:
    harness = TreeHarness(RAW, answers={"dance": [ScriptedReply(state=GoalState.UNREACHABLE)]})
    assert harness.tick() == "failed"
    assert harness.result.orphans == ()


FOLLOWED = """
parallel:
  - action:
      name: dance
      type: bt_agents_interfaces/action/Say
      outputs: {done: feedback.progress, words: message}
  - sequence:
      - wait_for: done > 0.4
      - say: "half: ${done}"
"""


def test_action_feedback_updates_outputs_during_action() -> None:
    told = ((1.0, {"progress": 0.1}), (2.0, {"progress": 0.5}), (3.0, {"progress": 0.9}))
    harness = TreeHarness(FOLLOWED, answers={"dance": [ScriptedReply(after_s=5.0, feedback=told)]})
    assert harness.tick() == "running"
    assert harness.reports("tree/1.sequence/0.wait_for") == [
        ("RUNNING", "'done' has no value yet")
    ]
    harness.after(1.0)
    assert harness.said == []
    harness.after(1.0)
    harness.tick()
    assert harness.said == ["half: 0.5"]
    assert harness.after(3.0) == "succeeded"


def test_outputs_include_last_feedback_at_action_end() -> None:
    tree = """
    sequence:
      - action:
          name: dance
          type: bt_agents_interfaces/action/Say
          outputs: {done: feedback.progress}
      - say: "${done}"
    """
    told = ScriptedReply(after_s=1.0, feedback=((0.5, {"progress": 1.0}),))
    harness = started(tree, answers={"dance": [told]})
    assert harness.after(1.0) == "succeeded"
    assert harness.said == ["1"]
    harness = TreeHarness(tree, answers={"dance": [ScriptedReply()]})
    assert harness.tick() == "failed"
    assert harness.message.startswith("'done' has no value")


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
