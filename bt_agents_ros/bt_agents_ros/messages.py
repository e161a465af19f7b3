# SPDX-License-Identifier: Apache-2.0
"""Conversion of scenes and times from and to messages; scenes from outside are validated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from builtin_interfaces.msg import Time

from bt_agents_core.errors import Refused
from bt_agents_core.person_facts import Fact, facts, message_fields, values_of
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_interfaces.msg import PersonFact
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.msg import SceneValue as SceneValueMsg
from bt_agents_ros.limits import SCENE_CHARACTERS
from bt_agents_ros.types import fill

_SAME = ("scene_id", "label", "person", "urgent", "person_id", "place", "persons", "visits")
"""Fields that a scene and its message have alike."""

_NUMBERS = ("value", "age_s", "std", "confidence")
"""Fields of a value that are numbers in its message, too."""

_ORIGINS = {int(origin): origin for origin in Origin}


def seconds(stamp: Any) -> float:
    """Return a ``builtin_interfaces/Time`` or ``Duration`` in seconds."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def to_time(value: float) -> Time:
    """Return seconds as a ``builtin_interfaces/Time``; negative and NaN become zero."""
    nanoseconds = max(0, round(value * 1e9)) if math.isfinite(value) else 0
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def scene_to_msg(scene: Scene) -> SceneMsg:
    """Return the message of a scene."""
    return SceneMsg(
        stamp=to_time(scene.stamp),
        values=[
            SceneValueMsg(
                name=v.name,
                origin=int(v.origin),
                source=v.source,
                # rclpy writes an int in a float field as garbage without a word.
                **{field: float(getattr(v, field)) for field in _NUMBERS},
            )
            for v in scene.values
        ],
        remembered=facts_to_msg(scene.remembered),
        **{field: getattr(scene, field) for field in _SAME},
    )


def scene_from_msg(message: Any, space: SceneSpace) -> Scene:
    """Check a scene message and return the scene.

    Raises:
        Refused: As in :meth:`SceneSpace.scene`; also ``EMPTY`` without a scene id,
            ``TOO_LONG`` and ``UNKNOWN_ORIGIN``; or as in :func:`facts`.
    """
    if not message.scene_id:
        raise Refused("EMPTY", "scene: no scene_id; every scene needs a unique one")
    for field, longest in SCENE_CHARACTERS.items():
        if len(getattr(message, field)) > longest:
            raise Refused(
                "TOO_LONG",
                f"scene: {field} has {len(getattr(message, field))} characters, expected "
                f"{longest} at most",
            )
    values = []
    for value in message.values:
        origin = _ORIGINS.get(value.origin)
        if origin is None:
            raise Refused(
                "UNKNOWN_ORIGIN",
                f"scene: '{value.name}' has the origin {value.origin}, expected 0-5",
            )
        numbers = {field: getattr(value, field) for field in _NUMBERS}
        values.append(SceneValue(name=value.name, origin=origin, source=value.source, **numbers))
    return Scene(
        values=space.scene(values),
        stamp=seconds(message.stamp),
        remembered=facts(values_of(message.remembered)),
        **{field: getattr(message, field) for field in _SAME},
    )


def facts_to_msg(remembered: Mapping[str, Fact]) -> list[PersonFact]:
    """Return what is remembered of a person as a part of a message."""
    found = []
    for key, value in remembered.items():
        message = PersonFact()
        fill(message, message_fields(key, value))
        found.append(message)
    return found
