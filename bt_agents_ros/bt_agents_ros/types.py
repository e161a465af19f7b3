# SPDX-License-Identifier: Apache-2.0
"""ROS types by name, and conversion between messages and plain data."""

from __future__ import annotations

import difflib
import importlib
import math
import os
import re
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import rclpy
from rosidl_parser import definition as idl

from bt_agents_core.errors import Refused
from bt_agents_core.field_path import NoSuchField, NoSuchItem, is_index, is_list, value_at
from bt_agents_core.field_types import INTERFACE_FOLDERS, BindingKind, Plain
from bt_agents_core.refusal_codes import RefusalCode

_TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Z][A-Za-z0-9]*")
_INTERFACE = re.compile(r"(msg|srv|action)/[^/]*")
_INDEX = Path("share/ament_index/resource_index/rosidl_interfaces")
_SHORT_NAME = re.compile(r"([a-z][a-z0-9_]*)/([A-Z][A-Za-z0-9]*)")
_LARGEST_FLOAT32 = 3.4028234663852886e38
_SECONDS = {
    ("builtin_interfaces", "msg", "Time"): (0, 2**31),
    ("builtin_interfaces", "msg", "Duration"): (-(2**31), 2**31),
}
"""Types that can be written as seconds, with the range of seconds that fits: from, below."""


def load_type(name: str, kind: BindingKind | None = None) -> Any:
    """Return the class of a ROS type such as ``std_msgs/msg/Bool``, if given of a certain kind.

    It imports nothing that no installed package lists.

    Raises:
        Refused: ``UNKNOWN_TYPE``, ``WRONG_KIND`` or ``TYPE_NOT_LOADABLE``.
    """
    if not isinstance(name, str) or not _TYPE_NAME.fullmatch(name):
        raise Refused(RefusalCode.UNKNOWN_TYPE, _name_problem(name, kind))
    package, folder, short = name.split("/")
    if kind is not None and folder != INTERFACE_FOLDERS[kind]:
        raise Refused(
            RefusalCode.WRONG_KIND,
            f"'{name}' is not the type of a ROS {kind.value}; expected a name like "
            f"{package}/{INTERFACE_FOLDERS[kind]}/{short}",
        )
    known = types_of(package)
    if not known:
        raise Refused(RefusalCode.UNKNOWN_TYPE, f"no ROS type '{name}': {_package_problem(name)}")
    if f"{folder}/{short}" not in known:
        suggestion = _did_you_mean(name, [f"{package}/{type_name}" for type_name in known])
        raise Refused(
            RefusalCode.UNKNOWN_TYPE, f"no ROS type '{name}' in package {package}{suggestion}"
        )
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), short)
    except (ImportError, AttributeError) as error:
        raise Refused(
            RefusalCode.TYPE_NOT_LOADABLE,
            f"the package {package} lists '{name}' but has no Python code for it ({error}); "
            "build or install it again",
        ) from None


def fill(message: Any, values: Mapping[str, Any]) -> None:
    """Set fields of a message from plain nested data; on an error, set nothing.

    Fields that are not named stay. A float field also takes integers and NaN, and an integer field
    3.0; a boolean is not a number, and a number is not a text. ``builtin_interfaces`` Time and
    Duration may be written as seconds.

    Raises:
        Refused: ``UNKNOWN_FIELD``, ``WRONG_TYPE``, ``WRONG_LENGTH``, ``OUT_OF_RANGE`` or
            ``NOT_FINITE``, with the path of the field.
    """
    for owner, name, value in _assignments(message, values, ""):
        setattr(owner, name, value)


def to_plain(message: Any) -> dict[str, Any]:
    """Return a message as nested mappings, lists and scalars; a byte becomes an integer."""
    return {name: _plain(getattr(message, name)) for name in message.get_fields_and_field_types()}


