# SPDX-License-Identifier: Apache-2.0
"""ROS types read from their definitions, whether or not their packages are installed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_path
from rosidl_adapter.parser import (
    InvalidSpecification,
    MessageSpecification,
    parse_action_file,
    parse_message_file,
    parse_service_file,
)

from bt_agents_core.field_types import BindingKind, FieldType, Plain
from compiled_types import DEFINITIONS

_TYPES = {"string": FieldType.TEXT, "bool": FieldType.BOOLEAN, "float32": FieldType.NUMBER}


class DefinedInterfaces:
    """Knows the fields of types, but not the values that they allow."""

    def has_package(self, package: str) -> bool:
        """Return whether there are definitions of a package."""
        return _folder(package) is not None

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        """Return why a type cannot be used."""
        try:
            _section(type_name, "")
        except (FileNotFoundError, InvalidSpecification) as error:
            return f"no ROS type '{type_name}': {error}"
        return None

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        """Return why a type has no such field."""
        found = _field(_section(type_name, section), path)
        return None if found is not None else f"no field '{path}' in the {section}"

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        """Return the type of a field's value."""
        found = _field(_section(type_name, section), path)
        return _TYPES.get(found or "", FieldType.ANY)

    def value_problem(
        self, kind: BindingKind, type_name: str, section: str, values: Mapping[str, Plain]
    ) -> str | None:
        """Return None: values are not checked."""


def _folder(package: str) -> Path | None:
    if (DEFINITIONS / package).is_dir():
        return DEFINITIONS / package
    try:
        return get_package_share_path(package)
    except PackageNotFoundError:
        return None


@cache
def _section(type_name: str, section: str) -> MessageSpecification | None:
    package, folder, name = type_name.split("/")
    file = (_folder(package) or Path()) / folder / f"{name}.{folder}"
    if folder == "msg":
        return parse_message_file(package, file)
    parsed = (parse_action_file if folder == "action" else parse_service_file)(package, file)
    return getattr(parsed, section, None)


def _field(message: MessageSpecification | None, path: str) -> str | None:
    """Return the type name of a field; None if no field has this path."""
    first, _, rest = path.partition(".")
    for field in message.fields if message is not None else ():
        if field.name == first:
            kind = field.type
            if not rest:
                return str(kind)
            return _field(_section(f"{kind.pkg_name}/msg/{kind.type}", ""), rest)
    return None
