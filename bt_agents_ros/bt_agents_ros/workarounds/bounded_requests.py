# SPDX-License-Identifier: Apache-2.0
"""Service requests that are measured before rclpy makes Python objects of them.

rclpy converts a whole request before any callback sees it: 14 µs for each parameter, in which
nothing else of the process goes on. Here the size is read from the message as it has arrived.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from rclpy.type_support import check_for_type_support

Measure = Callable[[int], int]
"""Returns how many entries the C message at an address has."""


class TooLarge:
    """Stands for a request that was not converted.

    Attributes:
        entries: How many it has.
    """

    def __init__(self, entries: int) -> None:
        self.entries = entries


class _Sequence(ctypes.Structure):
    """A sequence or a text, as ``rosidl_runtime_c`` lays it out."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("size", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
    )


_ARRAYS = tuple(f"{kind}_array" for kind in ("byte", "bool", "integer", "double", "string"))


class _Value(ctypes.Structure):
    """An ``rcl_interfaces/msg/ParameterValue``."""

    _fields_ = (
        ("type", ctypes.c_uint8),
        ("bool", ctypes.c_bool),
        ("integer", ctypes.c_int64),
        ("double", ctypes.c_double),
        ("string", _Sequence),
        *((name, _Sequence) for name in _ARRAYS),
    )


class _Parameter(ctypes.Structure):
    """An ``rcl_interfaces/msg/Parameter``."""

    _fields_ = (("name", _Sequence), ("value", _Value))


def count_texts(address: int) -> int:
    """Return how many texts a request has that begins with a list of them."""
    return int(_Sequence.from_address(address).size)


def count_parameters(address: int) -> int:
    """Return how many parameters, and entries of their arrays, a request has that begins so."""
    sequence = _Sequence.from_address(address)
    if not sequence.data:
        return 0
    # Arrays are looked into up to a thousand parameters; more are too many anyway.
    looked_at = (_Parameter * min(sequence.size, 1000)).from_address(sequence.data)
    entries: int = sequence.size + sum(
        getattr(parameter.value, name).size for parameter in looked_at for name in _ARRAYS
    )
    return entries


def bounded(service: Any, measure: Measure, most: int) -> Any:
    """Return the type of a service whose larger requests arrive as :class:`TooLarge`.

    Args:
        service: Type of the service.
        measure: Counts the entries of a request.
        most: Entries up to which a request is converted.
    """
    check_for_type_support(service)
    kind = type(service.Request)
    function = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
    convert = function(_address(kind._CONVERT_TO_PY))

    def convert_bounded(address: int) -> Any:
        entries = measure(address)
        return convert(address) if entries <= most else TooLarge(entries)

    bounded_function = function(convert_bounded)

    class BoundedKind(kind):  # type: ignore[misc, valid-type]
        """What rclpy asks for the functions that handle a message."""

        _CONVERT_TO_PY = _capsule(bounded_function)
        _function = bounded_function  # lives as long as the type

    request = BoundedKind("Request", (service.Request,), {"__slots__": ()})
    return type(service)(service.__name__, (service,), {"Request": request})


def _address(capsule: Any) -> int:
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    return int(pointer(capsule, None))


def _capsule(function: Any) -> Any:
    new = ctypes.pythonapi.PyCapsule_New
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    return new(ctypes.cast(function, ctypes.c_void_p), None, None)
