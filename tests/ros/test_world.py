# SPDX-License-Identifier: Apache-2.0
"""Goals whose server is late, absent or gone, log lines and feedback of a tree."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from rcl_interfaces.msg import Log

from bt_agents.engine.scripted_world import ManualClock
from bt_agents.engine.world import GoalState
from bt_agents.feedback import Kind
from bt_agents.ros import qos, world
from bt_agents_interfaces.srv import GiveFeedback
from stage import SPACE

pytestmark = pytest.mark.ros


class Answer:
    """A future that the test completes."""

    def __init__(self) -> None:
        self.value: Any = None
        self._callbacks: list[Callable[[Any], None]] = []

    def add_done_callback(self, callback: Callable[[Any], None]) -> None:
        self._callbacks.append(callback)

    def exception(self) -> None:
        return None

    def result(self) -> Any:
        return self.value

    def complete(self, value: Any) -> None:
        self.value = value
        for callback in self._callbacks:
            callback(self)


class Client:
    """An action client whose server appears, answers and goes as the test says."""

    def __init__(self, ready: bool = True) -> None:
        self.ready = ready
        self.sent = 0
        self.cancelled = 0
        self.acceptance = Answer()
        self.outcome = Answer()

    def server_is_ready(self) -> bool:
        return self.ready

    def send_goal_async(self, _goal: Any) -> Answer:
        self.sent += 1
        return self.acceptance

    def accept(self) -> None:
        self.acceptance.complete(
            SimpleNamespace(
                accepted=True,
                cancel_goal_async=self._cancel,
                get_result_async=lambda: self.outcome,
            )
        )

    def _cancel(self) -> None:
        self.cancelled += 1


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> ManualClock:
    manual = ManualClock()
    monkeypatch.setattr(world, "time", SimpleNamespace(monotonic=manual))
    return manual


def send(client: Client) -> world._ActionRun:
    return world._ActionRun(client, object(), "say", lambda: None)


def test_a_goal_waits_for_its_server_for_a_bounded_time(clock: ManualClock) -> None:
    client = Client(ready=False)
    run = send(client)
    clock.advance(2.9)
    assert run.state is GoalState.PENDING
    clock.advance(0.1)
    assert run.state is GoalState.UNREACHABLE
    assert run.message == "is not there within 3 s"
    assert client.sent == 0


def test_a_goal_that_is_given_up_and_accepted_later_is_cancelled(clock: ManualClock) -> None:
    client = Client()
    run = send(client)
    clock.advance(3.0)
    assert run.state is GoalState.UNREACHABLE
    client.accept()
    assert client.cancelled == 1
    assert run.state is GoalState.UNREACHABLE


def test_a_cancel_before_acceptance_takes_effect_on_acceptance(clock: ManualClock) -> None:
    client = Client()
    run = send(client)
    run.cancel()
    assert client.cancelled == 0
    client.accept()
    assert client.cancelled == 1
    assert run.state is GoalState.ACTIVE


def test_a_server_that_goes_away_in_the_middle_ends_the_goal(clock: ManualClock) -> None:
    client = Client()
    run = send(client)
    client.accept()
    clock.advance(100.0)
    assert run.state is GoalState.ACTIVE
    client.ready = False
    clock.advance(2.9)
    assert run.state is GoalState.ACTIVE
    clock.advance(0.1)
    assert run.state is GoalState.UNREACHABLE
    assert run.message == "has been gone for 3 s"


def test_a_server_that_is_back_in_time_goes_on(clock: ManualClock) -> None:
    client = Client()
    run = send(client)
    client.accept()
    assert run.state is GoalState.ACTIVE
    client.ready = False
    clock.advance(2.0)
    assert run.state is GoalState.ACTIVE
    client.ready = True
    assert run.state is GoalState.ACTIVE
    client.ready = False
    clock.advance(2.0)
    assert run.state is GoalState.ACTIVE


class Teacher:
    """A ``feedback/give`` service that answers as the test says."""

    def __init__(self, ros: Any, *, accepted: bool, message: str = "") -> None:
        self.requests: list[GiveFeedback.Request] = []
        self._accepted = accepted
        self._message = message
        ros.node.create_service(
            GiveFeedback, "feedback/give", self._answer, qos_profile=qos.SERVICE
        )

    def _answer(
        self, request: GiveFeedback.Request, response: GiveFeedback.Response
    ) -> GiveFeedback.Response:
        self.requests.append(request)
        response.accepted = self._accepted
        response.code = "" if self._accepted else "NO_SCENE"
        response.message = self._message
        return response


def world_of(ros: Any) -> world.RosWorld:
    return world.RosWorld(ros.node, lambda: None, space=SPACE, agent=lambda: "guide")


def test_log_lines_come_under_the_name_of_the_running_agent_at_their_level(ros: Any) -> None:
    lines = ros.collect(Log, "/rosout", qos.HISTORY)
    subject = world_of(ros)
    for level in ("info", "warning", "error", "info"):
        subject.log(level, f"this is {level}")
    told = [("this is info", 20), ("this is warning", 30), ("this is error", 40)]
    ros.until(
        lambda: (
            [(line.msg, line.level) for line in lines if line.name == "probe.guide"]
            == [*told, told[0]]
        )
    )


def test_direct_feedback_is_sent_in_the_order_of_the_scene_without_opinion_on_the_rest(
    ros: Any,
) -> None:
    teacher = Teacher(ros, accepted=True)
    run = world_of(ros).give_feedback(Kind.DIRECT, {"mood": 5.0, "age": 4.0}, "it went well")
    ros.until(lambda: run.state.ended)
    assert run.state is GoalState.SUCCEEDED
    [request] = teacher.requests
    assert (request.agent, request.kind, request.source) == ("guide", Kind.DIRECT, "tree")
    assert request.reason == "it went well"
    assert SPACE.names == ("age", "familiarity", "mood")
    assert request.values[0] == 4.0
    assert math.isnan(request.values[1])
    assert request.values[2] == 5.0


def test_positive_feedback_has_no_values_and_a_refusal_comes_with_its_words(ros: Any) -> None:
    teacher = Teacher(ros, accepted=False, message="there is no scene to learn from")
    run = world_of(ros).give_feedback(Kind.POSITIVE, {}, "")
    ros.until(lambda: run.state.ended)
    assert run.state is GoalState.REJECTED
    assert run.message == "there is no scene to learn from"
    assert list(teacher.requests[0].values) == []


def test_feedback_that_nobody_takes_is_unreachable(ros: Any, clock: ManualClock) -> None:
    run = world_of(ros).give_feedback(Kind.NEGATIVE, {}, "")
    assert run.state is GoalState.PENDING
    clock.advance(3.0)
    assert run.state is GoalState.UNREACHABLE
    assert run.message == "is not there within 3 s"
