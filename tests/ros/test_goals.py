# SPDX-License-Identifier: Apache-2.0
"""Goals, requests and topics of trees against servers that are late, stubborn, dead or hostile."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionServer
from std_msgs.msg import Bool, ByteMultiArray, String
from std_srvs.srv import SetBool, Trigger

from bt_agents.engine.environment import GoalRun, GoalState, SkillGoal
from bt_agents.host.environment import graph_problems, ros_environment
from bt_agents.host.environment.goal import MOST_UNCONFIRMED
from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents.host.environment.ros_environment import RosEnvironment
from bt_agents.host.environment.subscriptions import DEPTH
from bt_agents_core.field_types import BindingKind
from bt_agents_interfaces.action import Ask, RunAgent
from bt_agents_language.model.specs import HeartbeatSpec, NodeSpec, Timeouts, iter_nodes
from bt_agents_ros import goal_cancellation, qos
from bt_agents_ros.types import MessageView
from scripted_server import Script, ScriptedServer, ScriptedService
from stranger import Stranger
from tree_harness import SPACE, agent

SAY = SkillGoal(
    kind=BindingKind.ACTION,
    name="say",
    type="bt_agents_interfaces/action/Say",
    fields={"text": "Hello."},
)
SWITCH = SkillGoal(
    kind=BindingKind.SERVICE, name="switch", type="std_srvs/srv/SetBool", fields={"data": True}
)
TREE = """
sequence:
  - say: Hello.
  - service: {name: switch, type: std_srvs/srv/SetBool, request: {data: true}}
  - publish: {topic: sound, type: std_msgs/msg/String, message: {data: ping}}
  - wait_for: {topic: door, type: std_msgs/msg/Bool, latched: true}
