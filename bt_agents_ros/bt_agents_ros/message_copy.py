# SPDX-License-Identifier: Apache-2.0
"""Copies of messages as the middleware would make them, but without serialization."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_float
from functools import cache
from operator import itemgetter, methodcaller
from typing import Any

from rosidl_parser import definition as idl

from bt_agents_ros.types import resolved, slots_of


def copied(message: Any) -> Any:
    """Return a copy of a message, request or response."""
    kind: Any = type(message)
    return copier(kind)(message)


@cache
def copier(kind: Any) -> Callable[[Any], Any]:
    """Return the function that copies a message, request or response of a type.

    The copy shares no mutable data; numbers of 32-bit fields are rounded to 32 bits.
    """
    fields = [(f"_{name}", _copier_of_slot(slot)) for name, slot in slots_of(kind).items()]
    immutable = [name for name, made in fields if made is None] + ["_check_fields"]
    others = [(name, made) for name, made in fields if made is not None]

    def copy(message: Any) -> Any:
        # Setters would check every entry again.
        made = kind.__new__(kind)
        for name in immutable:
            setattr(made, name, getattr(message, name))
        for name, copied_value in others:
            setattr(made, name, copied_value(getattr(message, name)))
        return made

    return copy


def _copier_of_slot(slot: Any) -> Callable[[Any], Any] | None:
    """Return the function that copies a field's value; None if the value is immutable."""
    if isinstance(slot, idl.AbstractNestedType):
        if isinstance(slot.value_type, idl.NamespacedType):
            entry = copier(resolved(slot.value_type))
            return lambda values: [entry(value) for value in values]
        return _copier_of_entries(slot)
    if isinstance(slot, idl.NamespacedType):
        return copier(resolved(slot))
    if isinstance(slot, idl.BasicType) and slot.typename == "float":
        return lambda value: c_float(value).value
    return None


def _copier_of_entries(slot: Any) -> Callable[[Any], Any]:
    """Return the function that copies a list without messages, to the type that setters make."""
    entry = slot.value_type
    if not isinstance(entry, idl.BasicType) or entry.typename in ("boolean", "octet"):
        return list
    # A fixed-length list is a numpy array, whose slice would be a view.
    return methodcaller("copy") if isinstance(slot, idl.Array) else itemgetter(slice(None))
