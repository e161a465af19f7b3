# SPDX-License-Identifier: Apache-2.0
"""Conversion of scenes and times from and to messages; scenes from outside are validated."""

from __future__ import annotations

import math
from typing import Any

from builtin_interfaces.msg import Time

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.msg import SceneValue as SceneValueMsg

_ORIGINS = {int(origin): origin for origin in Origin}

LONGEST_NAME = 200
"""Characters of the name of a person or a place."""


def seconds(stamp: Any) -> float:
    """Return a ``builtin_interfaces/Time`` or ``Duration`` in seconds."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def to_time(value: float) -> Time:
    """Return seconds as a ``builtin_interfaces/Time``; negative and NaN become zero."""
    nanoseconds = max(0, round(value * 1e9)) if math.isfinite(value) else 0
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def scene_to_msg(scene: Scene) -> SceneMsg:
    """Return the message of a scene."""
    # rclpy writes an int in a float field as garbage without a word.
    return SceneMsg(
        stamp=to_time(scene.stamp),
        scene_id=scene.scene_id,
        label=scene.label,
        person=scene.person,
        urgent=scene.urgent,
        person_id=scene.person_id,
        place=scene.place,
        persons=scene.persons,
        values=[
            SceneValueMsg(
                name=v.name,
                value=float(v.value),
                origin=int(v.origin),
                age_s=float(v.age_s),
                std=float(v.std),
                confidence=float(v.confidence),
                source=v.source,
            )
            for v in scene.values
        ],
    )


def scene_from_msg(message: Any, space: SceneSpace) -> Scene:
    """Check a scene message and return the scene.

    Raises:
        Refused: As in :meth:`SceneSpace.scene`; also ``EMPTY`` without a scene id,
            ``TOO_LONG`` and ``UNKNOWN_ORIGIN``.
    """
    if not message.scene_id:
        raise Refused("EMPTY", "scene: no scene_id; every scene needs a unique one")
    for field in ("person_id", "place"):
        if len(getattr(message, field)) > LONGEST_NAME:
            raise Refused(
                "TOO_LONG",
                f"scene: {field} has {len(getattr(message, field))} characters, expected "
                f"{LONGEST_NAME} at most",
            )
    values = []
    for value in message.values:
        origin = _ORIGINS.get(value.origin)
        if origin is None:
            raise Refused(
                "UNKNOWN_ORIGIN",
                f"scene: '{value.name}' has the origin {value.origin}, expected 0-4",
            )
        values.append(
            SceneValue(
                name=value.name,
                value=value.value,
                origin=origin,
                age_s=value.age_s,
                std=value.std,
                confidence=value.confidence,
                source=value.source,
            )
        )
    return Scene(
        scene_id=message.scene_id,
        label=message.label,
        person=message.person,
        urgent=message.urgent,
        person_id=message.person_id,
        place=message.place,
        persons=message.persons,
        values=space.scene(values),
        stamp=seconds(message.stamp),
    )
