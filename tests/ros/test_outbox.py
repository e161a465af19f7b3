# SPDX-License-Identifier: Apache-2.0
"""The outbox over real DDS, including feedback of trees."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future

from bt_agents.engine.environment import GoalState
from bt_agents.host.environment.feedback_requests import STORED, FeedbackRequests
from bt_agents_core.feedback import FeedbackKind
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.srv import GiveFeedback
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from bt_agents_ros.outbox import Outbox
from tree_harness import SPACE, scene


class Server:
    """A feedback server in a node of its own, with answers of the test's choice."""

    def __init__(self, ros: Any, answers: Callable[[int], str] = lambda _: "accept") -> None:
        self.heard: list[GiveFeedback.Request] = []
        self.never = Future()
        self._answers = answers
        self.node = ros.add(rclpy.create_node(f"server{next(_NUMBERS)}"))
        self.node.create_service(
            GiveFeedback,
            "feedback/give",
            self._serve,
            qos_profile=qos.SERVICE,
            callback_group=ReentrantCallbackGroup(),
        )

    @property
    def ids(self) -> list[str]:
        return [request.feedback_id for request in self.heard]

    async def _serve(self, request: Any, response: Any) -> Any:
        self.heard.append(request)
        how = self._answers(len(self.heard))
        if how == "swallow":
            how = await self.never
        response.accepted = how == "accept"
        code = "STORAGE_FULL" if how == "full" else "NO"
        response.code, response.message = ("", "") if response.accepted else (code, "not so")
        return response


_NUMBERS = itertools.count()


class Sender:
    """An outbox and the answers to it."""

    def __init__(self, ros: Any, **limits: Any) -> None:
        self.answers: list[tuple[str, Any]] = []
        client = ros.node.create_client(GiveFeedback, "feedback/give", qos_profile=qos.SERVICE)
        self.outbox = Outbox(ros.node, client, **limits)

    def put(self, *ids: str) -> None:
        for name in ids:
            self.outbox.put(
                GiveFeedback.Request(feedback_id=name),
                lambda answer, name=name: self.answers.append((name, answer)),
            )

    @property
    def outcomes(self) -> list[tuple[str, bool | None]]:
        return [(name, answer and answer.accepted) for name, answer in self.answers]


def test_unanswered_request_is_resent_under_same_id(ros):
    server = Server(ros, lambda number: "swallow" if number in (1, 2) else "accept")
    sender = Sender(ros, answer_s=0.3)
    sender.put("a", "b")
    ros.until(lambda: len(sender.answers) == 2)
    assert server.ids == ["a", "a", "a", "b"]
    assert sender.outcomes == [("a", True), ("b", True)]


def test_late_answer_ends_resent_request_once(ros):
    server = Server(ros, lambda number: "swallow" if number < 3 else "accept")
    sender = Sender(ros, answer_s=0.5)
    sender.put("a")
    ros.until(lambda: len(server.heard) == 2)
    server.never.set_result("refuse")
    ros.until(lambda: sender.answers)
    assert sender.outcomes == [("a", False)]
    ros.turns()
    assert (len(sender.answers), sender.outbox.waiting) == (1, 0)


def test_request_is_kept_while_server_disk_is_full(ros):
    server = Server(ros, lambda number: "full" if number < 4 else "accept")
    sender = Sender(ros, answer_s=0.2)
    sender.put("a", "b")
    ros.until(lambda: len(server.heard) == 2)
    assert (sender.answers, sender.outbox.waiting, sender.outbox.late) == ([], 2, True)
    ros.until(lambda: len(sender.answers) == 2)
    assert sender.outcomes == [("a", True), ("b", True)]
    assert server.ids == ["a", "a", "a", "a", "b"]
    assert not sender.outbox.late


