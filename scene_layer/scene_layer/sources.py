# SPDX-License-Identifier: Apache-2.0
"""Readings of sensors turned into values of scene parameters; a bad reading never gets further."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

from bt_agents.errors import Refused
from bt_agents.language.specs import SceneSpec, SourceSpec
from bt_agents.scene import check_value


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A value in the unit of its parameter, and when it holds, on the steady clock.

    Attributes:
        value: Finite; for the presence of a person a number, see :mod:`scene_layer.estimate`.
        at: When it arrived [s].
        stale_at: From when on it counts no more [s]; infinite for a given value.
    """

    value: float
    at: float
    stale_at: float = math.inf


def mapped(source: SourceSpec, reading: float) -> float:
    """Return the value of a reading: linear between the points of the source, held beyond them."""
    points = source.points
    if not points:
        return reading
    if reading <= points[0][0]:
        return points[0][1]
    for (x0, y0), (x1, y1) in pairwise(points):
        if reading <= x1:
            return y0 + (y1 - y0) * (reading - x0) / (x1 - x0)
    return points[-1][1]


def inverted(source: SourceSpec, value: float) -> float:
    """Return a reading that the points of the source map to ``value``, as nearly as they can."""
    points = source.points
    if not points:
        return value
    for (x0, y0), (x1, y1) in pairwise(points):
        if min(y0, y1) <= value <= max(y0, y1):
            return x0 if y0 == y1 else x0 + (x1 - x0) * (value - y0) / (y1 - y0)
    return min(points, key=lambda point: abs(point[1] - value))[0]


class Sources:
    """The latest good reading of every source of a system.

    A refused reading changes nothing: the last good one stays until it is stale.

    Attributes:
        refusals: How many readings were refused, by topic and code.
    """

    def __init__(self, spec: SceneSpec) -> None:
        self._spec = spec
        self._latest: dict[SourceSpec, Reading] = {}
        self.refusals: Counter[tuple[str, str]] = Counter()

    def read(self, source: SourceSpec, raw: object, now: float) -> bool:
        """Take a reading.

        Args:
            source: One of the sources of the scene's specification, or its person source.
            raw: What stood in the field of the message.
            now: Steady time of arrival [s].

        Returns:
            True when the value differs from what held before.

        Raises:
            Refused: ``NOT_A_NUMBER``, ``NOT_FINITE`` or ``OUT_OF_RANGE``.
        """
        try:
            value = self._checked(source, raw)
        except Refused as refused:
            self.refusals[source.topic, refused.code] += 1
            raise
        before = self._latest.get(source)
        self._latest[source] = Reading(value=value, at=now, stale_at=now + source.stale_after_s)
        return before is None or before.value != value or now > before.stale_at

    def latest(self, parameter: str) -> Reading | None:
        """Return the newest reading of a parameter, stale or not; None when there was none.

        Of several sources of one parameter the one that spoke last counts.
        """
        found = [
            self._latest[source]
            for source in self._spec.sources
            if source.parameter == parameter and source in self._latest
        ]
        return max(found, key=lambda reading: reading.at, default=None)

    def latest_person(self) -> Reading | None:
        """Return the newest reading of the person source, stale or not."""
        return self._latest.get(self._spec.person) if self._spec.person else None

    def _checked(self, source: SourceSpec, raw: object) -> float:
        what = f"reading of {source.topic}"
        if not isinstance(raw, bool | int | float):
            raise Refused(
                "NOT_A_NUMBER",
                f"{what}: {source.field} is a {type(raw).__name__}, "
                "expected a number or a boolean; name another field in scene.yaml",
            )
        try:
            reading = float(raw)
        except OverflowError:
            reading = math.inf
        if not math.isfinite(reading):
            raise Refused(
                "NOT_FINITE", f"{what}: {source.field} is {reading}, expected a finite number"
            )
        value = mapped(source, reading)
        if source != self._spec.person:
            check_value(self._spec.space.parameter(source.parameter), value, what=what)
        return value
