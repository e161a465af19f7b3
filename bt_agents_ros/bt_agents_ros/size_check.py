# SPDX-License-Identifier: Apache-2.0
"""Check of messages and requests against the table of limits, and the log lines for it."""

from __future__ import annotations

from collections.abc import Callable, Sized
from dataclasses import dataclass, field
from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

from rosidl_parser import definition as idl

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros import limits
from bt_agents_ros.types import resolved, slots_of

_OWN_PACKAGE = "bt_agents_interfaces."

LOG_PERIOD_S = 5.0
"""Time between log lines about the same topic or service and the same code [s]."""


def largest_bytes(kind: Any) -> int:
    """Return the maximum number of bytes of a serialized message of a type."""
    if not is_own(kind) and not kind.__name__.endswith("_Request"):
        return limits.FOREIGN_BYTES
    return limits.BYTES_OF.get(kind.__name__, limits.MESSAGE_BYTES)


def is_own(kind: Any) -> bool:
    """Return whether a type is one of ``bt_agents_interfaces``."""
    return str(kind.__module__).startswith(_OWN_PACKAGE)


def check_bytes(kind: Any, size: int) -> None:
    """Check the size of a serialized message before it is deserialized.

    Raises:
        Refused: ``TOO_LARGE``.
    """
    largest = largest_bytes(kind)
    if size > largest:
        raise Refused(
            RefusalCode.TOO_LARGE, f"{kind.__name__} has {size} bytes, expected at most {largest}"
        )


def may_exceed(kind: Any, size: int) -> bool:
    """Return whether a message of this size can contain a text or list that is too large."""
    return size > _smallest(kind)


def most_entries(kind: Any, field: str, entry: Any) -> int | None:
    """Return the maximum length of a list of a rosidl type; None for any length."""
    usual: int | None = limits.LIST_ENTRIES
    if not is_own(kind):
        # Numbers become one array, everything else one object per entry.
        usual = None if isinstance(entry, idl.BasicType) else limits.FOREIGN_ENTRIES
    return limits.ENTRIES_OF.get(f"{kind.__name__}.{field}", usual)


def check_entries(kind: Any, field: str, count: int, most: int | None) -> None:
    """Check the number of entries of a list.

    Raises:
        Refused: ``TOO_LARGE``.
    """
    if most is not None and count > most:
        raise _too_large(kind, field, count, "entries", most)


def check_fields(message: Any, size: int) -> None:
    """Check the texts and lists of a message, unless it belongs to another package.

    A message whose serialized size [bytes] is too small to exceed any limit is skipped.

    Raises:
        Refused: ``TOO_LARGE``, with the first field that is too large.
    """
    kind: Any = type(message)
    if is_own(kind) and may_exceed(kind, size):
        _content(message, kind)


def check_content(message: Any) -> int:
    """Check the texts and lists of a message of unknown size, one by one and all together.

    Returns:
        The number of its characters and entries; 0 for a message of another package, which is
        skipped.

    Raises:
        Refused: ``TOO_LARGE``.
    """
    kind: Any = type(message)
    if not is_own(kind):
        return 0
    content, largest = _content(message, kind), largest_bytes(kind)
    if content > largest:
        raise Refused(
            RefusalCode.TOO_LARGE,
            f"{kind.__name__} has {content} characters and entries, expected at most {largest}",
        )
    return content


class RefusalLog:
    """Log lines about refusals.

    A source gets at most one line per :data:`LOG_PERIOD_S` and code, so that one flood does not
    hide another fault of the same source.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._refused: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
        self._next_s: WeakKeyDictionary[Any, dict[str, float]] = WeakKeyDictionary()

    def line(self, source: Any, name: str, refused: Refused) -> str | None:
        """Count a refusal of a subscription or a service; return its line if one is due."""
        count = self._refused[source] = self._refused.get(source, 0) + 1
        now, next_s = self._clock(), self._next_s.setdefault(source, {})
        if now < next_s.get(refused.code, now):
            return None
        next_s[refused.code] = now + LOG_PERIOD_S
        return f"{refused.code}: {name}: {refused.reason}; {count} refused since the start"


@dataclass(frozen=True, kw_only=True)
class _Checks:
    """Checks of a type, by field; lists first, because the others go through their entries.

    Attributes:
        lists: Most entries; None for any number.
        texts: Most characters.
        text_lists: Most characters of each text.
        nested: Type of the message, if it has texts or lists.
        nested_lists: The same of the messages in a list.
    """

    lists: dict[str, int | None] = field(default_factory=dict)
    texts: dict[str, int] = field(default_factory=dict)
    text_lists: dict[str, int] = field(default_factory=dict)
    nested: dict[str, Any] = field(default_factory=dict)
    nested_lists: dict[str, Any] = field(default_factory=dict)


def _content(message: Any, kind: Any) -> int:
    """Check all fields of a message; return the number of their characters and entries."""
    checks = _checks_of(kind)
    content = 0
    for name, most in checks.lists.items():
        value: Sized = getattr(message, name)
        content += len(value)
        check_entries(kind, name, len(value), most)
    for name, characters in checks.texts.items():
        value = getattr(message, name)
        content += len(value)
        if len(value) > characters:
            raise _too_large(kind, name, len(value), "characters", characters)
    for name, characters in checks.text_lists.items():
        lengths = [len(entry) for entry in getattr(message, name)]
        content += sum(lengths)
        longest = max(lengths, default=0)
        if longest > characters:
            raise _too_large(kind, name, longest, "characters in a text", characters)
    for name, part in checks.nested.items():
        content += _content(getattr(message, name), part)
    for name, part in checks.nested_lists.items():
        content += sum(_content(entry, part) for entry in getattr(message, name))
    return content


def _too_large(kind: Any, field: str, found: int, what: str, expected: int) -> Refused:
    return Refused(
        RefusalCode.TOO_LARGE,
        f"{kind.__name__}.{field} has {found} {what}, expected at most {expected}",
    )


@cache
def _checks_of(kind: Any) -> _Checks:
    checks = _Checks()
    for name, slot in slots_of(kind).items():
        is_list = isinstance(slot, idl.AbstractNestedType)
        if isinstance(slot, idl.AbstractSequence):
            checks.lists[name] = most_entries(kind, name, slot.value_type)
        entry = slot.value_type if is_list else slot
        if isinstance(entry, idl.AbstractGenericString):
            usual = limits.TEXT_CHARACTERS
            most = limits.CHARACTERS_OF.get(f"{kind.__name__}.{name}", usual)
            (checks.text_lists if is_list else checks.texts)[name] = most
        elif isinstance(entry, idl.NamespacedType):
            part = resolved(entry)
            if any(vars(_checks_of(part)).values()):
                (checks.nested_lists if is_list else checks.nested)[name] = part
    return checks


@cache
def _smallest(kind: Any) -> int:
    """Return the smallest limit in a type; a message with fewer bytes keeps all limits."""
    checks = _checks_of(kind)
    own = [
        *(most for most in checks.lists.values() if most is not None),
        *checks.texts.values(),
        *checks.text_lists.values(),
    ]
    inner = [_smallest(part) for part in (*checks.nested.values(), *checks.nested_lists.values())]
    return min([*own, *inner], default=limits.MESSAGE_BYTES)
