# SPDX-License-Identifier: Apache-2.0
"""Conversion of scenes and times from and to messages, and of refusals to responses."""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from bt_agents_core.errors import Refused
from bt_agents_core.person_facts import Fact, facts, message_fields, values_of
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_interfaces.msg import PersonFact
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.msg import SceneValue as SceneValueMsg
from bt_agents_ros.limits import SCENE_CHARACTERS
from bt_agents_ros.types import fill

_SAME = ("scene_id", "label", "person", "urgent", "person_id", "place", "persons", "visits")
"""Fields that a scene and its message share."""

_NUMBERS = ("value", "age_s", "std", "confidence")
"""Fields of a value that are also numbers in its message."""

_ORIGINS = {int(origin): origin for origin in Origin}


@contextmanager
def answering(response: Any) -> Iterator[None]:
    """Accept a request in its response, or refuse it with the refusal that the block raises."""
    try:
        yield
    except Refused as refused:
        response.code, response.message = refused.code, refused.reason
    else:
        response.accepted = True


def seconds(stamp: Any) -> float:
    """Return a ``builtin_interfaces/Time`` or ``Duration`` in seconds."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def to_time(value: float) -> Time:
    """Return seconds as a ``builtin_interfaces/Time``; negative and NaN become zero."""
    nanoseconds = max(0, round(value * 1e9)) if math.isfinite(value) else 0
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def header_at(stamp: Time) -> Header:
    """Return a message header with a time and no frame."""
    return Header(stamp=stamp)


def scene_to_msg(scene: Scene) -> SceneMsg:
    """Return the message of a scene."""
    return SceneMsg(
        header=header_at(to_time(scene.stamp)),
        values=[
            SceneValueMsg(
                name=v.name,
                origin=int(v.origin),
                source=v.source,
                # rclpy silently writes an int in a float field as garbage.
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
        Refused: As in :meth:`SceneSpace.scene` and :func:`facts`; also ``EMPTY`` without a scene
            id, ``TOO_LONG`` and ``UNKNOWN_ORIGIN``.
    """
    if not message.scene_id:
        raise Refused(RefusalCode.EMPTY, "scene: no scene_id; every scene needs a unique one")
    for field, longest in SCENE_CHARACTERS.items():
        if len(getattr(message, field)) > longest:
            raise Refused(
                RefusalCode.TOO_LONG,
                f"scene: {field} has {len(getattr(message, field))} characters, expected "
                f"{longest} at most",
            )
    values = []
    for value in message.values:
        origin = _ORIGINS.get(value.origin)
        if origin is None:
            raise Refused(
                RefusalCode.UNKNOWN_ORIGIN,
                f"scene: '{value.name}' has the origin {value.origin}, expected 0-5",
            )
        numbers = {field: getattr(value, field) for field in _NUMBERS}
        values.append(SceneValue(name=value.name, origin=origin, source=value.source, **numbers))
    return Scene(
        values=space.scene(values),
        stamp=seconds(message.header.stamp),
        remembered=facts(values_of(message.remembered)),
        **{field: getattr(message, field) for field in _SAME},
    )


def partial_scene_from_msg(message: Any, space: SceneSpace) -> Scene:
    """Check a scene message in which anything may be missing; return the completed scene.

    A value without an origin counts as given. Missing values count as unknown, with a person
    unless the message has no values and ``person`` is false.

    Raises:
        Refused: As in :func:`scene_from_msg`.
    """
    complete = copy(message)
    complete.scene_id = message.scene_id or f"goal/{uuid.uuid4()}"
    complete.values = [_given(value) for value in message.values]
    there = {value.name for value in message.values}
    complete.values += [
        SceneValueMsg(name=name, origin=int(Origin.MISSING), value=math.nan)
        for name in space.names
        if name not in there
    ]
    met = message.person or bool(there)
    return space.completed(scene_from_msg(complete, space), met=met)


def _given(value: SceneValueMsg) -> SceneValueMsg:
    if value.origin != Origin.MISSING or math.isnan(value.value):
        return value
    given = copy(value)
    given.origin = int(Origin.GIVEN)
    return given


def facts_to_msg(remembered: Mapping[str, Fact]) -> list[PersonFact]:
    """Return the remembered facts about a person as a part of a message."""
    found = []
    for key, value in remembered.items():
        message = PersonFact()
        fill(message, message_fields(key, value))
        found.append(message)
    return found
