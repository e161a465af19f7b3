# SPDX-License-Identifier: Apache-2.0
"""The ROS types installed on this machine, as the tree language queries them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rosidl_parser import definition as idl

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros.types import fill, load_type, slot_at, types_of


class InstalledInterfaces:
    """The installed ROS types; see :class:`bt_agents_language.fields.interfaces.Interfaces`."""

    def has_package(self, package: str) -> bool:
        return bool(types_of(package))

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        return _problem(lambda: load_type(type_name, kind))

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        return _problem(lambda: slot_at(_section(kind, type_name, section), path))

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        try:
            slot = slot_at(_section(kind, type_name, section), path)
        except Refused:
            return FieldType.ANY
        if isinstance(slot, idl.AbstractGenericString):
            return FieldType.TEXT
        if not isinstance(slot, idl.BasicType):
            return FieldType.ANY
        if slot.typename == idl.BOOLEAN_TYPE:
            return FieldType.BOOLEAN
        floating = slot.typename in idl.FLOATING_POINT_TYPES
        return FieldType.NUMBER if floating else FieldType.INTEGER

    def value_problem(
        self, kind: BindingKind, type_name: str, section: str, values: Mapping[str, Plain]
    ) -> str | None:
        return _problem(lambda: fill(_section(kind, type_name, section)(), values))


def _problem(attempt: Callable[[], object]) -> str | None:
    """Return why an attempt is refused; None if it is not."""
    try:
        attempt()
    except Refused as refused:
        return refused.reason
    return None


def _section(kind: BindingKind, type_name: str, section: str) -> Any:
    """Return the class of a section of a type.

    Raises:
        Refused: There is no such type or section.
    """
    found = load_type(type_name, kind)
    if section != "message":
        found = getattr(found, section.capitalize(), None)
    if not hasattr(found, "SLOT_TYPES"):
        raise Refused(RefusalCode.UNKNOWN_FIELD, f"{type_name} has no {section}")
    return found
