# SPDX-License-Identifier: Apache-2.0
"""Conversion of large messages to objects in slices, so that the node can work in between.

rclpy 7.1.6 makes all objects of a message in one call: a card of 10,000 agents blocks the node for
half a second. This module makes the entries of its lists one after the other from the C structure
that rclpy has filled. Remove it with :mod:`bt_agents_ros.workarounds.bounded_types`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

from rclpy.serialization import deserialize_message
from rclpy.type_support import check_for_type_support
from rosidl_parser import definition as idl

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros.size_check import check_fields
from bt_agents_ros.types import slots_of
from bt_agents_ros.workarounds.bounded_types import (
    CONVERT,
    ListField,
    capsule,
    check_lists,
    converter_of,
    count_at,
    lists_of,
    pointer_of,
)

LARGE_BYTES = 32 * 1024
"""Larger messages are converted in slices [bytes]; a slice covers about as many bytes."""

SLICE_S = 0.01
"""Time for one slice of a conversion [s]."""

_FEW_ENTRIES = 200
"""A message in a list is made at once if its own lists have no more messages than this."""

_CREATE = ctypes.CFUNCTYPE(ctypes.c_void_p)
_DESTROY = ctypes.CFUNCTYPE(None, ctypes.c_void_p)

Slices: TypeAlias = Generator[None, None, Any]
"""Generator that yields after each slice and returns the message."""


def is_sliced(kind: Any, size: int) -> bool:
    """Return whether a message of a type and a size is converted in slices."""
    return size > LARGE_BYTES and bool(_parts_of(kind))


def slices(kind: Any, message: bytes, clock: Callable[[], float]) -> Slices:
    """Convert a serialized message, and check its lists and texts.

    Args:
        kind: Type of the message.
        message: Its bytes.
        clock: Returns a steady time [s].

    Raises:
        Refused: ``TOO_LARGE``, or ``MALFORMED`` if the bytes do not fit the type.
    """
    check_for_type_support(kind)
    converter = _Converter(len(message), clock)
    with _Structure(kind, message) as address:
        yield from converter.pause()
        return (yield from converter.message(kind, address))


class _Structure:
    """Context manager of the C structure of a serialized message."""

    def __init__(self, kind: Any, message: bytes) -> None:
        self._kind = kind
        self._message = message
        self._address = 0

    def __enter__(self) -> int:
        made = type(self._kind)
        create = _CREATE(pointer_of(made._CREATE_ROS_MESSAGE))

        def created() -> int:
            self._address = create()
            return self._address

        functions = {
            "_CREATE_ROS_MESSAGE": _CREATE(created),
            "_DESTROY_ROS_MESSAGE": _DESTROY(lambda _address: None),
            "_CONVERT_TO_PY": CONVERT(lambda _address: None),
        }
        capsules = {name: capsule(function) for name, function in functions.items()}
        stand_in = type(self._kind.__name__, (), {**capsules, "_TYPE_SUPPORT": made._TYPE_SUPPORT})
        try:
            deserialize_message(self._message, stand_in())
        except Exception as error:
            # rclpy's exceptions for bad bytes have no common base class.
            self._destroy()
            raise Refused(
                RefusalCode.MALFORMED,
                f"{len(self._message)} bytes are not a {self._kind.__name__}: {error}",
            ) from None
        return self._address

    def __exit__(self, *_error: object) -> None:
        self._destroy()

    def _destroy(self) -> None:
        address, self._address = self._address, 0
        if address:
            _DESTROY(pointer_of(type(self._kind)._DESTROY_ROS_MESSAGE))(address)


class _Converter:
    """Conversion of one message, with the end of the current slice."""

    def __init__(self, size: int, clock: Callable[[], float]) -> None:
        self._size = size
        self._clock = clock
        self._until = clock() + SLICE_S

    def pause(self) -> Generator[None, None, None]:
        """Yield if the slice is over."""
        if self._clock() >= self._until:
            yield
            self._until = self._clock() + SLICE_S

    def message(self, kind: Any, address: int) -> Slices:
        """Make a message, first without its lists of messages, then with these."""
        check_lists(kind, address, deep=False)
        parts = [(part, *part.of.entries(address + part.offset)) for part in _parts_of(kind)]
        made = self._made(kind, address, parts)
        for part, count, start in parts:
            entries = []
            kind_of_entry, step = part.of.entry, part.of.step
            inner = _parts_of(kind_of_entry)
            for at in range(start, start + count * step, step):
                if inner and _entries(inner, at) > _FEW_ENTRIES:
                    entry = yield from self.message(kind_of_entry, at)
                else:
                    check_lists(kind_of_entry, at)
                    entry = self._made(kind_of_entry, at, [])
                entries.append(entry)
                if self._clock() >= self._until:
                    yield from self.pause()
            owner = made
            for name in part.path:
                owner = getattr(owner, name)
            setattr(owner, part.of.field, entries)
        return made

    def _made(self, kind: Any, address: int, without: list[tuple[_Part, int, int]]) -> Any:
        for part, _, _ in without:
            count_at(address + part.offset + part.of.offset).value = 0
        try:
            made = converter_of(kind)(address)
        except Exception as error:
            raise Refused(
                RefusalCode.MALFORMED, f"{kind.__name__} cannot be read: {error!r}"
            ) from None
        finally:
            for part, count, _ in without:
                count_at(address + part.offset + part.of.offset).value = count
        check_fields(made, self._size)
        return made


@dataclass(frozen=True)
class _Part:
    """List of messages in a message.

    Attributes:
        path: Fields from the message to the one that has the list; empty if it is the same.
        offset: Offset of that message in the C structure.
        of: The list.
    """

    path: tuple[str, ...]
    offset: int
    of: ListField


def _entries(parts: tuple[_Part, ...], address: int) -> int:
    return sum(part.of.entries(address + part.offset)[0] for part in parts)


@cache
def _parts_of(kind: Any) -> tuple[_Part, ...]:
    found: list[_Part] = []
    slots = slots_of(kind)
    for one in lists_of(kind):
        if one.count is None and one.entry is not None:
            found.append(_Part((), 0, one))
        elif isinstance(slots[one.field], idl.NamespacedType):
            found += [
                _Part((one.field, *part.path), one.offset + part.offset, part.of)
                for part in _parts_of(one.entry)
            ]
    return tuple(found)
