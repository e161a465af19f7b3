# SPDX-License-Identifier: Apache-2.0
"""Message copies: equal to the middleware's, and without shared objects."""

from __future__ import annotations

import array
import inspect
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser import definition as idl

from bt_agents_interfaces import action, msg, srv
from bt_agents_ros.message_copy import copied
from bt_agents_ros.types import resolved, slots_of

KINDS = [kind for _, kind in inspect.getmembers(msg, inspect.isclass)]
for _, kind in inspect.getmembers(srv, inspect.isclass):
    KINDS += [kind.Request, kind.Response] if hasattr(kind, "Request") else []
for _, kind in inspect.getmembers(action, inspect.isclass):
    if hasattr(kind, "Impl"):
        KINDS += [kind.Impl.SendGoalService.Request, kind.Impl.FeedbackMessage]
BITS = {"int8": 7, "int16": 15, "int32": 31, "int64": 63}
BITS |= {"octet": 8, "uint8": 8, "uint16": 16, "uint32": 32, "uint64": 64}


def values(slot: Any) -> st.SearchStrategy[Any]:
    """Return values that a field may be set to."""
    if isinstance(slot, idl.Array):
        return st.lists(values(slot.value_type), min_size=slot.size, max_size=slot.size)
    if isinstance(slot, idl.AbstractSequence):
        return st.lists(values(slot.value_type), max_size=2)
    if isinstance(slot, idl.NamespacedType):
        return messages(resolved(slot))
    if isinstance(slot, idl.AbstractGenericString):
        return st.text(st.characters(exclude_categories=["Cs"], min_codepoint=1), max_size=3)
    if slot.typename == "boolean":
        return st.booleans()
    if slot.typename in ("float", "double"):
        return st.floats(-1e30, 1e30)
    if slot.typename == "octet":
        return st.binary(min_size=1, max_size=1)
    return st.integers(0, 2 ** BITS[slot.typename] - 1)


def messages(kind: Any) -> st.SearchStrategy[Any]:
    return st.builds(kind, **{name: values(slot) for name, slot in slots_of(kind).items()})


def shared(one: Any, other: Any) -> list[str]:
    """Return the fields that share one mutable value."""
    found = []
    for name in one.get_fields_and_field_types():
        first, second = getattr(one, name), getattr(other, name)
        if isinstance(first, (list, array.array, np.ndarray)) or hasattr(first, "SLOT_TYPES"):
            found += [name] if first is second or np.shares_memory(first, second) else []
        nested = zip(first, second, strict=True) if isinstance(first, list) else [(first, second)]
        for a, b in nested:
            if hasattr(a, "SLOT_TYPES"):
                found += [name] if a is b else shared(a, b)
    return found


@settings(max_examples=80, deadline=None)
@given(message=st.sampled_from(KINDS).flatmap(messages))
def test_message_copy_equals_received_message_and_shares_nothing(message: Any) -> None:
    made = copied(message)
    assert made == deserialize_message(serialize_message(message), type(message))
    assert not shared(message, made)
