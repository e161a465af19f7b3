# SPDX-License-Identifier: Apache-2.0
"""Security policies: exactly the rights that the running nodes use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter

from active_nodes import active_feedback, active_host, active_market, active_scene_layer
from bt_agents_interfaces.srv import GiveFeedback
from bt_agents_lab.node import JournalNode
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_robot.robot import RobotNode
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.system_topics import HOST, SERVICES, TOPICS
from bt_agents_studio.node import StudioNode
from bt_agents_tools.security_policy import ROLES, Rights, rights_of
from checkout import ROOT
from feedback_node.ledger import Ledger
from marketplace_node.external_ranking.openai_protocol import Endpoint
from marketplace_node.node.selector import SelectorNode

SPARED = {
    # The market uses only the services of a host's action.
    ("marketplace", "rt/agents/run/_action/feedback"),
    ("marketplace", "rt/agents/run/_action/status"),
    # No shipped agent remembers facts about a person on its own.
    ("agents", "rq/scene_layer/rememberRequest"),
    ("agents", "rr/scene_layer/rememberReply"),
    # A node subscribes to a topic only while a tree waits for it.
    ("agents", "rt/buttons/confirm"),
}


NODES = frozenset((HOST, "marketplace", "scene_layer", "feedback", "robot"))
"""Nodes of this test that publish."""


def used_when_needed(node: str, topic: str) -> bool:
    """Return whether it is used only for a page or watcher, or to cancel goals of a lost host."""
    if node == "agents":
        return "_streams/" in topic or topic.endswith("/snapshots")
    if node == "studio":
        return topic.startswith(("rq/", "rr/")) or topic in ("rt/answers", "rt/buttons/confirm")
    return node == "marketplace" and "/_action/" in topic and not topic.startswith("rt/agents/")


def used_by(node: Any, name: str) -> tuple[set[str], set[str]]:
    """Return the DDS topics that a node of the graph writes and reads."""

    def names(listed: Any) -> list[str]:
        return [entry for entry, _ in listed(name, "/")]

    served = names(node.get_service_names_and_types_by_node)
    called = names(node.get_client_names_and_types_by_node)
    written = {f"rt{topic}" for topic in names(node.get_publisher_names_and_types_by_node)}
    read = {f"rt{topic}" for topic in names(node.get_subscriber_names_and_types_by_node)}
    written |= {f"rr{one}Reply" for one in served} | {f"rq{one}Request" for one in called}
    read |= {f"rq{one}Request" for one in served} | {f"rr{one}Reply" for one in called}
    return written, read


def allowed_by(rights: Rights) -> tuple[set[str], set[str]]:
    """Return the DDS topics that a node may write and read."""
    full = {
        right: {f"/{one.removeprefix('/')}" for one in names} for right, names in rights.items()
    }
    written = {f"rt{one}" for one in full["publish"]}
    read = {f"rt{one}" for one in full["subscribe"]}
    for actions, services, topics in (("execute", "reply", written), ("call", "request", read)):
        for one in full[actions]:
            full[services] |= {
                f"{one}/_action/{name}" for name in ("send_goal", "get_result", "cancel_goal")
            }
            topics |= {f"rt{one}/_action/{name}" for name in ("feedback", "status")}
    written |= {f"rr{one}Reply" for one in full["reply"]}
    written |= {f"rq{one}Request" for one in full["request"]}
    read |= {f"rq{one}Request" for one in full["reply"]}
    read |= {f"rr{one}Reply" for one in full["request"]}
    return written, read


def test_access_table_lists_exactly_all_endpoints_of_nodes(ros: Any, tmp_path: Path) -> None:
    trees = read_trees(ROOT / "trees", InstalledInterfaces())
    space = trees.scene.space
    studio = StudioNode(*[lambda *_values: None] * 4)
    for node in (
        active_market(space, "epoch"),
        active_scene_layer(trees.scene),
        active_feedback(space, Ledger(":memory:")),
        RobotNode(
            parameter_overrides=[
                Parameter("voice", value="off"),
                Parameter("needs_screen", value=True),
            ]
        ),
        JournalNode(tmp_path),
        studio,
        SelectorNode(space, Endpoint(base_url="http://127.0.0.1:9/v1", model="none")),
    ):
        ros.add(node)
    studio.watch(True, True)
    host = ros.add(active_host(trees))
    ros.until(lambda: host.registered)
    values, name = [4.0] * len(space), trees.agents[0].name
    assert ros.ask(GiveFeedback, "feedback/give", agent=name, values=values).accepted

    def differences() -> list[tuple[str, str, str]]:
        found = []
        for name, rights in rights_of(trees, ("agents",)).items():
            if name in ROLES:
                continue
            for allowed, used in zip(allowed_by(rights), used_by(ros.node, name), strict=True):
                found += [(name, "not allowed", one) for one in used - allowed]
                found += [
                    (name, "not used", one)
                    for one in allowed - used
                    if (name, one) not in SPARED and not used_when_needed(name, one)
                ]
        return found

    def other_forms() -> list[tuple[str, str, str]]:
        """Return endpoints whose type or QoS differs from the table."""
        types = dict(ros.node.get_service_names_and_types())
        found = [
            (one.server, "another type", one.name)
            for one in SERVICES
            if types.get(f"/{one.name.replace(HOST, 'agents')}") != [one.type]
        ]
        for topic in TOPICS:
            name = f"/{topic.name.removeprefix('/').replace(HOST, 'agents')}"
            wanted = qos.PROFILES[topic.profile]
            for end in ros.node.get_publishers_info_by_topic(name):
                if end.topic_type != topic.type:
                    found.append((end.node_name, "another type", f"{name}: {end.topic_type}"))
                held = end.qos_profile
                if (held.durability, held.reliability) != (wanted.durability, wanted.reliability):
                    found.append((end.node_name, "another QoS", name))
            if topic.publishers & NODES and not ros.node.count_publishers(name):
                found.append((min(topic.publishers), "not published", name))
            for end in ros.node.get_subscriptions_info_by_topic(name):
                if end.topic_type != topic.type:
                    found.append((end.node_name, "another type", f"{name}: {end.topic_type}"))
        return found

    last: list[Any] = []

    def agrees() -> bool:
        last[:] = [*differences(), *other_forms()]
        return not last

    try:
        ros.until(agrees, limit_s=10.0)
    finally:
        assert sorted(last) == []