"""
OF_TREE = {"say", "switch", "sound", "door", "robot/heartbeat"}
BEAT = HeartbeatSpec(topic="robot/heartbeat", type="std_msgs/msg/Empty", within_s=0.4)


class Host:
    """An environment, and how often it has woken its tree."""

    def __init__(
        self, ros: Any, run_goal: RunAgent.Goal | None = None, slowness: float = 1.0
    ) -> None:
        self.woken = 0
        self.seen = 0
        self.node = ros.add(rclpy.create_node("host"))
        self.environment = RosEnvironment(
            self.node,
            self._wake,
            run_goal=lambda: run_goal,
            open_goals=OpenGoalList(self.node, "first", lambda: None),
            space=SPACE,
            slowness=slowness,
        )
        self._ros = ros

    def _wake(self) -> None:
        self.woken += 1

    def servers(self) -> list[Any]:
        """Return the servers of the action that the graph shows."""
        return self.node.get_publishers_info_by_topic("/say/_action/status")

    def problems(self) -> Mapping[str, str]:
        """Look at the graph again; return what it shows against the trees."""
        self.environment.look_again()
        return self.environment.graph_problems.messages

    def client(self) -> Any:
        """Return the client of the action."""
        return self.environment._client(SAY.kind, SAY.name, SAY.type)

    def prepare(self, tree: str) -> list[NodeSpec]:
        """Prepare the nodes of a tree; return them."""
        nodes = list(iter_nodes(agent(tree).tree))
        for node in nodes:
            self.environment.prepare(node)
        return nodes

    def entities(self) -> list[Any]:
        """Return all entities of the node."""
        node = self.node
        return [*node.waitables, *node.clients, *node.publishers, *node.subscriptions]

    def used(self) -> set[str]:
        """Return the names on the graph that the node uses for its trees."""
        names = {one._action_name for one in self.node.waitables if hasattr(one, "_action_name")}
        names |= {one.srv_name for one in self.node.clients}
        names |= {one.topic_name for one in (*self.node.publishers, *self.node.subscriptions)}
        return {name.removeprefix("/") for name in names} & OF_TREE

    def send(self, goal: SkillGoal = SAY, **changes: Any) -> GoalRun:
        """Send a goal."""
        self.seen = self.woken
        return self.environment.send(replace(goal, **changes))

    def accepted(self, goal: SkillGoal = SAY, **changes: Any) -> GoalRun:
        """Send a goal and wait until it is accepted."""
        run = self.send(goal, **changes)
        self._ros.until(lambda: run.state is GoalState.ACTIVE)
        return run


@pytest.fixture
def host(ros: Any) -> Iterator[Host]:
    """The environment of a host."""
    subject = Host(ros)
    yield subject
    subject.environment.close()


def taken(inbox: Any) -> list[Any]:
    """Return the data of all messages that a leaf has not read."""
    found = []
    while (message := inbox.take()) is not None:
        found.append(message["data"])
    return found


def news(ros: Any, host: Host, run: GoalRun) -> GoalState:
    """Spin until the last goal wakes the tree; return the state of the goal."""
    ros.until(lambda: host.woken > host.seen)
    host.seen = host.woken
    return run.state


def test_goal_carries_run_key_when_its_type_allows(ros: Any) -> None:
    host = Host(ros, run_goal=RunAgent.Goal(epoch="e1", round=7, agent="guide"))
    server, service = (
        ScriptedServer(ros),
        ScriptedService(ros, SetBool, "switch", lambda _, answer: answer),
    )
    said, switched = host.send(), host.send(SWITCH)
    ros.until(lambda: service.requests)
    service.answer(0)
    ros.until(lambda: said.state is switched.state is GoalState.SUCCEEDED)
    run = server.goals[0].request.run
    assert (run.epoch, run.round, run.agent) == ("e1", 7, "guide")
    host.environment.close()


def test_slow_network_extends_server_timeouts(ros: Any) -> None:
    host = Host(ros, slowness=3.0)
    run = host.send(timeouts=Timeouts(server_s=0.2))
    assert news(ros, host, run) is GoalState.UNREACHABLE
    assert run.message == "its server is not there (looked for 0.6 s)"
    host.environment.close()


def test_goal_waits_for_starting_server(ros: Any, host: Host) -> None:
    run = host.send()
    ros.turns(3)
    assert run.state is GoalState.PENDING
    server = ScriptedServer(ros, script=Script(result={"message": "well"}))
    assert news(ros, host, run) is GoalState.SUCCEEDED
    assert run.result["message"] == "well"
    assert run.confirmed
    assert [goal.request.text for goal in server.goals] == ["Hello."]


def test_rejection_abort_and_foreign_cancel_differ(ros: Any, host: Host) -> None:
    server = ScriptedServer(ros, script=Script(rejects=True))
    run = host.send()
    assert news(ros, host, run) is GoalState.REJECTED
    server.script = Script(aborts=True, result={"message": "motor off"})
    run = host.send()
    assert news(ros, host, run) is GoalState.ABORTED
    assert run.result["message"] == "motor off"
    server.script = Script(finish_s=None)
    run = host.accepted()
    ros.until(lambda: len(server.goals) == 3)
    server.goals[2].stop()
    # There was no cancel request, so the server cannot report it as cancelled.
    assert news(ros, host, run) in (GoalState.ABORTED, GoalState.CANCELLED)


def test_goal_cancelled_before_server_appears_is_never_sent(ros: Any, host: Host) -> None:
    run = host.send()
    run.cancel()
    assert (run.state, run.confirmed) == (GoalState.CANCELLED, True)
    server = ScriptedServer(ros)
    ros.turns(40)
    assert server.goals == []


def test_late_result_never_ends_later_goal(ros: Any, host: Host) -> None:
    patience = Timeouts(server_s=30.0, accept_s=30.0, result_s=0.2)
    server = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="ignores"))
    late = host.send(timeouts=patience)
    assert news(ros, host, late) is GoalState.TIMED_OUT
    assert late.message == "no result within 0.2 s"
    ros.until(lambda: server.goals[0].cancels == 1)
    next_one = host.accepted()
    server.goals[0].finish()
    ros.until(lambda: late.confirmed)
    assert late.state is GoalState.TIMED_OUT
    assert next_one.state is GoalState.ACTIVE
    server.goals[1].finish()
    ros.until(lambda: next_one.state.ended)
    assert next_one.state is GoalState.SUCCEEDED


def test_next_goal_waits_until_server_ends_previous_one(ros: Any, host: Host) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None, cancel_s=0.5))
    first = host.accepted()
    first.cancel()
    second = host.send()
    assert second.message == "its server has not ended the goal before yet"
    ros.until(lambda: second.state is GoalState.ACTIVE)
    assert first.confirmed
    assert [goal.outcome for goal in server.goals] == ["cancelled", ""]
    assert second.message == ""


def test_goal_given_up_for_good_delays_no_other(
    ros: Any, host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_environment, "PURSUED_S", 0.3)
    ScriptedServer(ros, script=Script(finish_s=None, on_cancel="refuses"))
    first = host.accepted(timeouts=Timeouts(result_s=0.1))
    assert news(ros, host, first) is GoalState.TIMED_OUT
    assert host.send().message == "its server has not ended the goal before yet"
    ros.until(lambda: host.send().message == "")
    assert not first.confirmed


def test_unresponsive_server_gets_next_goal_after_timeout(ros: Any, host: Host) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="refuses"))
    first = host.accepted()
    first.cancel()
    server.script = Script(rejects=True)
    second = host.send()
    ros.until(lambda: second.state.ended)
    assert not first.confirmed
    assert second.state is GoalState.REJECTED
    assert second.message == "its server had not ended the goal before after 2 s"


def test_late_acceptance_by_second_server_is_cancelled(ros: Any, host: Host) -> None:
    hasty = ScriptedServer(ros, node="hasty", script=Script(rejects=True))
    late = ScriptedServer(ros, node="late", script=Script(accept_s=1.0, finish_s=None))
    ros.until(lambda: len(host.servers()) == 2)
    run = host.send()
    ros.until(lambda: run.state.ended)
    assert run.state is GoalState.REJECTED
    assert "2 servers offer the action /say, of /hasty, /late" in run.message
    assert not run.confirmed
    ros.until(lambda: run.confirmed)
    assert late.goals[0].outcome == "cancelled"
    hasty.die()
    ros.until(lambda: len(host.servers()) == 1)
    assert host.problems() == {}


def test_first_servers_result_stops_second_server(ros: Any, host: Host) -> None:
    ScriptedServer(ros, node="quick", script=Script(finish_s=0.3))
    slow = ScriptedServer(ros, node="slow", script=Script(finish_s=None))
    ros.until(lambda: len(host.servers()) == 2)
    run = host.accepted()
    assert [*host.environment.graph_problems.messages] == ["/say"]
    ros.until(lambda: run.confirmed)
    ros.until(lambda: slow.goals[0].outcome == "cancelled")


def test_duplicate_servers_are_told_before_first_goal(
    ros: Any, host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_environment, "COUNT_S", 0.0)
    monkeypatch.setattr(graph_problems, "FORGOTTEN_S", 0.0)
    ScriptedServer(ros, node="one")
    ScriptedServer(ros, node="other")
    for node in (ros.node, ros.add(rclpy.create_node("third"))):
        node.create_service(Trigger, "reset", lambda _request, response: response)
    host.prepare("say: hello")
    host.prepare("service: {name: reset, type: std_srvs/srv/Trigger}")

    ros.until(lambda: len(host.problems()) == 2)
    assert sorted(host.problems().values()) == [
        "2 servers offer the action /say, of /one, /other: each may act; stop all but one",
        "2 servers offer the service /reset: each may act; stop all but one",
    ]
    host.environment.retain([])
    assert host.problems() == {}


def test_server_leaving_graph_is_noticed(ros: Any, host: Host) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None))
    run = host.accepted(timeouts=Timeouts(server_s=0.5))
    server.die()
    assert news(ros, host, run) is GoalState.UNREACHABLE
    assert run.message == "its server has left the graph (gone for 0.5 s)"
    assert not run.confirmed


def test_cancel_ends_goal_unknown_to_restarted_server(ros: Any, host: Host) -> None:
    server = ScriptedServer(ros, script=Script(finish_s=None))
    run = host.accepted(timeouts=Timeouts(server_s=20.0))
    server.die()
    ScriptedServer(ros, script=Script(finish_s=None))
    ros.until(host.client().server_is_ready)
    run.cancel()
    assert news(ros, host, run) is GoalState.UNREACHABLE
    assert "knows nothing of the goal" in run.message
    ros.until(lambda: run.confirmed)


SPEAK = """
action:
  name: say
  type: bt_agents_interfaces/action/Say
  heartbeat: {topic: robot/heartbeat, type: std_msgs/msg/Empty, within: 400 ms}
