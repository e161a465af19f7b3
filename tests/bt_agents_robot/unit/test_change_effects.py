# SPDX-License-Identifier: Apache-2.0
"""Changes of scripted visits: without effect if the live scene does not show them."""

from __future__ import annotations

from bt_agents_language.model.specs import SceneChange, Visit
from bt_agents_robot.change_effects import EFFECT_S, ChangeEffects, unmade_text, unmeasured_text

FALL = SceneChange(after_s=3.0, values={"mood": 1.5})


def effects(change: SceneChange = FALL) -> ChangeEffects:
    made = ChangeEffects()
    made.live({"mood": 4.0, "age": 3.0}, True)
    made.made(change, "Mrs Smith", 10.0)
    return made


def test_change_in_live_scene_has_effect():
    found = effects()
    found.live({"mood": 3.9}, True)
    assert not found.pending
    assert found.missing(100.0) == []


def test_change_that_does_not_show_is_named_once():
    found = effects()
    found.live({"mood": 4.0, "age": 2.0}, True)
    for tick in range(1, 20):
        assert found.missing(10.0 + tick * EFFECT_S / 20) == []
    assert found.pending
    assert found.missing(10.0 + EFFECT_S) == [
        "Mrs Smith: mood 1.5 after 3 s had no effect: the live scene has not shown it within 2 s"
    ]
    assert not found.pending


def test_value_that_nothing_measures_is_named():
    visit = Visit(label="Mrs Smith", person=True, values={"age": 4.0, "mood": 1.0})
    assert unmeasured_text(visit, ["mood", "age"], "") == ""
    assert unmeasured_text(visit, ["age"], "Frau Müller") == (
        "Mrs Smith: mood had no effect: no source of scene.yaml can measure it of 'Frau Müller'"
    )


def test_change_during_stall_may_show_afterwards():
    found = effects()
    assert found.missing(20.0) == []
    found.live({"mood": 3.9}, True)
    assert not found.pending


def test_change_to_same_value_shows_at_once():
    found = effects(SceneChange(after_s=1.0, values={"mood": 4.0}))
    found.live({"mood": 4.0}, True)
    assert not found.pending


def test_leaving_shows_when_nobody_is_there():
    found = effects(SceneChange(after_s=1.0, values={}, person=False))
    found.live({"mood": 4.0}, True)
    assert found.pending
    found.live({}, False)
    assert not found.pending


def test_change_after_visit_explains_missing_effect():
    said = unmade_text(FALL, "Mrs Smith", started=True)
    assert said == "Mrs Smith: mood 1.5 after 3 s had no effect: the visit was over by then"
    assert unmade_text(FALL, "a", started=False).endswith("no run of the visit has started")
