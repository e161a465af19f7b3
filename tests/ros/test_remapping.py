# SPDX-License-Identifier: Apache-2.0
"""Topics of the system under other names, as ``-r`` and launch files give them."""

from __future__ import annotations

from typing import Any

from active_nodes import active_market, active_scene_layer
from bt_agents_interfaces.msg import MarketHeartbeat, SceneEnd
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import Analyze
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.system_topics import HOST, TOPICS
from market_harness import SPACE

SCENE, STATUS = "bt_agents/scene:=scene", "bt_agents/market:=/plaza/market"


def remapped(*rules: str) -> dict[str, Any]:
    return {"cli_args": ["--ros-args", *(word for rule in rules for word in ("-r", rule))]}


def start(ros: Any, *rules: str) -> Any:
    """Start a market with these remappings, and a scene layer with all; return its client."""
    ros.add(active_market(SPACE, "epoch", **remapped(*rules)))
    spec = SceneSpec(space=SPACE, sources=(), person=None)
    ros.add(active_scene_layer(spec, **remapped(SCENE, STATUS)))
    return ros.node.create_client(Analyze, "scene_layer/analyze", qos_profile=qos.SERVICE)


def announced(ros: Any, client: Any) -> Analyze.Response:
    return ros.call(client, Analyze.Request(label="a guest", announce=True))


def test_market_and_scene_layer_meet_on_remapped_topics(ros: Any) -> None:
    scenes: list[SceneMsg] = ros.collect(SceneMsg, "/scene", qos.EVENTS)
    ends: list[SceneEnd] = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
    client = start(ros, SCENE, STATUS)
    ros.until(lambda: not announced(ros, client).kept)
    last = announced(ros, client)
    assert not last.kept
    ros.until(lambda: last.scene.scene_id in {end.scene_id for end in ends})
    assert last.scene.scene_id in {scene.scene_id for scene in scenes}


def test_market_on_other_scene_topic_counts_as_absent(ros: Any) -> None:
    beats: list[MarketHeartbeat] = ros.collect(
        MarketHeartbeat, "marketplace/heartbeat", qos.SENSOR
    )
    client = start(ros, STATUS)
    ros.until(lambda: ros.node.get_publishers_info_by_topic("/plaza/market"))
    ros.until(lambda: ros.node.get_subscriptions_info_by_topic("/bt_agents/scene"))
    ros.until(lambda: beats)
    ros.turns(20)
    assert announced(ros, client).kept


def test_namespace_contains_all_topics_except_diagnostics(ros: Any) -> None:
    node = ros.add(BaseNode("some_node", namespace="/robot1"))
    resolved = {
        topic.name: node.resolve_topic_name(topic.name.replace(HOST, "agents")) for topic in TOPICS
    }
    assert resolved.pop("/diagnostics") == "/diagnostics"
    assert all(name.startswith("/robot1/") for name in resolved.values())
