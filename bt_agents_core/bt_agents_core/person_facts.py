# SPDX-License-Identifier: Apache-2.0
"""Facts: values that agents remember about a person, and their only validator."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.refusal_codes import RefusalCode

Fact = bool | float | str
"""A remembered value about a person."""

MOST_FACTS = 32
"""Maximum number of facts about one person."""

LONGEST_FACT = 500
"""Longest remembered text in characters."""

_KEY = re.compile(r"[a-z][a-z0-9_]{0,63}")
_TYPES: Mapping[FieldType, tuple[type, str]] = {
    FieldType.TEXT: (str, "a text"),
    FieldType.NUMBER: (float, "a number"),
    FieldType.BOOLEAN: (bool, "true or false"),
}
_VALUE_FIELDS: Mapping[int, tuple[str, type]] = {
    1: ("bool_value", bool),
    2: ("integer_value", int),
    3: ("double_value", float),
    4: ("string_value", str),
}
"""Type of a ``ParameterValue``, as in ``ParameterType.msg`` → its field and Python type."""

_NOT_SET = 0


FACT_TYPES = tuple(_TYPES)
"""Types of facts."""


def fact(key: str, value: object, wanted: FieldType | None = None) -> Fact:
    """Return a value from outside as a fact; an integer becomes a float.

    Raises:
        Refused: ``BAD_KEY`` or ``BAD_VALUE``: the value has no such type or not the ``wanted``
            one, is not finite, or is too long.
    """
    if not _KEY.fullmatch(key):
        raise Refused(
            RefusalCode.BAD_KEY,
            f"{key[:64]!r} is not a name of something remembered; expected small letters, digits "
            "and '_', a letter first, 64 at most",
        )
    if isinstance(value, int) and not isinstance(value, bool):
        value = _as_float(value)
    expected = [_TYPES[wanted]] if wanted is not None else [*_TYPES.values()]
    if isinstance(value, (bool, float, str)) and type(value) in [kind for kind, _ in expected]:
        if isinstance(value, float) and not math.isfinite(value):
            raise Refused(RefusalCode.BAD_VALUE, f"{key} is {value}, expected a finite number")
        if isinstance(value, str) and len(value) > LONGEST_FACT:
            raise Refused(
                RefusalCode.BAD_VALUE,
                f"{key} has {len(value)} characters, expected {LONGEST_FACT} at most",
            )
        return value
    words = ", ".join(text for _, text in expected)
    raise Refused(RefusalCode.BAD_VALUE, f"{key} is {_shown(value)}, expected {words}")


def has_type(value: Fact, wanted: FieldType) -> bool:
    """Return whether a fact has a type."""
    return type(value) is _TYPES[wanted][0]


def facts(given: Iterable[tuple[str, object]]) -> dict[str, Fact]:
    """Return values from outside as facts by key, without those that are None.

    Raises:
        Refused: ``DUPLICATE_KEY`` or ``TOO_MANY``, else as in :func:`fact`.
    """
    found: dict[str, Fact] = {}
    for key, value in given:
        if value is None:
            continue
        if key in found:
            raise Refused(RefusalCode.DUPLICATE_KEY, f"'{key}' is remembered twice, expected once")
        if len(found) == MOST_FACTS:
            raise Refused(
                RefusalCode.TOO_MANY, f"more than {MOST_FACTS} values are remembered of a person"
            )
        found[key] = fact(key, value)
    return found


def message_fields(key: str, value: Fact) -> dict[str, Plain]:
    """Return the fields of a ``PersonFact`` message."""
    [number] = [n for n, (_, kind) in _VALUE_FIELDS.items() if type(value) is kind]
    return {"key": key, "value": {"type": number, _VALUE_FIELDS[number][0]: value}}


def from_message_fields(fields: Mapping[str, Any]) -> tuple[str, Fact]:
    """Return the key and value that were passed to :func:`message_fields`."""
    name, _ = _VALUE_FIELDS[fields["value"]["type"]]
    return fields["key"], fields["value"][name]


def values_of(messages: Sequence[Any]) -> list[tuple[str, object]]:
    """Return keys and unchecked values of ``PersonFact`` messages; None means forget the key.

    Raises:
        Refused: ``TOO_MANY``, or ``BAD_VALUE`` for a list.
    """
    if len(messages) > MOST_FACTS:
        raise Refused(
            RefusalCode.TOO_MANY, f"{len(messages)} values of a person, expected {MOST_FACTS}"
        )
    return [(one.key, _value_of(one)) for one in messages]


def _value_of(message: Any) -> object:
    if message.value.type == _NOT_SET:
        return None
    if message.value.type not in _VALUE_FIELDS:
        raise Refused(
            RefusalCode.BAD_VALUE,
            f"{message.key[:64]!r} is a list, expected a number, a text or a boolean",
        )
    return getattr(message.value, _VALUE_FIELDS[message.value.type][0])


def _as_float(value: int) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _shown(value: object) -> str:
    if isinstance(value, str):
        return f"'{value[:40]}'"
    if isinstance(value, (bool, float)):
        return "true" if value is True else "false" if value is False else f"{value:g}"
    return f"a {type(value).__name__}"
