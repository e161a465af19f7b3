# SPDX-License-Identifier: Apache-2.0
"""The table of the system's topics."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import bt_agents_interfaces.msg
from bt_agents_ros import qos
from bt_agents_ros.system_topics import HOST, PREFIX, TOPICS, heard_by, topic_called
from bt_agents_ros.types import load_type


def test_no_topic_stands_twice_in_the_table_and_all_profiles_exist() -> None:
    names = [topic.name for topic in TOPICS]
    assert sorted(set(names)) == sorted(names)
    assert {topic.profile for topic in TOPICS} <= qos.PROFILES.keys()


def test_only_what_a_node_or_the_authors_have_named_stands_without_the_prefix() -> None:
    nodes = {name for topic in TOPICS for name in topic.publishers | topic.listeners} | {HOST}
    others = {topic.name for topic in TOPICS if not topic.name.startswith(PREFIX)}
    assert {name for name in others if name.partition("/")[0] not in nodes or "/" not in name} == {
        "/diagnostics",
        "answers",
        "sound",
    }


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("/bt_agents/auctions", "bt_agents/auctions"),
        ("/agents/status", "{host}/status"),
        ("/robot1/agents/trees", "{host}/trees"),
        ("robot/heartbeat", "robot/heartbeat"),
        ("agents/heartbeat", "{host}/heartbeat"),
    ],
)
def test_a_topic_is_found_by_its_name_also_below_that_of_a_host(name: str, found: str) -> None:
    assert topic_called(name).name == found


@pytest.mark.parametrize("name", ["", "unknown", "auctions", "/status", "agents/unknown"])
def test_a_topic_that_the_system_has_not_is_not_found(name: str) -> None:
    with pytest.raises(KeyError):
        topic_called(name)


def test_no_heartbeat_waits_for_a_listener_and_no_fact_is_missed() -> None:
    for topic in heard_by("studio"):
        is_heartbeat = topic.name.endswith("/heartbeat")
        profile = qos.listening(topic)
        assert (profile is qos.SENSOR) == (is_heartbeat or topic.profile == "SENSOR")
        assert (profile is qos.FACTS) == (topic.profile in ("FACT", "FACTS", "HISTORY"))


def test_the_table_is_read_without_ros() -> None:
    asked = "import sys; import bt_agents_ros.system_topics; print('rclpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", asked], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "False\n"


OWN_TYPES = sorted({topic.type for topic in TOPICS if topic.type.startswith("bt_agents_")})


@pytest.mark.parametrize("kind", OWN_TYPES)
def test_a_message_on_a_topic_of_its_own_says_its_time_in_a_header_that_comes_first(
    kind: str,
) -> None:
    fields = load_type(kind).get_fields_and_field_types()
    assert "builtin_interfaces/Time" not in fields.values()
    if "std_msgs/Header" in fields.values():
        assert next(iter(fields.items())) == ("header", "std_msgs/Header")


def test_only_what_has_a_topic_of_its_own_has_a_header() -> None:
    kinds = inspect.getmembers(bt_agents_interfaces.msg, inspect.isclass)
    with_header = {
        f"bt_agents_interfaces/msg/{name}"
        for name, kind in kinds
        if "std_msgs/Header" in kind.get_fields_and_field_types().values()
    }
    assert with_header
    assert with_header <= set(OWN_TYPES)
