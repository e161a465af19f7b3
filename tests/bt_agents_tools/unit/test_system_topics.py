# SPDX-License-Identifier: Apache-2.0
"""The table of the system's topics."""

from __future__ import annotations

import inspect

import pytest

import bt_agents_interfaces.msg
from bt_agents_ros import qos
from bt_agents_ros.system_topics import HOST, PREFIX, TOPICS, heard_by, topic_called


def test_topic_names_are_unique() -> None:
    names = [topic.name for topic in TOPICS]
    assert sorted(set(names)) == sorted(names)


def test_only_node_and_author_topics_lack_prefix() -> None:
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
        ("agents/heartbeat", "{host}/heartbeat"),
    ],
)
def test_topic_is_found_by_plain_or_host_name(name: str, found: str) -> None:
    assert topic_called(name).name == found


@pytest.mark.parametrize("name", ["", "auctions", "/status", "agents/unknown"])
def test_unknown_topic_is_not_found(name: str) -> None:
    with pytest.raises(KeyError):
        topic_called(name)


def test_heartbeats_are_best_effort_and_facts_are_reliable() -> None:
    for topic in heard_by("studio"):
        is_heartbeat = topic.name.endswith("/heartbeat")
        profile = qos.listening(topic)
        assert (profile is qos.SENSOR) == (is_heartbeat or topic.profile == "SENSOR")
        assert (profile is qos.FACTS) == (topic.profile in ("FACT", "FACTS", "HISTORY"))


def test_only_topic_messages_have_header() -> None:
    with_header = {
        f"bt_agents_interfaces/msg/{name}"
        for name, kind in inspect.getmembers(bt_agents_interfaces.msg, inspect.isclass)
        if "std_msgs/Header" in kind.get_fields_and_field_types().values()
    }
    assert with_header
    assert with_header <= {topic.type for topic in TOPICS}
