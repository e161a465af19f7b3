# SPDX-License-Identifier: Apache-2.0
"""Units of time, length and angle, with their alternative spellings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents_core.field_types import FieldType
from bt_agents_core.text import join_words


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """Dimension of a quantity.

    Attributes:
        type: Type of a field for it.
        name: Its name in words: ``time``.
        code: Code of the problem for an invalid text.
        example: Example of a quantity: ``8 s``.
        si: Unit of a bare number.
        units: Unit → its value in the SI unit, as a fraction, which keeps 700 ms at exactly 0.7 s.
        others: Alternative spelling of a unit → the unit.
    """

    type: FieldType
    name: str
    code: str
    example: str
    si: str
    units: Mapping[str, tuple[float, float]]
    others: Mapping[str, str]

    @property
    def a(self) -> str:
        """Quantity with its article: ``a time``, ``an angle``."""
        return f"an {self.name}" if self.name[0] in "aeiou" else f"a {self.name}"

    @property
    def wanted(self) -> str:
        """Expected value in words: ``a time such as '8 s'``."""
        return f"{self.a} such as '{self.example}'"

    @property
    def listed(self) -> str:
        """List of the units: ``ms, s, min or h``."""
        return join_words([*self.units], "or")

    def si_value(self, amount: float, unit: str) -> float:
        """Return an amount of a unit in SI units."""
        times, over = self.units[unit]
        return amount * times / over

    def meant(self, word: str) -> str | None:
        """Return the unit for a word; None if the word means no unit."""
        for spelling in (word, word.lower()):
            if spelling in self.units:
                return spelling
            if spelling in self.others:
                return self.others[spelling]
        return None


TIME = Dimension(
    type=FieldType.DURATION,
    name="time",
    code="bad-duration",
    example="8 s",
    si="s",
    units={"ms": (1, 1000), "s": (1, 1), "min": (60, 1), "h": (3600, 1)},
    others={
        "sec": "s", "secs": "s", "second": "s", "seconds": "s",
        "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
        "mins": "min", "minute": "min", "minutes": "min",
        "hr": "h", "hrs": "h", "hour": "h", "hours": "h",
    },
)  # fmt: skip

LENGTH = Dimension(
    type=FieldType.LENGTH,
    name="length",
    code="bad-length",
    example="1.5 m",
    si="m",
    units={"mm": (1, 1000), "cm": (1, 100), "m": (1, 1), "km": (1000, 1)},
    others={
        "meter": "m", "meters": "m", "metre": "m", "metres": "m",
        "centimeter": "cm", "centimeters": "cm", "centimetre": "cm", "centimetres": "cm",
        "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
        "kilometer": "km", "kilometers": "km", "kilometre": "km", "kilometres": "km",
    },
)  # fmt: skip

ANGLE = Dimension(
    type=FieldType.ANGLE,
    name="angle",
    code="bad-angle",
    example="90 deg",
    si="rad",
    units={"deg": (math.pi, 180), "rad": (1, 1)},
    others={
        "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad",
    },
)  # fmt: skip

DIMENSIONS = {one.type: one for one in (TIME, LENGTH, ANGLE)}
"""Type of a quantity → its dimension."""

UNITS = tuple(unit for one in DIMENSIONS.values() for unit in one.units)
"""All units."""


def dimension_of(unit: str) -> Dimension | None:
    """Return the dimension of a unit, None for a word that is not a unit."""
    return next((one for one in DIMENSIONS.values() if unit in one.units), None)


def dimension_meant(word: str) -> Dimension | None:
    """Return the dimension of a unit or an alternative spelling, None for any other word."""
    found = (one for one in DIMENSIONS.values() if one.meant(word) is not None)
    return dimension_of(word) or next(found, None)
