# SPDX-License-Identifier: Apache-2.0
"""Conversion of numbers, times, lengths and angles from and to texts."""

from __future__ import annotations

import math
import re

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import FieldType
from bt_agents_core.text import ellipsize
from bt_agents_language.expression.units import (
    DIMENSIONS,
    LENGTH,
    TIME,
    Dimension,
    dimension_meant,
    dimension_of,
)

MAX_DURATION_S = 365 * 24 * 3600.0
"""Longest duration: a year [s]."""

_NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_PART = re.compile(rf"({_NUMBER})\s*([^\W\d_]+)\s*(?:and\b)?\s*")
_NUMBER_ONLY = re.compile(_NUMBER)
_INTEGER = re.compile(r"[-+]?[0-9]+")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")
_QUANTITY = re.compile(rf"({_NUMBER})\s*([^\W\d_]*|°)")
_SEVERAL = re.compile(rf"{_NUMBER}\s*[^\W\d_]+\s*(?:and\s*)?{_NUMBER}\s*[^\W\d_]*")
_CLOCK = re.compile(r"[0-9]{1,4}(:[0-9]{1,2})+")
_CONDITION = re.compile(r"[a-z]\w*\.\w+|.*([<>=]|\b(and|or|not)\b).*")
_NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)
_UNIT = r"([^\W\d_]*)"
_TO = r"(?(between)\band\b|(?:-|–|…|\.\.+|\bto\b))"
_RANGE = re.compile(
    rf"(?P<between>between\s+)?({_NUMBER})\s*{_UNIT}\s*{_TO}\s*({_NUMBER})\s*{_UNIT}"
)
_WORDS = {
    "half": 0.5, "zero": 0, "one": 1, "once": 1, "two": 2, "twice": 2, "couple": 2, "three": 3,
    "few": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9, "ten": 10,
    "eleven": 11, "twelve": 12, "fifteen": 15, "twenty": 20, "thirty": 30, "forty": 40,
    "fifty": 50, "sixty": 60, "ninety": 90,
}  # fmt: skip
_FILLERS = ("a", "an", "and", "of", "for", "about", "times")
_NO_LIMIT = ("none", "never", "forever", "infinite", "unlimited", "endless", "no", "off", "false")
_LARGEST_INTEGER = 2**63 - 1
_MAX_LENGTH = 400
_LONGEST_QUANTITY = 40

COMMENT = re.compile(r"(?<!\S)(?://(?!\S*/)|/\*(?=[\s\w*]))")
"""Mark that starts a comment in other languages; there is none in ``https://…``."""


class QuantityError(BtAgentsError):
    """Text that is not the expected number or quantity; ``hint`` may be empty."""

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
    _check_zero(text)
    return _finite(float(text), text)


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
            raise QuantityError(f"expected a whole number, found '{ellipsize(text)}'", hint)
        raise _no_number(text, "a whole number")
    _check_zero(text)
    value = int(text) if len(text) < 25 else _LARGEST_INTEGER + 1
    if abs(value) > _LARGEST_INTEGER:
        raise QuantityError(f"'{ellipsize(text)}' is too large", "use at most 18 digits")
    return value


def quantity(text: str, field_type: FieldType) -> float:
    """Return a time [s], length [m] or angle [rad]; these are the units of a bare number.

    Raises:
        QuantityError: It is not a quantity, or a time that is negative or longer than a year.
    """
    dimension = DIMENSIONS[field_type]
    text = text.strip()
    match = _QUANTITY.fullmatch(text) if len(text) <= _MAX_LENGTH else None
    if not match:
        raise _no_quantity(text, dimension)
    amount, unit = match.groups()
    unit = unit or dimension.si
    if unit not in dimension.units:
        raise _wrong_unit(text, amount, unit, dimension)
    _check_zero(amount)
    value = _finite(dimension.si_value(_finite(float(amount), amount), unit), text)
    if dimension is TIME and value < 0:
        raise QuantityError(f"a time cannot be negative, found '{ellipsize(text)}'")
    if dimension is TIME and value > MAX_DURATION_S:
        raise QuantityError(f"'{ellipsize(text)}' is longer than a year", "write a shorter time")
    return value


def quantity_type(text: str, *, strict: bool = True) -> FieldType | None:
    """Return the type of a number with a unit, None for any other text.

    Without ``strict``, any word similar to a unit counts as one.
    """
    unit = word_after_number(text)
    dimension = dimension_of(unit) if strict else dimension_meant(unit)
    return None if dimension is None else dimension.type


