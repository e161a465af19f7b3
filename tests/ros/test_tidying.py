# SPDX-License-Identifier: Apache-2.0
"""Entities that a host created for trees: removed when no tree names them any more."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from rclpy.node import Node

from bt_agents.engine.environment import SkillGoal
from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents.host.environment.ros_environment import RosEnvironment
from bt_agents_core.field_types import BindingKind
from bt_agents_language.model.specs import NodeSpec, Timeouts, iter_nodes
from scripted_server import Script, ScriptedServer
from tree_harness import SPACE, agent

TREE = """
sequence:
  - say: Hello.
  - service: {name: switch, type: std_srvs/srv/SetBool, request: {data: true}}
  - publish: {topic: sound, type: std_msgs/msg/String, message: {data: ping}}
  - wait_for: {topic: door, type: std_msgs/msg/Bool, latched: true}
"""
SAY = SkillGoal(
    kind=BindingKind.ACTION,
    name="say",
    type="bt_agents_interfaces/action/Say",
    fields={"text": "Hello."},
    timeouts=Timeouts(server_s=30.0, accept_s=0.1),
)
ALL = {"say", "switch", "sound", "door", "robot/heartbeat"}


def used(node: Node) -> set[str]:
    """Return the entities of a node for its trees on the graph."""
    names = {one._action_name for one in node.waitables if hasattr(one, "_action_name")}
    names |= {one.srv_name for one in node.clients}
    names |= {one.topic_name for one in (*node.publishers, *node.subscriptions)}
    return {name.removeprefix("/") for name in names} & ALL


@pytest.fixture
def node(ros: Any) -> Node:
    """The node of a host."""
    return ros.add(rclpy.create_node("host"))


@pytest.fixture
def environment(node: Node) -> Iterator[RosEnvironment]:
    """The environment of its trees."""
    subject = RosEnvironment(
        node,
        lambda: None,
        open_goals=OpenGoalList(node, "first", lambda: None),
        space=SPACE,
        agent=lambda: "guide",
    )
    yield subject
    subject.close()


def prepared(environment: RosEnvironment, tree: str) -> list[NodeSpec]:
    """Prepare a tree; return its nodes."""
    nodes = list(iter_nodes(agent(tree).tree))
    for spec in nodes:
        environment.prepare(spec)
    return nodes


def test_only_unused_entities_leave_graph(node: Node, environment: RosEnvironment) -> None:
    nodes = prepared(environment, TREE)
    assert used(node) == ALL
    before = [*node.waitables, *node.clients, *node.publishers, *node.subscriptions]
    environment.retain(nodes)
    assert [*node.waitables, *node.clients, *node.publishers, *node.subscriptions] == before
    environment.retain(spec for spec in nodes if spec.kind != "say")
    assert used(node) == {"switch", "sound", "door"}
    environment.retain([])
    assert used(node) == set()
    prepared(environment, TREE)
    assert used(node) == ALL


def test_unconfirmed_goal_keeps_its_client(
    ros: Any, node: Node, environment: RosEnvironment
) -> None:
    server = ScriptedServer(ros, script=Script(accept_s=None, finish_s=None))
    prepared(environment, "say: Hello.")
    run = environment.send(SAY)
    ros.until(lambda: run.state.ended and server.goals)
    assert not run.confirmed
    environment.retain([])
    assert used(node) == {"say"}
    server.goals[0].accept()
    ros.until(lambda: run.confirmed)
    environment.retain([])
    assert used(node) == set()
    ros.turns(5)
