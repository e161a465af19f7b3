# SPDX-License-Identifier: Apache-2.0
"""Numbers, times, lengths and angles as people write them."""

from __future__ import annotations

import math
import re
from functools import partial

import pytest

from bt_agents_core.field_types import FieldType
from bt_agents_language.expression.quantities import (
    QuantityError,
    format_quantity,
    integer,
    is_clock,
    number,
    quantity,
    quantity_type,
)

duration = partial(quantity, field_type=FieldType.DURATION)
length = partial(quantity, field_type=FieldType.LENGTH)
angle = partial(quantity, field_type=FieldType.ANGLE)


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (duration, "1.5 h", 5400.0),
        (duration, "8s", 8.0),
        (duration, "2", 2.0),
        (duration, "1e2 s", 100.0),
        (duration, " 3 s ", 3.0),
        (length, "150 cm", 1.5),
        (length, "7 mm", 0.007),
        (length, "2 km", 2000.0),
        (angle, "-45 deg", -math.pi / 4),
        (angle, "0.1", 0.1),
        (number, "1e-3", 0.001),
        (number, "5.", 5.0),
        (integer, "+3", 3),
        (integer, str(2**63 - 1), 2**63 - 1),
    ],
)
def test_numbers_and_quantities_are_read_in_si_units(read, text, value):
    assert read(text) == value


@pytest.mark.parametrize(
    ("read", "text", "hint"),
    [
        (duration, "8 sec", "write 8 s"),
        (duration, "2 Min", "write 2 min"),
        (duration, "1:30", "for example 90 s"),
        (duration, "one and a half minutes", "write 1.5 min"),
        (duration, "twenty-five secs.", "write 25 s"),
        (duration, "a minute", "write 1 min"),
        (duration, "five", "write 5 s"),
        (duration, "5 to 10 s", "write one value, such as 8 s"),
        (duration, "1.5-2 s", "write one value, such as 1.75 s"),
        (duration, "30 s to 1 min", ""),
        (duration, "1e300-1e300 s", "write one value, such as 1e+300 s"),
        (duration, "1e400..5 s", ""),
        (duration, "1,5 s", "use a point: 1.5 s"),
        (duration, "08 s", "write 8"),
        (duration, "-1 s", ""),
        (duration, "nan", "finite"),
        (duration, "1e308 h", "finite"),
        (duration, "1e9 h", "shorter"),
        (duration, "5 parsecs", "use ms, s, min or h"),
        (duration, "", ""),
        (duration, "8 s s", ""),
        (duration, "9" * 100_000, ""),
        (number, "010", "write 10"),
        (number, "00.5", "write 0.5"),
        (number, "-07", "write -7"),
        (number, "1,5", "use a point: 1.5"),
        (number, "1,000", "write 1000, or with a point 1.000"),
        (number, "1_000", "1000"),
        (number, "0x10", "decimal"),
        (number, "5 s", "no unit is possible here: write 5"),
        (number, "Infinity", "finite"),
        (number, "1e999", "finite"),
        (number, "１", ""),  # noqa: RUF001
    ],
)
def test_invalid_number_or_time_is_rejected_with_hint(read, text, hint):
    with pytest.raises(QuantityError) as error:
        read(text)
    assert hint in error.value.hint
    assert len(error.value.message) < 150


@pytest.mark.parametrize(
    ("read", "text", "message", "hint"),
    [
        (duration, "5 m", "a time such as '8 s', found the length '5 m'", "minutes; m is metres"),
        (duration, "2 M", "found the length '2 M'", "write 2 min for minutes; m is metres"),
        (duration, "90 deg", "found the angle '90 deg'", "use ms, s, min or h"),
        (length, "5 min", "found the time '5 min'", "write 5 m for metres; min is minutes"),
        (angle, "1 m", "an angle such as '90 deg', found the length '1 m'", "use deg or rad"),
        (angle, "90°", "'°' is not a unit of angle", "write 90 deg"),
    ],
)
def test_quantity_of_wrong_dimension_is_rejected(read, text, message, hint):
    with pytest.raises(QuantityError, match=re.escape(message)) as error:
        read(text)
    assert hint in error.value.hint


@pytest.mark.parametrize("text", ["2.0", "010", "1.5", str(2**63), "9" * 100_000, "1e999", "x"])
def test_invalid_whole_number_is_rejected(text):
    with pytest.raises(QuantityError):
        integer(text)


@pytest.mark.parametrize(
    ("text", "exact", "meant"),
    [
        ("5 s", FieldType.DURATION, FieldType.DURATION),
        ("5 seconds", None, FieldType.DURATION),
        ("90°", None, FieldType.ANGLE),
        ("5", None, None),
        ("m", None, None),
        ("5 s later", None, None),
    ],
)
def test_unit_determines_quantity_type(text, exact, meant):
    assert quantity_type(text) is exact
    assert quantity_type(text, strict=False) is meant


def test_clock_times_are_recognised():
    assert is_clock("1:30")
    assert is_clock("12:30:59")
    assert not is_clock("1:300")


@pytest.mark.parametrize(
    ("value", "field_type", "words"),
    [
        (0.0, FieldType.DURATION, "0 s"),
        (0.25, FieldType.DURATION, "250 ms"),
        (0.9999, FieldType.DURATION, "1 s"),
        (12.345, FieldType.DURATION, "12.3 s"),
        (90.0, FieldType.DURATION, "1.5 min"),
        (1000.0, FieldType.DURATION, "16.7 min"),
        (86400.0, FieldType.DURATION, "24 h"),
        (0.0, FieldType.LENGTH, "0 m"),
        (-1.5, FieldType.LENGTH, "-1.5 m"),
        (0.8, FieldType.LENGTH, "80 cm"),
        (0.007, FieldType.LENGTH, "7 mm"),
        (1234.0, FieldType.LENGTH, "1.23 km"),
        (math.pi / 2, FieldType.ANGLE, "90 deg"),
        (1e300, FieldType.LENGTH, "1e+297 km"),
        (math.inf, FieldType.DURATION, "inf"),
        (2.0, FieldType.NUMBER, "2"),
        (1234567, FieldType.INTEGER, "1234567"),
    ],
)
def test_values_are_formatted_with_readable_unit(value, field_type, words):
    assert format_quantity(value, field_type) == words
