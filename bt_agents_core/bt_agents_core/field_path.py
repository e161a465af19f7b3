# SPDX-License-Identifier: Apache-2.0
"""Dotted paths into nested data, such as ``faces.0.mood``: field names and item indices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bt_agents_core.errors import BtAgentsError

Member = Callable[[Any, str], Any]
"""Function that returns a field of a value.

It raises ``KeyError`` if the value has fields but not this one, ``TypeError`` if it has none."""


class NoSuchField(BtAgentsError):
    """A path to a field that does not exist.

    Attributes:
        part: The first part that does not exist.
        found: The parts before it, joined by dots.
        value: The value at ``found``.
    """

    def __init__(self, part: str, found: str, value: Any) -> None:
        super().__init__(f"no field '{part}'")
        self.part = part
        self.found = found
        self.value = value


class NoSuchItem(NoSuchField):
    """A path into a list that is too short."""


def value_at(data: Any, path: str, member: Member) -> Any:
    """Return the value at a path of field names and item indices, which count from 0.

    ``member`` reads a field; :func:`item_of` does so in plain data.

    Raises:
        NoSuchField: The path leads nowhere; :class:`NoSuchItem` if a list is too short.
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
    """Return whether a part of a path can be an item index."""
    return part.isascii() and part.isdigit()


def is_list(value: Any) -> bool:
    """Return whether a value is a list, an ``array.array`` or a numpy array."""
    return hasattr(value, "__getitem__") and not isinstance(value, str | bytes | Mapping)
