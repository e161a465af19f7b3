# SPDX-License-Identifier: Apache-2.0
"""Numbers and times as people write them, turned into SI values or a reason why not."""

from __future__ import annotations

import math
import re

from bt_agents.errors import BtAgentsError

MAX_DURATION_S = 365 * 24 * 3600.0
"""No interaction takes longer than a year."""

UNITS = {"ms": (1, 1000), "s": (1, 1), "min": (60, 1), "h": (3600, 1)}
"""Units of time and their seconds as a fraction, which keeps 700 ms at 0.7 s exactly."""

_NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_NUMBER_ONLY = re.compile(_NUMBER)
_INTEGER = re.compile(r"[-+]?[0-9]+")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")
_QUANTITY = re.compile(rf"({_NUMBER})\s*([^\W\d_]*)")
_CLOCK = re.compile(r"[0-9]+(:[0-9]+)+")
_NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)
_OTHER_UNITS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "S": "s",
    "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
    "m": "min", "mins": "min", "minute": "min", "minutes": "min",
    "hr": "h", "hrs": "h", "hour": "h", "hours": "h",
}  # fmt: skip
_LARGEST_INTEGER = 2**63 - 1
_MAX_LENGTH = 400


class QuantityError(BtAgentsError):
    """A text that is not the number or time it should be.

    Attributes:
        message: What was found and what is expected.
        hint: How to mend it; may be empty.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def number(text: str) -> float:
    """Return a finite number.

    Raises:
        QuantityError: It is none.
    """
    text = text.strip()
    if len(text) > _MAX_LENGTH or not _NUMBER_ONLY.fullmatch(text):
        raise _no_number(text, "a number")
    return _finite(text)


def integer(text: str) -> int:
    """Return a whole number of at most 64 bits.

    Raises:
        QuantityError: It is none.
    """
    text = text.strip()
    if not _INTEGER.fullmatch(text):
        if len(text) <= _MAX_LENGTH and _NUMBER_ONLY.fullmatch(text):
            value = float(text)
            whole = math.isfinite(value) and value.is_integer() and abs(value) < 1e15
            hint = f"write {value:.0f}" if whole else ""
            raise QuantityError(f"expected a whole number, found '{_short(text)}'", hint)
        raise _no_number(text, "a whole number")
    _check_zero(text)
    value = int(text) if len(text) < 25 else _LARGEST_INTEGER + 1
    if abs(value) > _LARGEST_INTEGER:
        raise QuantityError(f"'{_short(text)}' is too large", "use at most 18 digits")
    return value


def duration(text: str) -> float:
    """Return a time [s], not negative; a number without unit is seconds.

    Raises:
        QuantityError: It is none.
    """
    text = text.strip()
    match = _QUANTITY.fullmatch(text) if len(text) <= _MAX_LENGTH else None
    if not match:
        if _CLOCK.fullmatch(text):
            hint = "write minutes and seconds as one number, for example 90 s or 1.5 min"
            raise QuantityError(f"expected a time, found '{_short(text)}'", hint)
        raise _no_number(text, "a time such as '8 s'")
    amount, unit = match.groups()
    if unit and unit not in UNITS:
        near = _OTHER_UNITS.get(unit) or _OTHER_UNITS.get(unit.lower())
        near = near or (unit.lower() if unit.lower() in UNITS else None)
        hint = f"write {amount} {near}" if near else "use ms, s, min or h"
        raise QuantityError(f"'{_short(unit)}' is not a unit of time", hint)
    times, over = UNITS[unit or "s"]
    seconds = _finite(amount) * times / over
    if seconds < 0:
        raise QuantityError(f"a time cannot be negative, found '{_short(text)}'")
    if seconds > MAX_DURATION_S:
        raise QuantityError(f"'{_short(text)}' is longer than a year", "write a shorter time")
    return seconds


def is_duration(text: str) -> bool:
    """Return whether a text is a number with a unit of time behind it."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) < 40 else None
    return match is not None and match[2] in UNITS


def means_duration(text: str) -> bool:
    """Return whether a text is a number with something like a unit of time behind it."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) < 40 else None
    return match is not None and (match[2] in UNITS or match[2] in _OTHER_UNITS)


def _finite(text: str) -> float:
    _check_zero(text)
    value = float(text)
    if not math.isfinite(value):
        raise QuantityError(f"'{_short(text)}' is too large for a number", "write a finite number")
    return value


def _check_zero(text: str) -> None:
    if _LEADING_ZERO.match(text):
        sign = text[0] if text[0] in "+-" else ""
        meant = sign + (text.lstrip("+-").lstrip("0") or "0")
        meant = sign + "0" + meant[len(sign) :] if meant[len(sign) :].startswith(".") else meant
        raise QuantityError(
            f"'{_short(text)}' starts with a zero, which some programs read as another number",
            f"write {_short(meant)}",
        )


def _no_number(text: str, expected: str) -> QuantityError:
    if _NOT_FINITE.fullmatch(text):
        return QuantityError(f"expected {expected}, found '{text}'", "write a finite number")
    hint = ""
    if len(text) > _MAX_LENGTH:
        return QuantityError(f"expected {expected}, found '{_short(text)}'")
    quantity = _QUANTITY.fullmatch(text)
    if re.fullmatch(r"[-+]?[0-9]+,[0-9]+.*", text):
        hint = f"use a point: {_short(text.replace(',', '.', 1))}"
    elif re.fullmatch(r"[-+]?[0-9][0-9_' ]*", text):
        hint = f"write the digits without anything between: {_short(re.sub('[^-+0-9]', '', text))}"
    elif re.fullmatch(r"[-+]?0[xXoObB][0-9a-fA-F]+", text):
        hint = "write it as a decimal number"
    elif quantity and "time" not in expected:
        hint = f"no unit is possible here: {quantity[1]}"
    return QuantityError(f"expected {expected}, found '{_short(text)}'", hint)


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:39]}…"
