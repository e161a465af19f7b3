# SPDX-License-Identifier: Apache-2.0
"""The live scene in trees when the process of the scene layer is killed."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents_interfaces.srv import Analyze
from bt_agents_tools.launcher import components
from processes import BEATS_A_SECOND, System, write_trees

pytestmark = pytest.mark.e2e

TREE = """
repeat: 100000
sequence:
  - selector:
      - sequence:
          - check: live.mood >= 1
          - say: mood ${live.mood}
      - say: mood unknown
  - wait: 50 ms
"""


def test_tree_sees_unknown_mood_without_scene_layer(system: System) -> None:
    trees = write_trees(system.folder / "a", leo=(4.0, TREE))
    system.say_server.let_go()
    system.market(trees, bid_deadline=5.0)
    layer = system.start(components.scene_layer(trees))
    system.host("agents", trees)
    system.until_ready(hosts=1, agents=1)
    heartbeat_probe = system.heartbeat_probe("agents")
    analyze = system.ros.node.create_client(Analyze, "scene_layer/analyze")

    def sense(mood: float, *, announce: bool) -> Any:
        request = Analyze.Request(
            names=["age", "mood"],
            values=[4.0, mood],
            person=Analyze.Request.PRESENT,
            announce=announce,
        )
        return system.ask(analyze, request)

    def last() -> str:
        said = system.say_server.texts
        return said[-1] if said else ""

    assert sense(4.0, announce=True).accepted
    system.until(lambda: last() == "mood 4", "the mood as awarded")
    sense(2.0, announce=False)
    system.until(lambda: last() == "mood 2", "the mood of now")

    layer.kill()
    killed_at = heartbeat_probe.count
    system.until(lambda: last() == "mood unknown", "the mood is stale")
    assert heartbeat_probe.count - killed_at <= 3 * BEATS_A_SECOND
    heard = len(system.say_server.texts)
    system.until(lambda: len(system.say_server.texts) >= heard + 10, "ten more rounds of the tree")
    assert set(system.say_server.texts[heard:]) == {"mood unknown"}

    layer.start()
    system.until(lambda: last() != "mood unknown", "the mood is fresh again")
    system.until(lambda: analyze.service_is_ready(), "the scene layer answers")
    sense(5.0, announce=False)
    system.until(lambda: last() == "mood 5", "the mood of now, after the restart")
