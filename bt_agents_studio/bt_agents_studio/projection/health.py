# SPDX-License-Identifier: Apache-2.0
"""Health of all parts, and of the studio itself: messages and entries that it cannot show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from bt_agents_core.health import Health
from bt_agents_core.text import printable_line
from bt_agents_studio.projection.conversion import name_of
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.records import ROLLING, HealthRecord
from bt_agents_studio.store import Store

UNTOLD_S = 5.0
"""Time without news after which the health of a part is stale [s]."""

ROOM = "studio: room"
"""Part name in the health for entries that do not fit."""

FAILURES = "studio: messages"
"""Part name in the health for messages that could not be shown."""

_FULL = "not all that was sent is shown: there was too much of it"
_FAILED = "some messages cannot be shown; the first of each type is in the log of the studio"
_MOST_FAILURES = 30
"""Maximum number of types with failed messages."""

_MOST_STATUSES = 500
_MOST_VALUES = 40
_LONGEST_NAME = 200
_LONGEST_TEXT = 500

_LEVELS = tuple(level.name for level in Health)


class HealthProjection:
    """``DiagnosticArray`` messages → ``health``.

    Args:
        store: Store of the entries.
        log: Log of events.
    """

    def __init__(self, store: Store, log: EventLog) -> None:
        self._store = store
        self._log = log
        # Part → first check after its last report; clocks of other machines may differ.
        self._heard: dict[str, float | None] = {}
        # Type of failed messages → their number, and the first reason.
        self._failed: dict[str, tuple[int, str]] = {}
        self.handlers = {"diagnostic_msgs/msg/DiagnosticArray": self._diagnostics}

    def fail(self, what: str, error: Exception, at_s: float) -> bool:
        """Record that a message of a type could not be shown; return whether it is the first."""
        if what not in self._failed and len(self._failed) >= _MOST_FAILURES:
            what = "others"
        reason = f"{type(error).__name__}: {printable_line(str(error))}"[:_LONGEST_NAME]
        count, first = self._failed.get(what, (0, reason))
        self._failed[what] = (count + 1, first)
        if count == 0:
            # Later ones are counted but not reported at once, because there may be very many.
            self._put_failures(at_s)
        return count == 0

    def check(self, now_s: float) -> None:
        """Mark silent parts as stale, and report entries that do not fit.

        Call it a few times a second.
        """
        if self._failed:
            self._put_failures(now_s)
        dropped = {
            name: str(count)
            for name, count in sorted(self._store.dropped.items())
            if name not in ROLLING
        }
        if dropped:
            self._put(ROOM, Health.WARN.name, _FULL, dropped, now_s)
        for name, heard_s in list(self._heard.items()):
            record = self._store.get("health", name)
            if not isinstance(record, HealthRecord):
                del self._heard[name]
            elif heard_s is None:
                self._heard[name] = now_s
            elif now_s - heard_s > UNTOLD_S:
                self._put(name, Health.STALE.name, "it is silent", record.values, heard_s)

    def _put_failures(self, at_s: float) -> None:
        values = {
            name: f"{count}, first: {reason}" for name, (count, reason) in self._failed.items()
        }
        self._put(FAILURES, Health.ERROR.name, _FAILED, values, at_s)

    def _diagnostics(self, message: Any, at_s: float) -> None:
        for one in message.status[:_MOST_STATUSES]:
            name = _name(one.name)
            self._heard[name] = None
            values = {_name(pair.key): _text(pair.value) for pair in one.values[:_MOST_VALUES]}
            level = name_of(_LEVELS, _octet(one.level))
            self._put(name, level, _text(one.message), values, at_s)

    def _put(
        self, name: str, level: str, message: str, values: Mapping[str, str], since_s: float
    ) -> None:
        before = self._store.get("health", name)
        record = HealthRecord(level=level, message=message, values=values, since_s=since_s)
        if isinstance(before, HealthRecord) and before.level == level:
            record = replace(record, since_s=before.since_s)
        elif level in (Health.ERROR.name, Health.STALE.name):
            text = f"{name}: {message}"
            self._log.event(
                f"fault {name}/{since_s}", "FAULT", level, (since_s, since_s), text=text
            )
        if record != before:
            self._store.put("health", name, record)


def _name(text: str) -> str:
    return printable_line(text)[:_LONGEST_NAME]


def _text(text: str) -> str:
    return printable_line(text)[:_LONGEST_TEXT]


def _octet(value: bytes | int) -> int:
    """Return the number of a ``byte``: rclpy receives bytes, MCAP reads a number."""
    return value if isinstance(value, int) else value[0]
