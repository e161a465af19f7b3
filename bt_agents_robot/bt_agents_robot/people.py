# SPDX-License-Identifier: Apache-2.0
"""Sensor readings of a simulated visitor, and the pause before the next one; without ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.source_mapping import inverted
from bt_agents_language.model.scene_specs import SceneSpec, SourceSpec
from bt_agents_language.model.specs import Script, Visit

PAUSE_S = 2.0
"""Time between two visits [s]."""

REACTION_S = 1.0
"""Time that people need before they answer or press a button [s]."""

_MARGIN_S = 0.1

_NEAR = 0.1
"""Largest difference between a value and its measurement, as a share of the range."""


def check_visitors(spec: SceneSpec, script: Script) -> None:
    """Check that the sensors of a scene can represent the visitors of a script.

    Raises:
        Refused: ``NAMED_VISITOR`` for a visitor who would stay unknown.
    """
    if spec.names_persons:
        return
    named = next((visit for visit in script.visits if visit.name), None)
    if named is not None:
        raise Refused(
            RefusalCode.NAMED_VISITOR,
            f"the visitor '{named.label}' has the name '{named.name}', which no sensor tells: "
            "scene.yaml has no 'known' under 'persons'; remove 'name', or have the scene layer "
            "play the script itself (its parameter script)",
        )


def readings(
    spec: SceneSpec, values: Mapping[str, float], person: bool, name: str = ""
) -> dict[SourceSpec, float | str]:
    """Return the reading of each source for these values; NaN if it reads nothing.

    Args:
        spec: The scene.
        values: True values of the visitor, by scene parameter.
        person: Whether the visitor is a person.
        name: Name of the visitor; empty if unknown.
    """
    found = {
        source: _reading(source, values[source.parameter])
        if source.parameter in values
        else math.nan
        for source in spec.sources
    }
    if spec.person is not None:
        found[spec.person] = inverted(spec.person.points, float(person))
    if spec.persons is not None:
        if spec.persons.known is not None:
            found[spec.persons.known] = _reading(spec.persons.known, float(bool(name)))
        if spec.persons.addressee.source is not None:
            found[spec.persons.addressee.source] = _reading(spec.persons.addressee.source, 1.0)
        for part in spec.persons.parts:
            found[part] = part_id(part)
    return found


def _nearest_row(source: SourceSpec, value: float) -> tuple[str, float]:
    """Return the word of a table whose value is the nearest, with that value."""
    return min(source.table, key=lambda row: abs(row[1] - value))


def sample_reading(spec: SceneSpec, source: SourceSpec) -> float | str:
    """Return a possible reading of a source."""
    if spec.persons is not None and source in spec.persons.parts:
        return part_id(source)
    return source.table[0][0] if source.table else 0.0


def part_id(part: SourceSpec) -> str:
    """Return the id of a part of the current visitor."""
    return f"{part.parameter}1"


def _reading(source: SourceSpec, value: float) -> float | str:
    if source.table:
        return _nearest_row(source, value)[0]
    return inverted(source.points, value)


def is_measured(
    spec: SceneSpec,
    values: Mapping[str, float],
    person: bool,
    person_measured: bool,
    measured: Mapping[str, float],
) -> bool:
    """Return whether a scene layer measures a visitor as in :func:`readings`.

    Args:
        spec: The scene.
        values: True values of the visitor, by scene parameter.
        person: Whether the visitor is a person.
        person_measured: Whether the scene layer measures a person.
        measured: Values that it measures, by scene parameter.
    """
    tells_persons = spec.person is not None or spec.persons is not None
    if tells_persons and person_measured != person:
        return False
    for source in spec.sources:
        if source.parameter not in values:
            continue
        value = values[source.parameter]
        if source.table:
            value = _nearest_row(source, value)[1]
        one = spec.space.parameter(source.parameter)
        off = abs(measured.get(source.parameter, math.inf) - value)
        if off > _NEAR * (one.maximum - one.minimum):
            return False
    return True


def is_read(reading: float | str) -> bool:
    """Return whether a source has a reading."""
    return isinstance(reading, str) or not math.isnan(reading)


def field_value(example: object, reading: float | str) -> Any:
    """Return a reading in the type of its field, which an example shows.

    Raises:
        TypeError: The field cannot carry it.
    """
    if isinstance(reading, str) and isinstance(example, str):
        return reading
    if isinstance(example, str) and not is_read(reading):
        return ""
    if isinstance(reading, str):
        truth = {"true": 1.0, "false": 0.0}
        try:
            reading = truth[reading] if reading in truth else float(reading)
        except ValueError:
            raise TypeError(f"a {type(example).__name__}, expected a text") from None
    if isinstance(example, bool):
        return reading >= 0.5
    if isinstance(example, float):
        return reading
    if isinstance(example, int):
        return 0 if math.isnan(reading) else round(reading)
    raise TypeError(f"a {type(example).__name__}, expected a boolean or a number")


def nested(fields: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return values of dotted paths as nested mappings: ``a.b: 1`` becomes ``{a: {b: 1}}``."""
    root: dict[str, Any] = {}
    for path, value in fields:
        *parents, last = path.split(".")
        inner = root
        for parent in parents:
            inner = inner.setdefault(parent, {})
        inner[last] = value
    return root


def pause_after(spec: SceneSpec, seen: Iterable[str], coming: Visit | None, pace: float) -> float:
    """Return the pause before the next visitor [s].

    Readings of the last visitor must become stale before a visitor with fewer readings comes, and
    a tracked visitor must be lost; both take real time, whatever the pace.
    """
    known = coming.values if coming is not None else {}
    lingering = set(seen) - set(known)
    stale = [
        source.stale_after_s + _MARGIN_S
        for source in spec.sources
        if source.parameter in lingering and math.isfinite(source.stale_after_s)
    ]
    if spec.persons is not None:
        stale.append(spec.persons.tracked.lost_after_s + _MARGIN_S)
    return max([PAUSE_S / pace, *stale])
