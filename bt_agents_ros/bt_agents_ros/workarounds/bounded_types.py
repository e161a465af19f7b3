# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for types, which refuse messages that are too large before they become objects.

rclpy 7.1.6 takes requests, goals and answers only as Python objects, and makes them from the C
structure that the middleware has filled: a request with 400,000 nested values takes 1.5 s. A
stand-in first checks the size and the lists of this structure. Remove this module when rclpy takes
requests and answers as bytes, or has a hook before it makes objects.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

from rclpy.logging import get_logger
from rclpy.type_support import check_for_type_support
from rosidl_parser import definition as idl

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros.size_check import (
    check_bytes,
    check_content,
    check_entries,
    check_fields,
    may_exceed,
    most_entries,
)
from bt_agents_ros.types import resolved, slots_of

Size: TypeAlias = Callable[[int], int]
"""Function that returns the serialized size of the C structure at an address [bytes]."""

CONVERT = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
"""Function that makes an object from the message at an address."""

_HEADER = 4
"""Bytes before the first field of a serialized message."""

_POINTER = ctypes.sizeof(ctypes.c_void_p)
_LIST = 3 * _POINTER
"""Size of a text or a list in a C structure: its pointer, size and capacity."""

_SIZES = {
    "boolean": 1,
    "octet": 1,
    "char": 1,
    "int8": 1,
    "uint8": 1,
    "int16": 2,
    "uint16": 2,
    "wchar": 2,
    "int32": 4,
    "uint32": 4,
    "float": 4,
    "int64": 8,
    "uint64": 8,
    "double": 8,
    "long double": 16,
}
"""Size of a number in a C structure, which is also its alignment."""

_CAPSULE = ctypes.pythonapi.PyCapsule_New
_CAPSULE.restype = ctypes.py_object
_CAPSULE.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
_POINTER_OF = ctypes.pythonapi.PyCapsule_GetPointer
_POINTER_OF.restype = ctypes.c_void_p
_POINTER_OF.argtypes = (ctypes.py_object, ctypes.c_char_p)


@cache
def bounded(kind: Any) -> Any:
    """Return the stand-in for a type of messages, requests or responses.

    rclpy accepts it in place of the type, and returns a message of the type, or the
    :class:`Refused` of a refusal. Calling the stand-in makes a message of the type.
    """
    return bounded_by(kind, serialized_size(kind))


def bounded_by(kind: Any, size: Size | None) -> Any:
    """Return a stand-in like :func:`bounded`, with a function for the size of messages.

    Without one, the content of a message is counted after it has become an object.
    """
    check_for_type_support(kind)
    made = type(kind)
    original = converter_of(kind)

    def checked(address: int) -> Any:
        # An exception does not pass through C.
        try:
            if size is None:
                message = original(address)
                check_content(message)
                return message
            found = size(address) + _HEADER
            check_bytes(kind, found)
            if may_exceed(kind, found):
                check_lists(kind, address)
            message = original(address)
            check_fields(message, found)
            return message
        except Refused as refused:
            return refused
        except BaseException as error:
            return Refused(RefusalCode.MALFORMED, f"{kind.__name__} cannot be read: {error!r}")

    convert = CONVERT(checked)
    stand_in = type(
        kind.__name__,
        (),
        {
            "_CREATE_ROS_MESSAGE": made._CREATE_ROS_MESSAGE,
            "_DESTROY_ROS_MESSAGE": made._DESTROY_ROS_MESSAGE,
            "_TYPE_SUPPORT": made._TYPE_SUPPORT,
            "_CONVERT_TO_PY": capsule(convert),
            "_converter": convert,  # the capsule does not own it
            "__call__": lambda _self, **fields: kind(**fields),
        },
    )
    return stand_in()


@cache
def converter_of(kind: Any) -> Callable[[int], Any]:
    """Return the function that makes an object from a message of a type at an address."""
    return CONVERT(pointer_of(type(kind)._CONVERT_TO_PY))


def capsule(function: Any) -> Any:
    """Return a C function as the capsule that rclpy takes; the caller keeps the function alive."""
    return _CAPSULE(ctypes.cast(function, ctypes.c_void_p), None, None)


def pointer_of(taken: Any) -> int:
    """Return the address of the C function in a capsule that rclpy has for a type."""
    return int(_POINTER_OF(taken, None))


