# SPDX-License-Identifier: Apache-2.0
"""Texts that would take over a terminal or forge a log, in every field of a message."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rcl_interfaces.srv import GetParameters
from rosidl_parser import definition as idl

from bt_agents_interfaces.msg import TunableInfo
from bt_agents_ros.types import slot_at

HOSTILE = (
    "[/x]\x1b]0;title\x07\x1b[2J\x9b1A\r\x7f\n[FATAL] forged\u2028\t\u202e\u2066\u200b\ufeff\x00"
)
"""Terminal title and screen, line ends, direction marks and invisible characters."""

_NUMBERS = {"boolean": False, "octet": b"\0", "float": 0.0, "double": 0.0}
"""Type of a field → its value; all others are 0."""


_EXACT = {TunableInfo: "default_value", GetParameters.Response: "values"}


def hostile(kind: type[Any]) -> Any:
    """Return a message with :data:`HOSTILE` in every text and two items in every list."""
    message = kind()
    for name in kind.get_fields_and_field_types():
        slot = slot_at(kind, name)
        if isinstance(slot, idl.AbstractSequence):
            value = [_value(slot_at(kind, f"{name}.0")) for _ in range(2)]
        else:
            value = _value(slot)
        if value is not None:
            setattr(message, name, value)
    return message


def texts(value: Any) -> Iterator[str]:
    """Yield every text of a message, including texts in lists, except values of parameters."""
    if isinstance(value, str):
        yield value
    elif hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            if _EXACT.get(type(value)) != name:
                yield from texts(getattr(value, name))
    elif isinstance(value, list):
        for one in value:
            yield from texts(one)


def _value(slot: Any) -> Any:
    """Return a value of a field or an item; None for an array, which stays unchanged."""
    if isinstance(slot, idl.AbstractGenericString):
        return HOSTILE
    if isinstance(slot, idl.BasicType):
        return _NUMBERS.get(slot.typename, 0)
    return None if isinstance(slot, idl.Array) else hostile(slot)