def word_after_number(text: str) -> str:
    """Return the word after the number at the start of a text; empty for any other text."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) < _LONGEST_QUANTITY else None
    return match[2] if match is not None else ""


def is_clock(text: str) -> bool:
    """Return whether a text has the form of a clock time: ``1:30``."""
    return _CLOCK.fullmatch(text.strip()) is not None


def format_quantity(value: float, field_type: FieldType, digits: int = 3) -> str:
    """Return an SI value in the form that people write: ``1.5 min``, ``250 ms``, ``90 deg``.

    A quantity keeps a number of significant digits; a value of any other type gets no unit.
    """
    if not math.isfinite(value):
        return f"{value:g}"
    size = abs(float(f"{value:.{digits - 1}e}"))
    match field_type:
        case FieldType.DURATION:
            unit = _time_unit(size)
        case FieldType.LENGTH:
            unit = _length_unit(size)
        case FieldType.ANGLE:
            unit = "deg"
        case _:
            return f"{value:g}" if isinstance(value, float) else str(value)
    times, over = DIMENSIONS[field_type].units[unit]
    return f"{_amount(value * over / times, digits)} {unit}"


def _time_unit(seconds: float) -> str:
    if seconds < 60:
        return "s" if seconds >= 1 or seconds == 0 else "ms"
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        tenths = seconds / size * 10
        if seconds >= size and abs(tenths - round(tenths)) < 1e-6:
            return unit
    # 100 s reads better than 1.67 min, 27.8 min better than 1670 s.
    return "s" if seconds < 600 else "min" if seconds < 7200 else "h"


def _length_unit(metres: float) -> str:
    if metres >= 1 or metres == 0:
        return "km" if metres >= 1000 else "m"
    return "cm" if metres >= 0.01 else "mm"


def _amount(value: float, digits: int) -> str:
    value = float(f"{value:.{digits - 1}e}")
    if 10 ** (digits - 1) <= abs(value) < 1e15:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def _sum(text: str, dimension: Dimension) -> str:
    """Return the sum of several quantities, or an example if a part is none: ``1 min 30 s``."""
    parts = [(float(amount), dimension.meant(unit)) for amount, unit in _PART.findall(text)]
    total = sum(dimension.si_value(amount, unit) for amount, unit in parts if unit)
    if _PART.sub("", text) or not all(unit for _, unit in parts) or not math.isfinite(total):
        return f"for example {dimension.example}"
    return f"here {total:.10g} {dimension.si}"


def _no_quantity(text: str, dimension: Dimension) -> QuantityError:
    hint = ""
    if dimension is TIME and _CLOCK.fullmatch(text):
        hint = "write minutes and seconds as one number, for example 90 s or 1.5 min"
    elif len(text) <= _MAX_LENGTH and (digits := _in_digits(text, dimension)):
        hint = digits
    elif len(text) <= _MAX_LENGTH and _SEVERAL.fullmatch(text):
        hint = f"write one number with one unit, {_sum(text, dimension)}"
    elif dimension is TIME and text.lower() in _NO_LIMIT:
        hint = "where no time is meant, leave the key out"
    elif dimension is TIME and len(text) <= _MAX_LENGTH and _CONDITION.fullmatch(text):
        hint = "to wait until something is true, write 'wait_for: …'"
    if hint:
        return QuantityError(f"expected {dimension.wanted}, found '{ellipsize(text)}'", hint)
    return _no_number(text, dimension.wanted, dimension)


def _wrong_unit(text: str, amount: str, unit: str, dimension: Dimension) -> QuantityError:
    near = dimension.meant(unit)
    if near:
        return QuantityError(
            f"'{unit}' is not a unit of {dimension.name}", f"write {amount} {near}"
        )
    other = dimension_meant(unit)
    if other is None:
        return QuantityError(
            f"'{ellipsize(unit)}' is not a unit of {dimension.name}", f"use {dimension.listed}"
        )
    hint = f"use {dimension.listed}"
    if dimension is TIME and unit.lower() == "m":
        hint = f"write {amount} min for minutes; m is metres"
    elif dimension is LENGTH and unit == "min":
        hint = f"write {amount} m for metres; min is minutes"
    return QuantityError(
        f"expected {dimension.wanted}, found the {other.name} '{ellipsize(text)}'", hint
    )


def _finite(value: float, text: str) -> float:
    if not math.isfinite(value):
        raise QuantityError(
            f"'{ellipsize(text)}' is too large for a number", "write a finite number"
        )
    return value


def _check_zero(text: str) -> None:
    if text[0] in "0+-" and _LEADING_ZERO.match(text):
        sign = text[0] if text[0] in "+-" else ""
        meant = sign + (text.lstrip("+-").lstrip("0") or "0")
        meant = sign + "0" + meant[len(sign) :] if meant[len(sign) :].startswith(".") else meant
        raise QuantityError(
            f"'{ellipsize(text)}' starts with a zero, which some programs read as another number",
            f"write {ellipsize(meant)}",
        )


def ends_of(text: str) -> tuple[str, str] | None:
    """Return the ends of a range: ``5 s`` and ``10 s`` of ``5 to 10 s``; None for other texts."""
    match = _RANGE.fullmatch(text) if len(text) <= _MAX_LENGTH else None
    if match is None:
        return None
    _, low, first, high, last = match.groups()
    return f"{low} {first or last}".strip(), f"{high} {last or first}".strip()


def _in_digits(text: str, dimension: Dimension | None) -> str:
    """Return how to write ``half an hour`` or ``5 to 10 s``; empty for any other text."""
    such = ""
    if ends := ends_of(text):
        (low, *first), (high, *last) = (end.split(" ") for end in ends)
        middle = (float(low) + float(high)) / 2
        words = [f"{middle if '.' in low + high else round(middle, 0):g}", *{*first, *last}]
        such = "one value, such as "
    else:
        found = re.split(r"[\s-]+", text.lower().rstrip("."))
        numbers = [_WORDS[one] for one in found if one in _WORDS]
        words = [one for one in found if one not in _WORDS and one not in _FILLERS]
        if numbers or {"a", "an"}.intersection(found):
            words.insert(0, f"{sum(numbers) if numbers else 1:g}")
    match = _QUANTITY.fullmatch(" ".join(words))
    if match is None or (dimension is None and match[2]):
        return ""
    unit = dimension.meant(match[2] or dimension.si) if dimension is not None else ""
    return "" if unit is None else f"write {such}{match[1]} {unit}".strip()


def _no_number(text: str, wanted: str, dimension: Dimension | None = None) -> QuantityError:
    if len(text) > _MAX_LENGTH:
        return QuantityError(f"expected {wanted}, found '{ellipsize(text)}'")
    finite = not _NOT_FINITE.fullmatch(text)
    hint = _number_hint(text, dimension) if finite else "write a finite number"
    return QuantityError(f"expected {wanted}, found '{ellipsize(text)}'", hint)


def _number_hint(text: str, dimension: Dimension | None) -> str:
    """Return how to write a number, or a quantity of a dimension."""
    if COMMENT.search(text):
        return "a comment starts with '#'"
    if digits := _in_digits(text, dimension):
        return digits
    until = re.fullmatch(r"until\s+(.+)", text)
    if until:
        condition = f"answer == '{until[1]}'" if until[1].isalnum() else ellipsize(until[1])
        return f"write repeat: {{until: {condition}}}"
    if text[:1] in "−–" and text[1:2].isdecimal():
        return f"write the plain minus sign: -{ellipsize(text[1:])}"
    if text.isdecimal() and len(text) < 19:
        return f"write {int(text)} in plain digits"
    if re.fullmatch(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}", text):
        return f"write {text.replace(',', '')}, or with a point {text.replace(',', '.')}"
    if re.fullmatch(r"[-+]?[0-9]+,[0-9]+[^,]*", text):
        return f"use a point: {ellipsize(text.replace(',', '.', 1))}"
    if re.fullmatch(r"[-+]?[0-9][0-9_' ,]*", text):
        return (
            f"write the digits without anything between: {ellipsize(re.sub('[^-+0-9]', '', text))}"
        )
    if re.fullmatch(r"[-+]?0[xXoObB][0-9a-fA-F]+", text):
        return "write it as a decimal number"
    share = re.fullmatch(rf"({_NUMBER})\s*(?:%|/\s*([1-9][0-9]{{0,8}}))", text)
    if share:
        return f"write {float(share[1]) / float(share[2] or 100):.6g}"
    bare = _QUANTITY.fullmatch(text) if dimension is None else None
    return f"no unit is possible here: write {bare[1]}" if bare else ""
