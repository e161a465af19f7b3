# SPDX-License-Identifier: Apache-2.0
"""The local time: its name, and its progress."""

from __future__ import annotations

import time

import pytest

from bt_agents_core.local_time import LocalTime, local_time, next_hour_s


@pytest.fixture
def _berlin(monkeypatch):
    monkeypatch.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("_berlin")
@pytest.mark.parametrize(
    ("stamp_s", "expected"),
    [
        (0.0, LocalTime(hour=1, weekday="thursday")),
        (1_735_599_600.0, LocalTime(hour=0, weekday="tuesday")),
        (1_751_327_999.0, LocalTime(hour=1, weekday="tuesday")),
    ],
)
def test_local_time_uses_hour_and_weekday_of_timezone(stamp_s, expected):
    assert local_time(stamp_s) == expected


@pytest.mark.parametrize(
    ("seconds", "hour", "weekday"),
    [(0, 22, "sunday"), (3599.9, 22, "sunday"), (3600, 23, "sunday"), (7200, 0, "monday")],
)
def test_local_time_advances_hours_and_weekdays(seconds, hour, weekday):
    begin = LocalTime(hour=22, weekday="sunday")
    assert begin.after(seconds) == LocalTime(hour=hour, weekday=weekday)


def test_next_hour_is_always_in_the_future():
    assert [next_hour_s(at) for at in (0.0, 3599.0, 3600.0)] == [3600.0, 3600.0, 7200.0]
