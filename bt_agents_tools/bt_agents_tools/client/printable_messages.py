# SPDX-License-Identifier: Apache-2.0
"""Received messages whose texts are safe for a terminal."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

from rcl_interfaces.srv import GetParameters
from rosidl_parser.definition import AbstractGenericString, AbstractNestedType, NamespacedType

from bt_agents_core.text import printable, printable_lines
from bt_agents_interfaces.msg import Auction, TunableInfo
from bt_agents_interfaces.srv import ManageProfiles, ReloadAgents

_OF_SEVERAL_LINES = {
    Auction: "explanation",
    ManageProfiles.Response: "document",
    ReloadAgents.Response: "message",
}
"""Type of a message → its field that may have several lines; all other texts have one."""

_EXACT = {TunableInfo: "default_value", GetParameters.Response: "values"}
"""Type of a message → its field that is compared and written to files, and so stays as it is."""

_Convert = Callable[[Any], Any]


def make_printable(message: Any) -> Any:
    """Return a ROS message with :func:`printable` applied to the texts in it, also in lists.

    Values of parameters stay as they are: who shows one makes it printable. It changes the
    message itself, and only texts that are not printable.
    """
    kind: Any = type(message)
    convert = _converter(kind)
    return message if convert is None else convert(message)


@cache
def _converter(kind: type[Any]) -> _Convert | None:
    """Return a function that makes messages of a type printable; None for a type without texts."""
    fields = []
    for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        of_text = printable_lines if _OF_SEVERAL_LINES.get(kind) == name else printable
        convert = _of_slot(slot, of_text)
        if convert is not None and _EXACT.get(kind) != name:
            fields.append((name, convert))
    if not fields:
        return None

    def convert_message(message: Any) -> Any:
        for name, convert in fields:
            found = getattr(message, name)
            converted = convert(found)
            if converted is not found:
                setattr(message, name, converted)
        return message

    return convert_message


def _of_slot(slot: Any, of_text: Callable[[str], str]) -> _Convert | None:
    if isinstance(slot, AbstractGenericString):
        return of_text
    if isinstance(slot, NamespacedType):
        return _converter(getattr(import_module(".".join(slot.namespaces)), slot.name))
    if not isinstance(slot, AbstractNestedType):
        return None
    convert = _of_slot(slot.value_type, of_text)
    if convert is None:
        return None

    def convert_list(found: Any) -> Any:
        converted = list(map(convert, found))
        same = all(one is before for one, before in zip(converted, found, strict=True))
        return found if same else converted

    return convert_list
