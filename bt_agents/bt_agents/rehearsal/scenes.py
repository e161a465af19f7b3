# SPDX-License-Identifier: Apache-2.0
"""The scene of a rehearsal, how it changes, and the mood rules that watch it."""

from __future__ import annotations

from dataclasses import replace

from bt_agents.feedback import Kind
from bt_agents.language.specs import FeedbackRule
from bt_agents.language.testing.scenarios import Happening, Scenario
from bt_agents.rules import Rule
from bt_agents.scene import Origin, Scene, SceneSpace, SceneValue

_AWARDED = "rehearsed"


def awarded(space: SceneSpace, scenario: Scenario) -> Scene:
    """Return the scene that a scenario starts from."""
    return Scene(
        scene_id=_AWARDED,
        label="",
        person=scenario.person,
        values=tuple(
            SceneValue(name=name, value=scenario.scene[name], origin=Origin.GIVEN)
            if name in scenario.scene
            else SceneValue.missing(name)
            for name in space.names
        ),
    )


def changed(scene: Scene, happening: Happening) -> Scene:
    """Return a scene after something has happened."""
    values = tuple(
        SceneValue(name=one.name, value=happening.values[one.name], origin=Origin.MEASURED)
        if one.name in happening.values
        else one
        for one in scene.values
    )
    person = scene.person if happening.person is None else happening.person
    return replace(scene, values=values, person=person)


def change_text(happening: Happening) -> str:
    """Return in words how a scene changes."""
    words = [f"{name} {value:g}" for name, value in happening.values.items()]
    if happening.person is not None:
        words.append("a person comes" if happening.person else "the person leaves")
    return ", ".join(words)


def watched(rule: FeedbackRule) -> Rule:
    """Return a rule as it is watched during a run."""
    return Rule(
        text=rule.when.text,
        condition=rule.when,
        hold_s=rule.hold_s,
        kind=Kind.POSITIVE if rule.positive else Kind.NEGATIVE,
        cancel=rule.cancel,
    )
