# SPDX-License-Identifier: Apache-2.0
"""Streams for the tools of py_trees_ros, used by its watchers and its viewer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool, String

from bt_agents.engine.ticker import Ticker
from bt_agents.host.node import HostNode
from bt_agents.host.tree_streams import stream as streams
from bt_agents_interfaces.action import RunAgent
from bt_agents_ros import qos
from compiled_types import compiled_types
from fake_market import Market, folder, make_host, never_held_up

HEAD = (
    "format: 1\nagent: {0}\ntitle: {0}\ndescription: {0}\n"
    "profile: {{age: 3, familiarity: 3, mood: 3}}\n"
)
SHOWER = (
    HEAD.format("shower")
    + """tunables: {patience: {default: 5 s, min: 1 s, max: 9 s, description: how long}}
tree:
  sequence:
    - set: {word: hello}
    - parallel:
        succeed_on: one
        children:
          - wait_for: {topic: button, type: std_msgs/msg/Bool, until: msg.data}
            timeout: ${patience}
          - check: scene.age > 90
            retry: {attempts: forever, pause: 60 s}
    - choose:
        children:
          - name: greeted
            when: word == 'hello'
            set: {word: good-bye}
        otherwise: {wait: 0 s}
on_cancel: {set: {word: sorry}}
"""
)
QUICK = HEAD.format("quick") + "tree: {set: {word: quick}}\n"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
VOLATILE = QoSProfile(depth=1)


@pytest.fixture(scope="module", autouse=True)
def types() -> Iterator[None]:
    with compiled_types():
        yield


class Watcher:
    """Does what the watchers of py_trees_ros do: opens a stream, and subscribes to it."""

    def __init__(self, ros: Any, host: HostNode, market: Market) -> None:
        from py_trees_ros_interfaces import msg, srv

        self.ros = ros
        self.host = host
        self.market = market
        self.msg = msg
        self.srv = srv

    def run(self, agent: str, **changes: Any) -> Any:
        """Run an agent; return the handle of its goal."""
        return self.market.send(self.market.goal(self.host, agent, **changes))

    def show(self) -> Any:
        """Run the agent ``shower``; return the handle of its goal after the first tick."""
        handle = self.run("shower")
        self.ros.until(lambda: self.host._runs.run and self.host._runs.run.ticks)
        return handle

    def press(self) -> None:
        """Press the button for which the agent ``shower`` waits."""
        publisher = self.ros.node.create_publisher(Bool, "button", 1)
        self.ros.until(publisher.get_subscription_count)
        publisher.publish(Bool(data=True))

    def until_watched(self) -> None:
        """Wait until the host knows that somebody watches."""
        self.ros.until(lambda: self.host._tree_streams._watched)

    def open(self, topic: str = "", **parameters: Any) -> str:
        """Open a snapshot stream; return its topic, empty if it is refused."""
        answer = self.call(
            "snapshot_streams/open",
            "OpenSnapshotStream",
            topic_name=topic,
            parameters=self.parameters(**parameters),
        )
        return str(answer.topic_name)

    def call(self, service: str, kind: str, **fields: Any) -> Any:
        return self.ros.ask(getattr(self.srv, kind), f"/agents/{service}", **fields)

    def parameters(
        self, period: float = math.inf, *, data: bool = True, activity: bool = True
    ) -> Any:
        return self.msg.SnapshotStreamParameters(
            snapshot_period=period, blackboard_data=data, blackboard_activity=activity
        )

    def snapshots(self, topic: str = "", **parameters: Any) -> tuple[str, list[Any]]:
        """Open a snapshot stream; return its topic, and the list of its messages."""
        opened = self.open(topic, **parameters)
        return opened, self.ros.collect(self.msg.BehaviourTree, opened, LATCHED)

    def blackboard(self, *variables: str, **how: Any) -> tuple[str, list[str]]:
        """Open a blackboard stream, with the subscription of py-trees-blackboard-watcher."""
        answer = self.call(
            "blackboard_streams/open", "OpenBlackboardStream", variables=list(variables), **how
        )
        texts: list[str] = []
        self.ros.node.create_subscription(
            String, answer.topic, lambda message: texts.append(message.data), VOLATILE
        )
        return answer.topic, texts


@pytest.fixture
def trees(tmp_path: Path) -> Path:
    return folder(tmp_path, SHOWER, QUICK)


@pytest.fixture
def watcher(ros: Any, market: Market, trees: Path) -> Watcher:
    return Watcher(ros, market.host(trees), market)


def shown(message: Any) -> dict[str, Any]:
    """Return the tree as a watcher builds it: from the one node without a parent downwards."""
    by_id = {bytes(one.own_id.uuid): one for one in message.behaviours}
    assert len(by_id) == len(message.behaviours)
    [root] = [one for one in message.behaviours if not any(one.parent_id.uuid)]
    found: dict[str, Any] = {}

    def build(node: Any) -> None:
        assert node.type in (1, 2, 3, 4, 6)
        assert node.status in (1, 2, 3, 4)
        assert node.blackbox_level == 4
        assert UUID(bytes=bytes(node.own_id.uuid), version=4).bytes == bytes(node.own_id.uuid)
        if node.type == 6:
            assert len(node.child_ids) == 1
        found[node.class_name] = node
        for child in node.child_ids:
            inner = by_id[bytes(child.uuid)]
            assert list(inner.parent_id.uuid) == list(node.own_id.uuid)
            build(inner)

    build(root)
    assert len(by_id) == sum(1 for _ in message.behaviours)
    return found


def test_watcher_joins_running_tree_and_sees_its_end(ros: Any, watcher: Watcher) -> None:
    handle = watcher.show()
    topic, messages = watcher.snapshots()
    assert topic.startswith("/agents/snapshot_streams/_snapshots_")
    ros.until(lambda: messages)
    tree = shown(messages[0])
    top = tree["bt_agents.agent"]
    assert (top.name, top.type, top.status) == ("shower", 3, 2)
    assert tree["bt_agents.sequence"].additional_detail == "WithMemory"
    assert tree["bt_agents.parallel"].additional_detail == "OnOne"
    assert tree["bt_agents.timeout"].type == 6
    assert tree["bt_agents.choose"].status == 1
    assert [(one.key, one.value) for one in tree["bt_agents.timeout"].blackboard_access] == [
        ("/patience", "r")
    ]
    assert not tree["bt_agents.wait_for"].blackboard_access
    assert list(tree["bt_agents.sequence"].current_child_id.uuid) == list(
        tree["bt_agents.parallel"].own_id.uuid
    )
    assert not any(tree["bt_agents.wait_for"].tip_id.uuid)
    watcher.until_watched()
    watcher.press()
    assert watcher.market.result(handle).result.outcome == RunAgent.Result.SUCCEEDED
    ros.until(lambda: shown(messages[-1])["bt_agents.agent"].status == 3)
    last = shown(messages[-1])
    assert last["bt_agents.choose"].status == 3
    assert last["bt_agents.choose"].is_active
    assert messages[-1].changed
    assert messages[-1].statistics.count == watcher.host._tree_streams._run.run.ticks
    assert 0.0 < messages[-1].statistics.tick_duration < 5.0
    keys = {
        one.key: one.value for message in messages for one in message.blackboard_on_visited_path
    }
    assert keys["/word"] == "'good-bye'"
    activity = [one for message in messages for one in message.blackboard_activity]
    assert ("/word", "INITIALISED") in {(one.key, one.activity_type) for one in activity}
    assert ("/word", "READ") in {(one.key, one.activity_type) for one in activity}


def test_late_watcher_sees_end_of_last_run(ros: Any, watcher: Watcher) -> None:
    _, nothing = watcher.snapshots("early")
    ros.turns()
    assert nothing == []
    watcher.market.result(watcher.run("quick"))
    _, messages = watcher.snapshots("late")
    ros.until(lambda: messages)
    assert shown(messages[0])["bt_agents.set"].status == 3


def test_stream_keeps_node_identifiers_across_agent_changes(ros: Any, watcher: Watcher) -> None:
    _, messages = watcher.snapshots("mine")
    watcher.until_watched()
    identifiers = []
    for number, agent in enumerate(("quick", "shower", "quick"), start=1):
        messages.clear()
        handle = watcher.run(agent, round=number)
        ros.until(lambda: messages)
        assert shown(messages[-1])["bt_agents.agent"].name == agent
        identifiers.append(sorted(bytes(one.own_id.uuid) for one in messages[-1].behaviours))
        if agent == "shower":
            watcher.press()
        watcher.market.result(handle)
        ros.until(lambda: shown(messages[-1])["bt_agents.agent"].status == 3)
    assert identifiers[0] == identifiers[2] != identifiers[1]


def test_a_cancelled_run_shows_its_clean_up(ros: Any, watcher: Watcher) -> None:
    never_held_up(watcher.host)
    _, messages = watcher.snapshots()
    watcher.until_watched()
    handle = watcher.show()
    ros.until(lambda: messages)
    ros.result(handle.cancel_goal_async())
    ros.until(lambda: shown(messages[-1])["bt_agents.agent"].status == 4)
    last = shown(messages[-1])
    assert last["bt_agents.parallel"].status == 1
    assert list(last["bt_agents.agent"].current_child_id.uuid) == list(
        messages[-1].behaviours[0].child_ids[1].uuid
    )


def test_reconfigured_stream_changes_its_detail(ros: Any, watcher: Watcher) -> None:
    topic, messages = watcher.snapshots(data=False, activity=False)
    watcher.until_watched()
    handle = watcher.show()
    ros.until(lambda: messages)
    assert not messages[-1].blackboard_on_visited_path
    count = len(messages)
    ros.turns(40)
    assert len(messages) == count, "a tick without changes is told"
    answer = watcher.call(
        "snapshot_streams/reconfigure",
        "ReconfigureSnapshotStream",
        topic_name=topic,
        parameters=watcher.parameters(0.0),
    )
    assert answer.result
    ros.until(lambda: any(not message.changed for message in messages[count:]))
    watcher.press()
    watcher.market.result(handle)
    ros.until(lambda: shown(messages[-1])["bt_agents.agent"].status == 3)
    assert any(message.blackboard_on_visited_path for message in messages[count:])
    assert any(message.blackboard_activity for message in messages[count:])
    refused = watcher.call(
        "snapshot_streams/reconfigure",
        "ReconfigureSnapshotStream",
        topic_name="/nobody",
        parameters=watcher.parameters(),
    )
    assert not refused.result


def test_closing_stream_twice_fails(watcher: Watcher) -> None:
    topic, _ = watcher.snapshots("~/mine")
    assert topic == "/agents/mine"
    for there in (True, False):
        answer = watcher.call("snapshot_streams/close", "CloseSnapshotStream", topic_name=topic)
        assert answer.result is there
    board, _ = watcher.blackboard()
    for there in (True, False):
        answer = watcher.call(
            "blackboard_streams/close", "CloseBlackboardStream", topic_name=board
        )
        assert answer.result is there


def test_blackboard_stream_shows_variables_and_their_activity(ros: Any, watcher: Watcher) -> None:
    topic, texts = watcher.blackboard("word", "/scene/age", with_activity_stream=True)
    assert topic.startswith("/agents/blackboard_streams/_watcher_")
    _, visited = watcher.blackboard(filter_on_visited_path=True)
    ros.until(
        lambda: all(one.use.watched for one in watcher.host._tree_streams._blackboards.values())
    )
    handle = watcher.show()
    ros.until(lambda: texts and visited)
    listed = watcher.call("blackboard_streams/get_variables", "GetBlackboardVariables").variables
    assert {"/word", "/scene/age", "/live/age", "/patience"} <= set(listed)
    assert "    /word      : 'hello'" in texts[-1]
    assert "    /scene/age : 3" in texts[-1]
    assert "/word : INITIALISED | tree/0.set | 'hello'" in texts[-1]
    watcher.press()
    watcher.market.result(handle)
    ros.until(lambda: "/word : WRITE" in texts[-1])
    assert "'hello' → 'good-bye'" in texts[-1]
    assert "/scene/familiarity" not in "".join(visited)


def test_parameter_opens_and_closes_default_stream(ros: Any, watcher: Watcher) -> None:
    messages = ros.collect(watcher.msg.BehaviourTree, "/agents/snapshots", LATCHED)
    watcher.market.result(watcher.run("quick"))
    for name, value in (("default_snapshot_period", math.inf), ("default_snapshot_stream", True)):
        [answer] = watcher.host.set_parameters([Parameter(name, value=value)])
        assert answer.successful, answer.reason
    ros.until(lambda: messages)
    watcher.host.set_parameters([Parameter("default_snapshot_stream", value=False)])
    ros.until(lambda: not ros.node.count_publishers("/agents/snapshots"))
    [refused] = watcher.host.set_parameters([Parameter("default_snapshot_period", value=math.nan)])
    assert not refused.successful


def test_unsubscribed_streams_are_dropped_and_number_is_limited(
    ros: Any, watcher: Watcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "UNUSED_S", 300.0)
    topics = [watcher.open(f"of_{number}") for number in range(streams.MOST_STREAMS)]
    assert "" not in topics
    assert watcher.open("one_more") == ""
    monkeypatch.setattr(streams, "UNUSED_S", 0.0)
    ros.until(lambda: not watcher.host._tree_streams._snapshots)
    assert watcher.open("one_more")


@pytest.mark.parametrize("name", ["a b", "/", "x" * 500, "é", "a//b", "~/status"])
def test_invalid_topic_name_opens_no_stream(ros: Any, watcher: Watcher, name: str) -> None:
    logged = ros.collect(Log, "/rosout", qos.FACTS)
    assert watcher.open(name) == ""
    ros.until(lambda: [one for one in logged if "snapshot_streams/open refused" in one.msg])


def test_unwatched_ticks_are_not_recorded(
    ros: Any, watcher: Watcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted: list[Any] = []
    monkeypatch.setattr(Ticker, "report_visits", lambda *args: noted.append(args))
    monkeypatch.setattr(
        "bt_agents.host.tree_streams.watched_run.TreeSnapshot", lambda *args: noted.append(args)
    )
    watcher.snapshots("nobody")
    for subscription in list(ros.node.subscriptions):
        if subscription.topic_name.endswith("nobody"):
            ros.node.destroy_subscription(subscription)
    handle = watcher.show()
    watcher.press()
    watcher.market.result(handle)
    run = watcher.host._tree_streams._run
    assert noted == []
    assert run.activity == []
    assert run._statuses == []


def test_missing_package_disables_streams_and_logs_once(
    ros: Any, trees: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "bt_agents.host.tree_streams.messages.PACKAGE", "py_trees_ros_interfaces_elsewhere"
    )
    logged = ros.collect(Log, "/rosout", qos.FACTS)
    host = ros.add(make_host(trees))
    ros.until(lambda: [one for one in logged if "py_trees_ros" in one.msg])
    ros.turns()
    assert len([one for one in logged if "py_trees_ros" in one.msg]) == 1
    services = [name for name, _ in host.get_service_names_and_types_by_node("agents", "/")]
    assert services
    assert not [name for name in services if "streams" in name]
    assert not host.has_parameter("default_snapshot_stream")