def read_field(message: Any, path: str) -> Any:
    """Return one field of a message, such as ``faces.0.mood``, as plain data.

    Raises:
        Refused: ``UNKNOWN_FIELD``, or ``NO_SUCH_ITEM`` if a list is too short.
    """
    try:
        return _plain(value_at(message, path, message_field))
    except NoSuchItem as error:
        raise Refused(
            RefusalCode.NO_SUCH_ITEM,
            f"'{error.found}' has {len(error.value)} items, no number {error.part} (from 0)",
        ) from None
    except NoSuchField as error:
        done = error.found.split(".") if error.found else []
        if hasattr(error.value, "get_fields_and_field_types"):
            text = _no_field_text(error.part, done, error.value.get_fields_and_field_types())
        else:
            text = _no_subfield_text(error.part, done, is_list(error.value))
        raise Refused(RefusalCode.UNKNOWN_FIELD, text) from None


def message_field(value: Any, part: str) -> Any:
    """Return a field of a message; see :data:`~bt_agents_core.field_path.Member`."""
    if not hasattr(value, "get_fields_and_field_types"):
        raise TypeError(part)
    if part not in value.get_fields_and_field_types():
        raise KeyError(part)
    return getattr(value, part)


class MessageView(Mapping[str, Plain]):
    """Fields of a message by name, each converted on first read; the message must not change."""

    def __init__(self, message: Any) -> None:
        self._message = message
        self._names = message.get_fields_and_field_types()
        self._converted: dict[str, Plain] = {}

    def __getitem__(self, name: str) -> Plain:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._converted:
            self._converted[name] = read_field(self._message, name)
        return self._converted[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def types_of(package: str) -> Sequence[str]:
    """Return the types of an installed package, such as ``msg/Bool``; empty if it has none.

    The ament index names them in ``share/ament_index/resource_index/rosidl_interfaces/<package>``.
    """
    for prefix in prefixes():
        path = f"{prefix}/{_INDEX}/{package}"
        with suppress(OSError, UnicodeDecodeError):
            return _listed(path, os.stat(path).st_mtime_ns)
    return ()


@lru_cache
def _listed(path: str, _changed_ns: int) -> Sequence[str]:
    """Return the types that a file of the index names; it is read again once it has changed."""
    lines = Path(path).read_text(encoding="utf-8").split()
    return sorted({line.rpartition(".")[0] for line in lines if _INTERFACE.fullmatch(line)})


def prefixes() -> Sequence[Path]:
    """Return the folders where ROS packages are installed, in order of precedence."""
    # PyPI wheels register in the environment's prefix and set no AMENT_PREFIX_PATH.
    return _prefixes(os.environ.get("AMENT_PREFIX_PATH", ""), rclpy.__file__, sys.prefix)


@lru_cache
def _prefixes(sourced: str, rclpy_module: str, environment: str) -> Sequence[Path]:
    own = (Path(rclpy_module).parents[4], Path(environment))
    return (*(Path(part) for part in sourced.split(os.pathsep) if part), *own)


def _packages() -> list[str]:
    found: set[str] = set()
    for prefix in prefixes():
        if (prefix / _INDEX).is_dir():
            found.update(entry.name for entry in (prefix / _INDEX).iterdir())
    return sorted(found)


def _name_problem(name: object, kind: BindingKind | None) -> str:
    folder = INTERFACE_FOLDERS[kind] if kind is not None else "msg"
    short = _SHORT_NAME.fullmatch(name) if isinstance(name, str) else None
    if short:
        return f"no ROS type '{name}': write the full name, {short[1]}/{folder}/{short[2]}"
    return (
        f"{_shown(name)} is not the name of a ROS type; "
        f"expected package/{folder}/Name, for example std_msgs/msg/Bool"
    )


def _package_problem(name: str) -> str:
    package, folder, short = name.split("/")
    for other in difflib.get_close_matches(package, _packages(), n=3, cutoff=0.8):
        # Similar names may be real packages (nav_msgs, nav2_msgs): the type must exist there, too.
        if f"{folder}/{short}" in types_of(other):
            return f"there is no package {package}; did you mean {other}/{folder}/{short}?"
    return (
        f"package {package} is not installed "
        f"(apt install ros-jazzy-{package.replace('_', '-')}, or source its workspace)"
    )


def _did_you_mean(name_given: str, known: Collection[str]) -> str:
    suggestion = difflib.get_close_matches(name_given, list(known), n=1, cutoff=0.6)
    return f"; did you mean {suggestion[0]}?" if suggestion else f"; there are {', '.join(known)}"


def slots_of(message_type: Any) -> dict[str, Any]:
    """Return the rosidl type of each field."""
    return dict(
        zip(message_type.get_fields_and_field_types(), message_type.SLOT_TYPES, strict=True)
    )


def slot_at(message_type: Any, path: str) -> Any:
    """Return the rosidl type of the field at a path, or the class of a nested message.

    Raises:
        Refused: ``UNKNOWN_FIELD``.
    """
    current = message_type
    done: list[str] = []
    for part in path.split("."):
        if hasattr(current, "SLOT_TYPES"):
            slots = slots_of(current)
            if part not in slots:
                raise Refused(RefusalCode.UNKNOWN_FIELD, _no_field_text(part, done, slots))
            current = resolved(slots[part])
        elif isinstance(current, idl.AbstractNestedType) and is_index(part):
            size = getattr(current, "size", getattr(current, "maximum_size", math.inf))
            if int(part) >= size:
                raise Refused(
                    RefusalCode.UNKNOWN_FIELD,
                    f"'{'.'.join(done)}' has at most {size} items, no number {part} (from 0)",
                )
            current = resolved(current.value_type)
        else:
            is_list = isinstance(current, idl.AbstractNestedType)
            raise Refused(RefusalCode.UNKNOWN_FIELD, _no_subfield_text(part, done, is_list))
        done.append(part)
    return current


def resolved(slot: Any) -> Any:
    """Return the class of a nested message type; return any other rosidl type unchanged."""
    if not isinstance(slot, idl.NamespacedType):
        return slot
    # The goal, result and feedback of an action are attributes of its class.
    found: Any = importlib.import_module(".".join(slot.namespaces))
    for name in slot.name.split("_"):
        found = getattr(found, name)
    return found


def _no_field_text(part: str, done: Sequence[str], fields: Collection[str]) -> str:
    where = f" in '{'.'.join(done)}'" if done else ""
    if not fields:
        return f"no field '{part}'{where}; the message has no fields"
    return f"no field '{part}'{where}{_did_you_mean(part, fields)}"


def _no_subfield_text(part: str, done: Sequence[str], is_list: bool) -> str:
    if is_list:
        return f"'{'.'.join(done)}' is a list; pick an item by its number instead of '{part}'"
    return f"no field '{part}': '{'.'.join(done)}' is a single value"


def _plain(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return to_plain(value)
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value


def _assignments(message: Any, values: Any, path: str) -> Iterable[tuple[Any, str, Any]]:
    """Check all values of one message and return the assignments: owner, field, value."""
    values = _as_seconds(type(message), values, path) or values
    if not isinstance(values, Mapping):
        raise _wrong_type(path, "a mapping of fields", values)
    slots = slots_of(type(message))
    found: list[tuple[Any, str, Any]] = []
    for name, value in values.items():
        if name not in slots:
            done = path.split(".") if path else []
            raise Refused(RefusalCode.UNKNOWN_FIELD, _no_field_text(str(name), done, slots))
        here = f"{path}.{name}" if path else name
        if isinstance(slots[name], idl.NamespacedType):
            found.extend(_assignments(getattr(message, name), value, here))
        else:
            found.append((message, name, _converted(slots[name], value, here)))
    return found


def _converted(slot: Any, value: Any, path: str) -> Any:
    if isinstance(slot, idl.NamespacedType):
        message = resolved(slot)()
        for owner, name, part in _assignments(message, value, path):
            setattr(owner, name, part)
        return message
    if isinstance(slot, idl.AbstractNestedType):
        return _list(slot, value, path)
    if isinstance(slot, idl.AbstractGenericString):
        return _text(slot, value, path)
    if slot.typename == idl.BOOLEAN_TYPE:
        if not isinstance(value, bool):
            raise _wrong_type(path, "true or false", value)
        return value
    if slot.typename in idl.FLOATING_POINT_TYPES:
        return _float(slot, value, path)
    return _integer(slot, value, path)


def _list(slot: Any, value: Any, path: str) -> list[Any]:
    if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping):
        raise _wrong_type(path, "a list", value)
    items = list(value)
    if isinstance(slot, idl.Array) and len(items) != slot.size:
        raise Refused(
            RefusalCode.WRONG_LENGTH, f"'{path}' has {len(items)} items, expected {slot.size}"
        )
    if isinstance(slot, idl.BoundedSequence) and len(items) > slot.maximum_size:
        raise Refused(
            RefusalCode.WRONG_LENGTH,
            f"'{path}' has {len(items)} items, expected at most {slot.maximum_size}",
        )
    return [_converted(slot.value_type, item, f"{path}.{i}") for i, item in enumerate(items)]


def _text(slot: Any, value: Any, path: str) -> str:
    if not isinstance(value, str):
        raise _wrong_type(path, "text", value)
    # The C code of a message would cut the text at a zero and fail at half a character.
    if "\0" in value or any("\ud800" <= character <= "\udfff" for character in value):
        raise Refused(
            RefusalCode.WRONG_TYPE,
            f"'{path}' holds a character that ROS cannot send; expected plain text",
        )
    limit = getattr(slot, "maximum_size", math.inf)
    if len(value) > limit:
        raise Refused(
            RefusalCode.WRONG_LENGTH,
            f"'{path}' has {len(value)} characters, expected at most {limit}",
        )
    return value


def _float(slot: Any, value: Any, path: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong_type(path, "a number", value)
    largest = _LARGEST_FLOAT32 if slot.typename == "float" else sys.float_info.max
    endless = isinstance(value, float) and math.isinf(value)
    if abs(value) > largest and not endless:
        raise Refused(
            RefusalCode.OUT_OF_RANGE, f"'{path}' is too large, expected at most {largest:g}"
        )
    return float(value)


def _integer(slot: Any, value: Any, path: str) -> int | bytes:
    # Quotients, times and scene values are floats, and authors cannot see that.
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise _wrong_type(path, "a whole number", value)
    octet = slot.typename == idl.OCTET_TYPE
    low, high = _integer_range("uint8" if octet else slot.typename)
    if not low <= value < high:
        raise Refused(
            RefusalCode.OUT_OF_RANGE, f"'{path}' does not fit, expected {low} to {high - 1}"
        )
    return bytes([value]) if octet else value


def _integer_range(typename: str) -> tuple[int, int]:
    """Return the range of ``int8`` to ``uint64``: the smallest value, and the largest plus one."""
    if typename not in idl.EXPLICIT_INTEGER_TYPES:
        raise Refused(
            RefusalCode.WRONG_TYPE, f"a field of the IDL type {typename} cannot be written"
        )
    bits = int(typename.rpartition("int")[2])
    return (0, 2**bits) if typename.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1))


