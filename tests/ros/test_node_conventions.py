# SPDX-License-Identifier: Apache-2.0
"""Conventions of ROS in every node: QoS overrides, logger levels, messages with headers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import LoggerLevel
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import Empty

from active_nodes import active_host
from bt_agents_core.errors import Refused
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.parameters import report_unknown
from bt_agents_ros.system_topics import TOPICS
from bt_agents_ros.types import load_type
from programs import ROOT
from tree_harness import TREES

OWN_TYPES = sorted({one.type for one in TOPICS if one.type.startswith("bt_agents_interfaces/")})
"""Types of messages with a topic of their own."""


def node_with(ros: Any, **overrides: Any) -> BaseNode:
    """Return a node with ``qos_overrides.`` parameters; ``__`` stands for a dot."""
    given = [
        Parameter(f"qos_overrides./{name.replace('__', '.')}", value=value)
        for name, value in overrides.items()
    ]
    return ros.add(BaseNode("some_node", parameter_overrides=given))


def test_qos_overrides_apply_only_to_named_endpoints(ros: Any) -> None:
    node = node_with(
        ros,
        scene__publisher__depth=7,
        scene__publisher__durability="volatile",
        scene__subscription__reliability="best_effort",
    )
    publisher = node.create_publisher(Empty, "scene", qos.FACT)
    subscription = node.create_subscription(Empty, "scene", lambda _: None, qos.FACT)
    other = node.create_publisher(Empty, "market", qos.FACT)
    elsewhere = ros.add(BaseNode("other")).create_publisher(Empty, "scene", qos.FACT)
    assert publisher.qos_profile.depth == 7
    assert publisher.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert subscription.qos_profile.depth == 1
    assert subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert [one.qos_profile.depth for one in (other, elsewhere)] == [1, 1]
    assert qos.FACT.depth == 1
    names = [name for name in node.list_parameters([], 0).names if name.startswith("qos")]
    assert sorted(names) == [
        "qos_overrides./scene.publisher.depth",
        "qos_overrides./scene.publisher.durability",
        "qos_overrides./scene.subscription.reliability",
    ]


def test_override_uses_remapped_topic_name(ros: Any) -> None:
    given = [Parameter("qos_overrides./robot/scene.publisher.depth", value=7)]
    node = ros.add(BaseNode("some_node", namespace="/robot", parameter_overrides=given))
    assert node.create_publisher(Empty, "scene", qos.FACT).qos_profile.depth == 7


@pytest.mark.parametrize(
    ("policy", "value", "words"),
    [
        ("depht", 7, "'depht' is none of"),
        ("reliability", "perfect", "perfect"),
        ("depth", "many", "many"),
        ("depth", -1, "-1"),
        ("depth", 10**9, "expected 0 to 10000"),
    ],
)
def test_unknown_override_is_refused(ros: Any, policy: str, value: object, words: str) -> None:
    node = node_with(ros, **{f"scene__publisher__{policy}": value})
    with pytest.raises(Refused, match="BAD_QOS_OVERRIDE") as refused:
        node.create_publisher(Empty, "scene", qos.FACT)
    assert words in str(refused.value)
    assert "/scene.publisher." in str(refused.value)


def test_documented_overrides_take_effect(ros: Any, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
    example = page.partition("## QoS and log levels")[2].partition("```text\n")[2]
    file = tmp_path / "overrides.yaml"
    file.write_text(example.partition("```")[0], encoding="utf-8")
    host = ros.add(
        active_host(
            read_trees(TREES, InstalledInterfaces()),
            cli_args=["--ros-args", "--params-file", str(file)],
        )
    )
    host.create_subscription(Empty, "button", lambda _: None, qos.EVENTS)
    names = host.list_parameters([], 0).names
    assert {name: host.get_parameter(name).value for name in names if name.startswith("qos")} == {
        "qos_overrides./agents/status.publisher.depth": 5000,
        "qos_overrides./button.subscription.reliability": "best_effort",
    }


def test_override_without_endpoint_is_named(ros: Any, capfd: pytest.CaptureFixture[str]) -> None:
    node = node_with(ros, scnee__publisher__depth=7)
    node.create_publisher(Empty, "scene", qos.FACT)
    report_unknown(node)
    assert "'qos_overrides./scnee.publisher.depth' is for a publisher" in capfd.readouterr().err


def test_running_node_reads_and_sets_logger_levels(
    ros: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    node = ros.add(BaseNode("levelled"))
    part = node.get_logger().get_child("part")
    assert set_levels(ros, levelled=10) == [""]
    node.get_logger().debug("now it is logged")
    part.debug("this too")
    names = ["levelled", "levelled.part"]
    answer = ros.ask(GetLoggerLevels, "levelled/get_logger_levels", names=names)
    assert [one.level for one in answer.levels] == [10, 0]
    assert set_levels(ros, levelled=40) == [""]
    node.get_logger().warning("this is not")
    logged = capfd.readouterr().err
    assert "now it is logged" in logged
    assert "this too" in logged
    assert "this is not" not in logged


def test_log_levels_apply_only_to_node_and_ros(ros: Any) -> None:
    ros.add(BaseNode("levelled"))
    reasons = set_levels(
        ros, **{"levelled.part": 20, "rcl": 20, "somebody": 20, "levelledtoo": 20, "levelled": 25}
    )
    assert [reason.partition(":")[0] for reason in reasons] == [
        *("", "", "UNKNOWN_LOGGER", "UNKNOWN_LOGGER", "UNKNOWN_CHOICE")
    ]


def test_number_of_logger_names_is_limited(ros: Any) -> None:
    ros.add(BaseNode("levelled"))
    found = [
        reason
        for start in (0, 600)
        for reason in set_levels(ros, **{f"levelled.a{start + n}": 20 for n in range(600)})
    ]
    assert found[:1000] == [""] * 1000
    assert {reason.partition(":")[0] for reason in found[1000:]} == {"TOO_MANY"}


def set_levels(ros: Any, **levels: int) -> list[str]:
    """Call the node ``levelled``; return the reason of each refusal, empty for a set level."""
    wanted = [LoggerLevel(name=name, level=level) for name, level in levels.items()]
    answer = ros.ask(SetLoggerLevels, "levelled/set_logger_levels", levels=wanted)
    return [one.reason for one in answer.results]


@pytest.mark.parametrize("kind", OWN_TYPES)
def test_message_with_a_time_begins_with_header(kind: str) -> None:
    fields = list(load_type(kind).get_fields_and_field_types())
    assert "stamp" not in fields
    assert "header" not in fields[1:]
