# SPDX-License-Identifier: Apache-2.0
"""Cancellation of another process's goals, whatever their server does."""

from __future__ import annotations

from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import MOST_OPEN_GOALS, OpenGoal
from bt_agents_interfaces.action import Say
from bt_agents_interfaces.msg import OpenGoal as OpenGoalMsg
from bt_agents_interfaces.msg import OpenGoals
from bt_agents_ros.goal_cancellation import (
    CANCEL_AGAIN_S,
    CancelledGoal,
    GoalCanceller,
    open_goals_from_msg,
)
from scripted_server import Script, ScriptedServer

ANSWER = CancelGoal.Response
LONG_S, SHORT_S = 30.0, 0.6


class Client:
    """Sends goals, and cancels goals of others only by their ids."""

    def __init__(self, ros: Any) -> None:
        self.ros = ros
        self.canceller = GoalCanceller(ros.node)
        self.action = ActionClient(ros.node, Say, "say")
        self.ends: list[tuple[OpenGoal, ...]] = []

    def send(self) -> OpenGoal:
        """Send a goal, and wait until it is accepted."""
        self.ros.until(self.action.server_is_ready)
        handle = self.ros.result(self.action.send_goal_async(Say.Goal(text="Hello.")))
        assert handle.accepted
        return OpenGoal(path="tree", action="/say", goal_id=bytes(handle.goal_id.uuid))

    def cancel(self, *goals: OpenGoal, within_s: float = LONG_S) -> tuple[OpenGoal, ...]:
        """Cancel goals; return those without a confirmed end."""
        self.canceller.cancel(goals, within_s=within_s, on_end=self.ends.append)
        self.ros.until(lambda: self.ends)
        [unconfirmed] = self.ends
        return unconfirmed


@pytest.fixture
def client(ros: Any) -> Any:
    subject = Client(ros)
    yield subject
    subject.action.destroy()


def entities(ros: Any) -> tuple[int, int]:
    return len(list(ros.node.clients)), len(list(ros.node.subscriptions))


def test_canceller_stops_goal_by_id_and_leaves_nothing(ros: Any, client: Client) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None, cancel_s=0.2))
    stopped, other = client.send(), client.send()
    before = entities(ros)
    assert client.cancel(stopped) == ()
    assert entities(ros) == before
    assert [goal.outcome for goal in server.goals] == ["cancelled", ""]
    assert other.goal_id != stopped.goal_id


@pytest.mark.parametrize("on_cancel", ["refuses", "ignores", "hangs"])
def test_canceller_waits_limited_time_for_unresponsive_server(
    ros: Any, client: Client, on_cancel: str
) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None, on_cancel=on_cancel))
    goal = client.send()
    assert client.cancel(goal, within_s=SHORT_S) == (goal,)
    assert server.goals[0].cancels >= 1
    assert server.goals[0].outcome == ""


def test_canceller_waits_for_already_stopping_goal(ros: Any, client: Client) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="ignores"))
    goal = client.send()
    first = GoalCanceller(ros.node)
    gone: list[Any] = []
    first.cancel([goal], within_s=SHORT_S, on_end=gone.append)
    ros.until(lambda: gone)
    client.canceller.cancel([goal], within_s=LONG_S, on_end=client.ends.append)
    ros.turns(60)
    assert client.ends == [], "a server says of it that it is terminated, though it goes on"
    server.goals[0].stop()
    ros.until(lambda: client.ends)
    assert client.ends == [()]


def test_ended_or_unknown_goal_needs_no_wait(ros: Any, client: Client) -> None:
    ScriptedServer(ros)
    ended = client.send()
    unknown = OpenGoal(path="tree", action="/say", goal_id=b"7" * 16)
    assert client.cancel(ended, unknown) == ()


def test_goals_of_absent_server_are_not_confirmed(ros: Any, client: Client) -> None:
    goal = OpenGoal(path="tree", action="/nobody", goal_id=b"7" * 16)
    assert client.cancel(goal, within_s=SHORT_S) == (goal,)


def test_terminal_status_in_status_list_ends_goal() -> None:
    for status in (
        GoalStatus.STATUS_SUCCEEDED,
        GoalStatus.STATUS_CANCELED,
        GoalStatus.STATUS_ABORTED,
    ):
        goal = CancelledGoal()
        goal.on_states(GoalStatus.STATUS_EXECUTING)
        assert not goal.ended
        goal.on_states(status)
        assert goal.ended


def test_two_consecutive_unknown_answers_end_goal() -> None:
    goal = CancelledGoal()
    goal.on_answer(ANSWER.ERROR_UNKNOWN_GOAL_ID, now=0.0)
    goal.on_answer(ANSWER.ERROR_NONE, now=0.0)
    goal.on_answer(ANSWER.ERROR_UNKNOWN_GOAL_ID, now=0.0)
    assert not goal.ended
    goal.on_answer(ANSWER.ERROR_UNKNOWN_GOAL_ID, now=0.0)
    assert goal.ended


@pytest.mark.parametrize("listed", [None, GoalStatus.STATUS_CANCELING])
def test_terminated_answer_ends_only_unlisted_goal(listed: int | None) -> None:
    goal = CancelledGoal()
    for _ in range(3):
        goal.on_answer(ANSWER.ERROR_GOAL_TERMINATED, now=0.0)
    assert not goal.ended, "without a list it may still be stopping"
    goal.on_states(listed)
    for _ in range(3):
        goal.on_answer(ANSWER.ERROR_GOAL_TERMINATED, now=0.0)
    assert goal.ended is (listed is None)


def test_cancel_is_resent_until_goal_ends() -> None:
    goal = CancelledGoal()
    sent = [now for now in range(100, 110) if goal.take_cancel(now * CANCEL_AGAIN_S / 2)]
    assert sent == [100, 102, 104, 106, 108]
    goal.on_states(GoalStatus.STATUS_CANCELED)
    assert not goal.take_cancel(1e9)


@pytest.mark.parametrize(
    ("accepted_by", "answers", "took_s"), [(None, 2, 0.25), (99.0, 8, 0.4375), (102.0, 33, 2.0)]
)
def test_several_servers_may_accept_goal_until_a_time(
    accepted_by: float | None, answers: int, took_s: float
) -> None:
    goal = CancelledGoal(accepted_by)
    now, sent = 100.0, 0
    while not goal.ended:
        if goal.take_cancel(now):
            sent += 1
            goal.on_answer(ANSWER.ERROR_UNKNOWN_GOAL_ID, now)
            ended_at = now
        now += CANCEL_AGAIN_S / 16
    assert (sent, ended_at) == (answers, 100.0 + took_s)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (OpenGoals(goals=[OpenGoalMsg(action="/say")]), "BAD_GOAL"),
        (OpenGoals(goals=[OpenGoalMsg(action="say", goal_id=[1] * 16)]), "BAD_GOAL"),
        (OpenGoals(goals=[OpenGoalMsg()] * (MOST_OPEN_GOALS + 1)), "TOO_MANY"),
        (OpenGoals(host="/" + "h" * 1000), "TOO_LONG"),
        (OpenGoals(heartbeat="/" + "h" * 1000), "TOO_LONG"),
    ],
)
def test_invalid_open_goals_list_is_refused(message: OpenGoals, code: str) -> None:
    with pytest.raises(Refused) as refused:
        open_goals_from_msg(message)
    assert refused.value.code == code
