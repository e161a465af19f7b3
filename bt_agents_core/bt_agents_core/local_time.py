# SPDX-License-Identifier: Apache-2.0
"""Local time of a robot: the hour of the day and the day of the week."""

from __future__ import annotations

import time
from dataclasses import dataclass

WEEKDAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")

_HOUR_S = 3600.0


@dataclass(frozen=True, kw_only=True)
class LocalTime:
    """Hour of the day, from 0 to 23, and day of the week."""

    hour: int
    weekday: str

    def after(self, seconds: float) -> LocalTime:
        """Return the local time a number of seconds after the beginning of this hour."""
        days, hour = divmod(self.hour + int(seconds // _HOUR_S), 24)
        weekday = WEEKDAYS[(WEEKDAYS.index(self.weekday) + days) % len(WEEKDAYS)]
        return LocalTime(hour=hour, weekday=weekday)


NOON = LocalTime(hour=12, weekday="monday")
"""Local time if none is given."""


def local_time(stamp_s: float) -> LocalTime:
    """Return the local time of a Unix timestamp [s], in the time zone of this machine."""
    then = time.localtime(stamp_s)
    return LocalTime(hour=then.tm_hour, weekday=WEEKDAYS[then.tm_wday])


def next_hour_s(elapsed_s: float) -> float:
    """Return when the next hour begins; both times count from the beginning of an hour [s]."""
    return (elapsed_s // _HOUR_S + 1) * _HOUR_S
