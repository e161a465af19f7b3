# SPDX-License-Identifier: Apache-2.0
"""The scene that another round would be for, as previews take it."""

from __future__ import annotations

from bt_agents_interfaces.msg import Scene, SceneValue
from bt_agents_tools.client.market import next_scene


def scene(scene_id: str, pain: float, origin: int) -> Scene:
    return Scene(scene_id=scene_id, values=[SceneValue(name="pain", value=pain, origin=origin)])


LAST = scene("s1", 2.0, SceneValue.GIVEN)


def test_while_a_run_goes_on_it_is_the_live_scene():
    live = scene("s1", 5.0, SceneValue.MEASURED)
    assert next_scene(LAST, live) is live


def test_after_a_run_what_the_person_has_told_still_counts():
    told = next_scene(LAST, scene("", 8.0, SceneValue.TOLD))
    assert (told.scene_id, told.values[0].value) == ("s1", 8.0)
    assert LAST.values[0].value == 2.0


def test_what_is_only_measured_since_does_not_count():
    assert next_scene(LAST, scene("", 8.0, SceneValue.MEASURED)) == LAST


def test_what_is_told_in_another_interaction_does_not_count():
    assert next_scene(LAST, scene("s2", 8.0, SceneValue.TOLD)) is LAST
    assert next_scene(LAST, None) is LAST
    assert next_scene(None, scene("", 8.0, SceneValue.TOLD)) is None