def test_restarted_server_gets_pending_requests_again(ros):
    first = Server(ros, lambda _: "swallow")
    sender = Sender(ros, answer_s=30.0)
    sender.put("a", "b")
    ros.until(lambda: first.heard)
    ros.remove(first.node)
    ros.until(lambda: sender.outbox.late)
    second = Server(ros)
    ros.until(lambda: len(sender.answers) == 2)
    assert (first.ids, second.ids) == (["a"], ["a", "b"])


def test_full_outbox_drops_oldest_request_and_reports_it(ros):
    sender = Sender(ros, most=2)
    sender.put("a", "b", "c")
    assert (sender.answers, sender.outbox.waiting) == ([("a", None)], 2)
    server = Server(ros)
    ros.until(lambda: len(sender.answers) == 3)
    assert server.ids == ["b", "c"]


def test_thousand_kept_requests_arrive_once_and_in_order(ros):
    sender = Sender(ros)
    names = [str(number) for number in range(1000)]
    sender.put(*names)
    ros.turns()
    assert (sender.answers, sender.outbox.waiting) == ([], 1000)
    server = Server(ros)
    ros.until(lambda: len(sender.answers) == 1000, limit_s=60.0)
    assert (server.ids, sender.outbox.waiting) == (names, 0)
    assert sender.outcomes == [(name, True) for name in names]


# --- the feedback of trees ------------------------------------------------------------------


class Host:
    """The parts of a host for its trees' feedback."""

    def __init__(self, ros: Any) -> None:
        self.wakes = 0
        self.scene = scene_to_msg(scene(age=5, familiarity=1, mood=3))
        self.requests = FeedbackRequests(
            ros.node,
            self._wake,
            run_goal=lambda: RunAgent.Goal(agent="mira", scene=self.scene),
            space=SPACE,
        )

    def _wake(self) -> None:
        self.wakes += 1


def test_tree_feedback_carries_agent_scene_and_unique_id(ros):
    server = Server(ros)
    host = Host(ros)
    runs = [
        host.requests.give(FeedbackKind.POSITIVE, {}, "she smiled"),
        host.requests.give(FeedbackKind.DIRECT, {"age": 4.0}, ""),
    ]
    ros.until(lambda: len(server.heard) == 2)
    ros.until(lambda: all(run.state is GoalState.SUCCEEDED for run in runs))
    assert [run.message for run in runs] == ["", ""]
    assert host.wakes == 2
    positive, direct = server.heard
    assert (positive.agent, positive.kind, positive.source) == ("mira", 1, "tree")
    assert (list(positive.values), positive.scene) == ([], host.scene)
    assert str(list(direct.values)) == "[4.0, nan, nan]"
    assert positive.feedback_id != direct.feedback_id


def test_refused_feedback_is_rejected_with_its_message(ros):
    Server(ros, lambda _: "refuse")
    run = Host(ros).requests.give(FeedbackKind.POSITIVE, {}, "")
    ros.until(lambda: run.state.ended)
    assert (run.state, run.message) == (GoalState.REJECTED, "not so")


def test_tree_continues_without_feedback_node_and_keeps_feedback(ros):
    host = Host(ros)
    run = host.requests.give(FeedbackKind.POSITIVE, {}, "")
    assert run.state is GoalState.ACTIVE
    ros.until(lambda: run.state.ended)
    assert (run.state, run.message, run.confirmed) == (GoalState.SUCCEEDED, STORED, True)
    server = Server(ros)
    ros.until(lambda: server.heard)
    ros.until(lambda: host.requests.outbox.waiting == 0)
    assert len(server.heard) == 1
    assert run.message == STORED


def test_abandoned_feedback_is_sent_with_scene_of_giving(ros):
    host = Host(ros)
    given_for = host.scene
    run = host.requests.give(FeedbackKind.POSITIVE, {}, "")
    run.cancel()
    assert run.state is GoalState.CANCELLED
    host.scene = scene_to_msg(scene(age=1, familiarity=1, mood=1))
    server = Server(ros)
    ros.until(lambda: server.heard)
    assert server.heard[0].scene == given_for
