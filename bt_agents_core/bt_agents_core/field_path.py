# SPDX-License-Identifier: Apache-2.0
"""Dotted paths into nested data, such as ``faces.0.mood``: field names and numbers of items."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bt_agents_core.errors import BtAgentsError

Member = Callable[[Any, str], Any]
"""Returns a field of a value; raises ``KeyError`` when the value has fields but not this one, and
``TypeError`` when it has none."""


class NoSuchField(BtAgentsError):
    """A path that leads nowhere.

    Attributes:
        part: The first part that is not there.
        found: The parts before it, joined by dots.
        value: What they lead to.
    """

    def __init__(self, part: str, found: str, value: Any) -> None:
        super().__init__(f"no field '{part}'")
        self.part = part
        self.found = found
        self.value = value


class NoSuchItem(NoSuchField):
    """A path into a list that is too short."""


def value_at(data: Any, path: str, member: Member) -> Any:
    """Return what a path leads to: field names and numbers of items, from 0, joined by dots.

    ``member`` takes a field; :func:`item_of` does so in plain data.

    Raises:
        NoSuchField: There is nothing; :class:`NoSuchItem` where a list is too short.
    """
    value = data
    parts = path.split(".")
    for index, part in enumerate(parts):
        try:
            value = member(value, part)
        except KeyError:
            raise NoSuchField(part, ".".join(parts[:index]), value) from None
        except TypeError:
            if not (is_list(value) and is_index(part)):
                raise NoSuchField(part, ".".join(parts[:index]), value) from None
            if int(part) >= len(value):
                raise NoSuchItem(part, ".".join(parts[:index]), value) from None
            value = value[int(part)]
    return value


def item_of(value: Any, part: str) -> Any:
    """Return an entry of a mapping; see :data:`Member`."""
    if not isinstance(value, Mapping):
        raise TypeError(part)
    return value[part]


def is_index(part: str) -> bool:
    """Return whether a part of a path can be the number of an item."""
    return part.isascii() and part.isdigit()


def is_list(value: Any) -> bool:
    """Return whether a value is a list, an ``array.array`` or a numpy array."""
    return hasattr(value, "__getitem__") and not isinstance(value, str | bytes | Mapping)
