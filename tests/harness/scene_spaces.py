# SPDX-License-Identifier: Apache-2.0
"""The scene parameters of most tests, from 1 to 5, their scenes and sources."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from bt_agents_core.diagnostic import Position
from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.model.scene_specs import SourceSpec


def space_of(*names: str, mood: str | None = None) -> SceneSpace:
    """Return a space of parameters from 1 to 5."""
    parameters = [
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0) for name in names
    ]
    return SceneSpace(parameters=tuple(parameters), mood=mood)


AGE_AND_MOOD = space_of("age", "mood", mood="mood")


def scene_of(
    space: SceneSpace,
    values: Sequence[float],
    scene_id: str = "s1",
    *,
    origin: Origin = Origin.GIVEN,
    confidence: float = 1.0,
    person: bool = True,
    label: str = "",
    **fields: Any,
) -> Scene:
    """Return a scene with these values; NaN marks a missing one."""
    found = tuple(
        SceneValue.missing(name)
        if math.isnan(value)
        else SceneValue(name=name, value=value, origin=origin, confidence=confidence)
        for name, value in zip(space.names, values, strict=True)
    )
    return Scene(scene_id=scene_id, label=label, person=person, values=found, **fields)


def age_and_mood(age: float, mood: float, scene_id: str = "s1", **fields: Any) -> Scene:
    """Return a scene in which these values are measured; see :func:`scene_of`."""
    return scene_of(AGE_AND_MOOD, (age, mood), scene_id, **{"origin": Origin.MEASURED} | fields)


def source(
    parameter: str,
    type_name: str = "std_msgs/msg/Float64",
    *points: tuple[float, float],
    field: str = "msg.data",
    stale_after_s: float = 60.0,
) -> SourceSpec:
    """Return a source on the topic ``sensors/<parameter>``."""
    return SourceSpec(
        parameter=parameter,
        topic=f"sensors/{parameter}",
        type=type_name,
        field=parse_expression(field),
        points=points,
        stale_after_s=stale_after_s,
        position=Position(file="scene.yaml", line=1, column=1),
    )
