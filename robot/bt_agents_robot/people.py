# SPDX-License-Identifier: Apache-2.0
"""What sensors read of a simulated visitor, and when the next one may come; without ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from bt_agents.language.specs import SceneSpec, SourceSpec, Visit
from scene_layer.sources import inverted

PAUSE_S = 2.0
"""Time between two visits [s]."""

REACTION_S = 1.0
"""Time that people think before they answer or press a button [s]."""

_MARGIN_S = 0.1


def readings(
    spec: SceneSpec, values: Mapping[str, float], person: bool
) -> dict[SourceSpec, float]:
    """Return what each source reads when these values hold; NaN where it reads nothing."""
    found = {
        source: inverted(source, values[source.parameter])
        if source.parameter in values
        else math.nan
        for source in spec.sources
    }
    if spec.person is not None:
        found[spec.person] = inverted(spec.person, float(person))
    return found


def field_value(example: object, reading: float) -> Any:
    """Return a reading in the type of the field that carries it, known by an example.

    Raises:
        TypeError: The field is neither a boolean nor a number.
    """
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
    """Return how long nobody should come [s].

    Readings of the last visitor must be stale before somebody comes of whom less is known;
    staleness is in real time, whatever the pace.

    Args:
        spec: The sources, with the time after which their readings are stale.
        seen: Parameters that were read of the last visitor.
        coming: The next visit; None when there is none.
        pace: Speed of the simulation relative to real time.
    """
    known = coming.values if coming is not None else {}
    lingering = set(seen) - set(known)
    stale = [s.stale_after_s + _MARGIN_S for s in spec.sources if s.parameter in lingering]
    return max([PAUSE_S / pace, *stale])