@cache
def serialized_size(kind: Any) -> Size | None:
    """Return Fast DDS' function for the size of messages of a type; None if there is none."""
    package, *folders = kind.__module__.split(".")
    library = f"lib{package}__rosidl_typesupport_fastrtps_c.so"
    name = f"get_serialized_size_{package}__{folders[0]}__{kind.__name__}"
    try:
        function = getattr(ctypes.CDLL(library), name)
    except (OSError, AttributeError) as error:
        get_logger("bt_agents").warning(
            f"NOT_MEASURED: {package}: requests and answers are measured only after they are "
            f"objects, so a large one takes long ({error})"
        )
        return None
    function.restype = ctypes.c_size_t
    function.argtypes = (ctypes.c_void_p, ctypes.c_size_t)
    return lambda address: int(function(address, 0))


@dataclass(frozen=True)
class ListField:
    """List in the C structure of a message, or message in a field that is not a list.

    Attributes:
        field: Its name.
        offset: Its offset in the structure.
        most: Maximum number of entries; None for any number.
        count: Number of entries if it is fixed; None for a list.
        entry: Type of its entries if they are messages.
        has_lists: Whether its entries contain lists.
        step: Size of an entry.
    """

    field: str
    offset: int
    most: int | None
    count: int | None
    entry: Any
    has_lists: bool
    step: int

    def entries(self, address: int) -> tuple[int, int]:
        """Return the number of entries in a message at an address, and the first one's address."""
        start = address + self.offset
        if self.count is not None:
            return self.count, start
        return count_at(start).value, ctypes.c_size_t.from_address(start).value


@dataclass(frozen=True)
class _Layout:
    """C structure of a message: its size, its alignment, and its parts with lists."""

    size: int
    alignment: int
    lists: tuple[ListField, ...]


def count_at(address: int) -> ctypes.c_size_t:
    """Return the number of entries of the list at an address, as a C variable that can be set."""
    return ctypes.c_size_t.from_address(address + _POINTER)


def check_lists(kind: Any, address: int, *, deep: bool = True) -> None:
    """Check the number of entries of the lists of a message before it becomes an object.

    Args:
        kind: Type of the message.
        address: Its address.
        deep: Whether to check the lists of messages in its lists, too.

    Raises:
        Refused: ``TOO_LARGE``.
    """
    for one in lists_of(kind):
        count, start = one.entries(address)
        if one.count is None:
            check_entries(kind, one.field, count, one.most)
        if one.has_lists and (deep or one.count is not None):
            for index in range(count):
                check_lists(one.entry, start + index * one.step, deep=deep)


def lists_of(kind: Any) -> tuple[ListField, ...]:
    """Return the lists of a message type, and its fields with messages that have lists."""
    return _layout_of(kind).lists


@cache
def _layout_of(kind: Any) -> _Layout:
    at, alignment = 0, 1
    lists: list[ListField] = []
    for field, slot in slots_of(kind).items():
        is_list = isinstance(slot, idl.AbstractSequence)
        value = slot.value_type if isinstance(slot, idl.AbstractNestedType) else slot
        entry = resolved(value) if isinstance(value, idl.NamespacedType) else None
        inner = _layout_of(entry) if entry is not None else None
        if inner is not None:
            step, aligned = inner.size, inner.alignment
        elif isinstance(value, idl.AbstractGenericString):
            step, aligned = _LIST, _POINTER
        else:
            step = aligned = _SIZES[value.typename]
        count = slot.size if isinstance(slot, idl.Array) else 1
        size = step * count
        if is_list:
            size, aligned = _LIST, _POINTER
        at = _aligned(at, aligned)
        has_lists = inner is not None and bool(inner.lists)
        if is_list or has_lists:
            lists.append(
                ListField(
                    field=field,
                    offset=at,
                    most=most_entries(kind, field, value) if is_list else None,
                    count=None if is_list else count,
                    entry=entry,
                    has_lists=has_lists,
                    step=step,
                )
            )
        at, alignment = at + size, max(alignment, aligned)
    # C has no structure without members.
    return _Layout(_aligned(max(at, 1), alignment), alignment, tuple(lists))


def _aligned(at: int, alignment: int) -> int:
    return -(-at // alignment) * alignment
