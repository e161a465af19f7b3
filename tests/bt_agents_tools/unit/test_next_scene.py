# SPDX-License-Identifier: Apache-2.0
"""The scene of the next round, as used by previews."""

from __future__ import annotations

from bt_agents_interfaces.msg import Scene, SceneValue
from bt_agents_tools.client.market import next_scene


def scene(scene_id: str, pain: float, origin: int) -> Scene:
    return Scene(scene_id=scene_id, values=[SceneValue(name="pain", value=pain, origin=origin)])


LAST = scene("s1", 2.0, SceneValue.GIVEN)


def test_running_interaction_uses_live_scene():
    live = scene("s1", 5.0, SceneValue.MEASURED)
    assert next_scene(LAST, live) is live


def test_told_values_still_count_after_run():
    told = next_scene(LAST, scene("", 8.0, SceneValue.TOLD))
    assert (told.scene_id, told.values[0].value) == ("s1", 8.0)
    assert LAST.values[0].value == 2.0


def test_later_measured_values_do_not_count():
    assert next_scene(LAST, scene("", 8.0, SceneValue.MEASURED)) == LAST


def test_values_told_in_another_interaction_are_ignored():
    assert next_scene(LAST, scene("s2", 8.0, SceneValue.TOLD)) is LAST
    assert next_scene(LAST, None) is LAST
    assert next_scene(None, scene("", 8.0, SceneValue.TOLD)) is None
