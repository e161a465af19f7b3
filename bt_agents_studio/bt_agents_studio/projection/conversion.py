# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to records by the names and types of the record's fields."""

from __future__ import annotations

import math
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache, partial
from operator import attrgetter
from typing import Any, TypeVar

from bt_agents_studio.records import STAMP, Json, Names

_Record = TypeVar("_Record")
_VALUE_FIELDS = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value"}


def record_of(kind: Callable[..., _Record], message: Any, **given: object) -> _Record:
    """Return the record of a message, whose fields are read only by their names.

    Args:
        kind: Class of the record.
        message: Object with the fields of its type as attributes.
        given: Record fields that the message lacks, or has in another form.
    """
    readers = _readers(kind).items()
    return kind(**{name: read(message) for name, read in readers if name not in given}, **given)


def seconds(stamp: Any) -> float:
    """Return a time stamp as seconds since 1970."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def name_of(names: Sequence[str], number: int) -> str:
    """Return the name of a constant, or the digits of an unknown one."""
    return names[number] if 0 <= number < len(names) else str(number)


def finite(value: float) -> float | None:
    """Return a number if it is finite, so that JSON can hold it; else None."""
    return float(value) if math.isfinite(value) else None


def finite_values(
    names: Sequence[str], values: Iterable[float], *, missing: bool = True
) -> dict[str, Any]:
    """Return numbers by name; those that are not finite as None, or not at all."""
    pairs = zip(names, map(finite, values), strict=False)
    return {name: value for name, value in pairs if missing or value is not None}


def parameter_value(value: Any) -> Json:
    """Return the value of a ``ParameterValue``; None for a list or an unset value."""
    field = _VALUE_FIELDS.get(int(value.type))
    if field is None:
        return None
    found: Json = getattr(value, field)
    return finite(found) if isinstance(found, float) else found


@cache
def _readers(kind: Any) -> Mapping[str, Callable[[Any], object]]:
    """Return a reader for each field of a record, except fields that must be given."""
    hints = typing.get_type_hints(kind, include_extras=True)
    readers = {name: _reader(name, hint) for name, hint in hints.items()}
    return {name: reader for name, reader in readers.items() if reader is not None}


def _reader(name: str, hint: Any) -> Callable[[Any], object] | None:
    field = attrgetter(name)
    [mark] = getattr(hint, "__metadata__", [None])
    if mark is STAMP:
        return _sent_at
    if isinstance(mark, Names):
        return lambda message: name_of(mark, field(message))
    if hint in (bool, float, int, str):
        return field
    convert = _converter(hint)
    return convert and (lambda message: convert(field(message)))


def _converter(hint: Any) -> Callable[[Any], object] | None:
    if hint == float | None:
        return finite
    if isinstance(hint, type) and is_dataclass(hint):
        return partial(record_of, hint)
    if typing.get_origin(hint) is not tuple:
        return None
    [each, _] = typing.get_args(hint)
    convert: Callable[[Any], object] | None = each if each is float else _converter(each)
    return (lambda values: tuple(map(convert, values))) if convert else tuple


def _sent_at(message: Any) -> float:
    return seconds(message.stamp if hasattr(message, "stamp") else message.header.stamp)