"""


def test_missing_server_heartbeat_is_noticed_without_tick(ros: Any, host: Host) -> None:
    host.prepare(SPEAK)
    server = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="ignores"))
    server.beat(every_s=0.05)
    run = host.accepted(heartbeat=BEAT)
    end = time.monotonic() + 1.0
    ros.until(lambda: time.monotonic() > end)
    assert run.state is GoalState.ACTIVE
    server.fall_silent()
    assert news(ros, host, run) is GoalState.UNREACHABLE
    assert re.fullmatch(r"its server has gone silent \(no heartbeat for \d+\.\d s\)", run.message)
    assert not run.confirmed
    ros.until(lambda: server.goals[0].cancels == 1)


def test_feedback_wakes_tree_only_when_leaf_uses_it(ros: Any, host: Host) -> None:
    told = ((0.05, {"progress": 0.25}), (0.1, {"progress": 0.5}))
    server = ScriptedServer(ros, script=Script(finish_s=None, feedback=told))
    run = host.accepted(feedback=True)
    ros.until(lambda: run.feedback is not None and run.feedback["progress"] == 0.5)
    assert run.feedback is run.feedback
    other = host.accepted()
    woken = host.woken
    ros.until(lambda: len(server.goals) == 2)
    ros.turns(30)
    assert (other.feedback, host.woken) == (None, woken)


def test_oversized_result_makes_goal_unreachable(ros: Any, host: Host) -> None:
    script = Script(finish_s=0.2, result={"answer": "x" * 10_000_000})
    ScriptedServer(ros, "ask", kind=Ask, script=script)
    run = host.send(replace(SAY, name="ask", type="bt_agents_interfaces/action/Ask"))
    ros.until(lambda: run.state.ended)
    assert run.state is GoalState.UNREACHABLE
    assert run.message.startswith("its answer cannot be read: TOO_LARGE: Ask_GetResult_Response")


def test_message_view_converts_only_accessed_fields() -> None:
    view = MessageView(ByteMultiArray(data=[b"x"] * 1_000_000))
    assert set(view) == {"layout", "data"}
    assert view["layout"] == {"dim": [], "data_offset": 0}
    assert view["layout"] is view["layout"]
    assert list(view._converted) == ["layout"]
    assert "size" not in view
    with pytest.raises(KeyError):
        view["size"]


def test_unsendable_goal_is_unreachable(
    ros: Any, host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise RuntimeError("the middleware is out of memory")

    monkeypatch.setattr(host.client(), "send_goal_async", refuse)
    ScriptedServer(ros)
    run = host.send()
    assert news(ros, host, run) is GoalState.UNREACHABLE
    assert run.message == "it cannot be sent: the middleware is out of memory"
    assert run.confirmed


def test_number_of_remembered_unconfirmed_goals_is_limited(
    ros: Any, host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The server does not know the goals, and would confirm that at the second cancel.
    monkeypatch.setattr(goal_cancellation, "CANCEL_AGAIN_S", 300.0)
    server = ScriptedServer(ros, script=Script(accept_s=None))
    ros.until(host.client().server_is_ready)
    runs = [host.send(timeouts=Timeouts(accept_s=0.05)) for _ in range(MOST_UNCONFIRMED + 20)]
    ros.until(lambda: all(run.state.ended for run in runs))
    ros.until(lambda: len(server.goals) == len(runs))
    ros.until(lambda: len(host.client()._pending_goal_requests) == MOST_UNCONFIRMED)
    assert len(host.environment._deadlines._unconfirmed) == MOST_UNCONFIRMED


def switch(ros: Any) -> ScriptedService:
    """Return a service that echoes the number of its request."""
    service: ScriptedService

    def fill(request: Any, response: Any) -> None:
        response.success = request.data
        number = next(at for at, one in enumerate(service.requests) if one is request)
        response.message = f"request {number}"

    service = ScriptedService(ros, SetBool, "switch", fill)
    return service


def test_late_answer_is_not_taken_for_next_request(ros: Any, host: Host) -> None:
    service = switch(ros)
    late = host.send(SWITCH, timeouts=Timeouts(server_s=30.0, result_s=0.2))
    assert news(ros, host, late) is GoalState.TIMED_OUT
    assert late.message == "no answer within 0.2 s"
    assert late.confirmed
    next_one = host.accepted(SWITCH)
    ros.until(lambda: len(service.patience) == 2)
    service.answer(0)
    ros.turns()
    assert next_one.state is GoalState.ACTIVE
    service.answer(1)
    ros.until(lambda: next_one.state.ended)
    assert next_one.result["message"] == "request 1"
    assert (late.state, dict(late.result)) == (GoalState.TIMED_OUT, {})


def test_topic_is_subscribed_only_while_leaf_waits(ros: Any, host: Host) -> None:
    publisher = ros.node.create_publisher(Bool, "button", 10)
    host.prepare("wait_for: {topic: button, type: std_msgs/msg/Bool}")
    ros.turns(5)
    assert publisher.get_subscription_count() == 0
    inbox = host.environment.watch("button", "std_msgs/msg/Bool")
    ros.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Bool(data=True))
    ros.until(lambda: host.woken)
    assert taken(inbox) == [True]
    inbox.close()
    ros.until(lambda: publisher.get_subscription_count() == 0)


def test_latched_topic_starts_with_its_last_message(ros: Any, host: Host) -> None:
    publisher = ros.node.create_publisher(Bool, "door", qos.FACT)
    publisher.publish(Bool(data=False))
    publisher.publish(Bool(data=True))
    host.prepare("wait_for: {topic: door, type: std_msgs/msg/Bool, latched: true}")
    ros.until(lambda: host.environment._latched["door", "std_msgs/msg/Bool"]._last is not None)
    assert host.woken == 0
    for _ in range(2):
        inbox = host.environment.watch("door", "std_msgs/msg/Bool", latched=True)
        assert taken(inbox) == [True]
        inbox.close()
        inbox.close()
    inbox = host.environment.watch("door", "std_msgs/msg/Bool", latched=True)
    inbox.take()
    publisher.publish(Bool(data=False))
    ros.until(lambda: host.woken == 1)
    assert taken(inbox) == [False]
    assert publisher.get_subscription_count() == 1


@pytest.mark.parametrize("profile", [qos.EVENTS, qos.SENSOR], ids=["volatile", "best effort"])
def test_latched_inbox_receives_from_volatile_publishers(
    ros: Any, host: Host, profile: Any
) -> None:
    publisher = ros.node.create_publisher(Bool, "door", profile)
    inbox = host.environment.watch("door", "std_msgs/msg/Bool", latched=True)

    def is_heard() -> bool:
        host.environment.look_again()
        return publisher.get_subscription_count() > 0

    ros.until(is_heard)
    publisher.publish(Bool(data=True))
    ros.until(lambda: host.woken == 1)
    assert taken(inbox) == [True]


def test_topic_type_mismatch_is_a_problem(ros: Any, host: Host, stranger: Stranger) -> None:
    publisher = stranger.node.create_publisher(String, "door", qos.EVENTS)
    inbox = host.environment.watch("door", "std_msgs/msg/Bool")
    ros.until(host.problems)
    said = "door is published as std_msgs/msg/String, expected std_msgs/msg/Bool"
    assert (host.problems(), inbox.problem) == ({"door": said}, said)
    stranger.node.destroy_publisher(publisher)
    ros.until(lambda: not host.problems())
    assert inbox.problem == ""
    inbox.close()


def test_latched_message_without_publisher_is_a_problem(ros: Any, host: Host) -> None:
    publisher = ros.node.create_publisher(Bool, "door", qos.FACTS)
    publisher.publish(Bool(data=True))
    host.environment.watch("door", "std_msgs/msg/Bool", latched=True).close()
    ros.until(lambda: host.environment._latched["door", "std_msgs/msg/Bool"].keeps_message)
    assert host.problems() == {}
    ros.node.destroy_publisher(publisher)
    ros.until(host.problems)
    said = "the last message of door counts, though nothing publishes it any more"
    assert host.problems() == {"door": said}
    host.environment.retain([])
    assert host.problems() == {}


def test_server_type_mismatch_is_named(ros: Any, host: Host, stranger: Stranger) -> None:
    server = ActionServer(stranger.node, Ask, "say", lambda _goal: Ask.Result())
    ros.until(lambda: len(host.servers()) == 1)
    run = host.send(timeouts=Timeouts(server_s=0.3))
    ros.until(lambda: run.state.ended)
    assert run.state is GoalState.UNREACHABLE
    assert run.message == (
        "its server is not there (looked for 0.3 s); the graph shows say as "
        "bt_agents_interfaces/action/Ask, expected bt_agents_interfaces/action/Say"
    )
    server.destroy()


def test_inbox_keeps_newest_messages_of_burst(ros: Any, host: Host) -> None:
    publisher = ros.node.create_publisher(String, "words", qos.FACTS)
    host.prepare("wait_for: {topic: words, type: std_msgs/msg/String, latched: true}")
    ros.until(lambda: publisher.get_subscription_count() == 1)
    inbox = host.environment.watch("words", "std_msgs/msg/String", latched=True)
    count = 3 * DEPTH
    for number in range(count):
        publisher.publish(String(data=str(number)))
    ros.until(lambda: host.woken == count)
    assert taken(inbox) == [str(number) for number in range(count - DEPTH, count)]


def test_only_unused_entities_leave_graph(host: Host) -> None:
    nodes = host.prepare(TREE)
    assert host.used() == OF_TREE
    before = host.entities()
    host.environment.retain(nodes)
    assert host.entities() == before
    host.environment.retain(spec for spec in nodes if spec.kind != "say")
    assert host.used() == {"switch", "sound", "door"}
    host.environment.retain([])
    assert host.used() == set()
    host.prepare(TREE)
    assert host.used() == OF_TREE


def test_unconfirmed_goal_keeps_its_client(ros: Any, host: Host) -> None:
    server = ScriptedServer(ros, script=Script(accept_s=None, finish_s=None))
    host.prepare("say: Hello.")
    run = host.send(timeouts=Timeouts(server_s=30.0, accept_s=0.1))
    ros.until(lambda: run.state.ended and server.goals)
    assert run.message.startswith("its server does not answer")
    assert not run.confirmed
    host.environment.retain([])
    assert host.used() == {"say"}
    server.goals[0].accept()
    ros.until(lambda: run.confirmed)
    assert (server.goals[0].cancels, server.goals[0].outcome) == (1, "cancelled")
    assert run.state is GoalState.UNREACHABLE
    host.environment.retain([])
    assert host.used() == set()
    ros.turns(5)
