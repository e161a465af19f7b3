# SPDX-License-Identifier: Apache-2.0
"""Numbers and times as people write them."""

from __future__ import annotations

import pytest

from bt_agents.language.quantities import QuantityError, duration, integer, number


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("8 s", 8.0),
        ("500 ms", 0.5),
        ("700 ms", 0.7),
        ("5 min", 300.0),
        ("1.5 h", 5400.0),
        ("8s", 8.0),
        ("0 s", 0.0),
        ("2", 2.0),
        ("2.5", 2.5),
        ("1e2 s", 100.0),
        (" 3 s ", 3.0),
    ],
)
def test_times_are_seconds(text, seconds):
    assert duration(text) == seconds


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("8 sec", "write 8 s"),
        ("8 seconds", "write 8 s"),
        ("2 m", "write 2 min"),
        ("2 Min", "write 2 min"),
        ("5 km", "use ms, s, min or h"),
        ("1:30", "for example 90 s"),
        ("1,5 s", "use a point: 1.5 s"),
        ("08 s", "write 8"),
        ("-1 s", ""),
        (".inf", "finite"),
        ("nan", "finite"),
        ("1e999 s", "finite"),
        ("1e9 h", "shorter"),
        ("s", ""),
        ("", ""),
        ("soon", ""),
        ("8 s s", ""),
        ("9" * 100_000, ""),
    ],
)
def test_what_is_no_time_is_refused_with_a_way_to_mend_it(text, hint):
    with pytest.raises(QuantityError) as error:
        duration(text)
    assert hint in error.value.hint
    assert len(error.value.message) < 150


@pytest.mark.parametrize(
    ("text", "value"), [("1", 1.0), ("-0.5", -0.5), ("1e-3", 0.001), ("5.", 5.0)]
)
def test_numbers_are_read(text, value):
    assert number(text) == value


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("010", "write 10"),
        ("00.5", "write 0.5"),
        ("-07", "write -7"),
        ("1,5", "use a point: 1.5"),
        ("1_000", "1000"),
        ("1 000", "1000"),
        ("0x10", "decimal"),
        ("5 s", "no unit is possible here: 5"),
        (".nan", "finite"),
        ("-.inf", "finite"),
        ("Infinity", "finite"),
        ("1e999", "finite"),
        ("true", ""),
        ("１", ""),  # noqa: RUF001
    ],
)
def test_what_is_no_number_is_refused_with_a_way_to_mend_it(text, hint):
    with pytest.raises(QuantityError) as error:
        number(text)
    assert hint in error.value.hint


@pytest.mark.parametrize(
    ("text", "value"), [("0", 0), ("-3", -3), ("+3", 3), (str(2**63 - 1), 2**63 - 1)]
)
def test_whole_numbers_are_read(text, value):
    assert integer(text) == value


@pytest.mark.parametrize(
    "text", ["2.0", "1e3", "010", "1.5", str(2**63), "9" * 100_000, "1e999", "x"]
)
def test_what_is_no_whole_number_is_refused(text):
    with pytest.raises(QuantityError):
        integer(text)