def _as_seconds(message_type: Any, value: Any, path: str) -> dict[str, int] | None:
    """Return the fields of a Time or Duration that is written as seconds; None for others."""
    module = message_type.__module__.split(".")
    limits = _SECONDS.get((module[0], module[1] if len(module) > 1 else "", message_type.__name__))
    if limits is None or isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if not math.isfinite(value):
        raise Refused(RefusalCode.NOT_FINITE, f"'{path}' is {value}, expected seconds")
    low, high = limits
    if not low <= value < high - 1:
        raise Refused(
            RefusalCode.OUT_OF_RANGE, f"'{path}' is {value:g} s, expected {low} to {high - 2} s"
        )
    whole, nanoseconds = divmod(round(value * 1e9), 1_000_000_000)
    return {"sec": whole, "nanosec": nanoseconds}


def _wrong_type(path: str, expected: str, found: Any) -> Refused:
    where = f"'{path}'" if path else "the message"
    return Refused(RefusalCode.WRONG_TYPE, f"{where} is {_shown(found)}, expected {expected}")


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "empty"
    if isinstance(value, str):
        return f"'{value[:60]}'" if len(value) <= 60 else f"'{value[:60]}…'"
    if isinstance(value, int | float):
        return f"{value:g}" if isinstance(value, float) else str(value)[:60]
    if isinstance(value, Mapping):
        return "a mapping"
    return "a list" if isinstance(value, list | tuple) else f"a {type(value).__name__}"
