# SPDX-License-Identifier: Apache-2.0
"""The C++ types that declared ports name, and those of our language."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType, Plain

_WRITTEN = {
    FieldType.TEXT: "std::string",
    FieldType.NUMBER: "double",
    FieldType.INTEGER: "int",
    FieldType.BOOLEAN: "bool",
}
_READ = {
    **{word: field_type for field_type, word in _WRITTEN.items()},
    **{field_type.value: field_type for field_type in FieldType},
    "string": FieldType.TEXT,
    "unsigned int": FieldType.INTEGER,
    "unsigned": FieldType.INTEGER,
    "long": FieldType.INTEGER,
    "float": FieldType.NUMBER,
}
_UNITS = {FieldType.DURATION: "s", FieldType.LENGTH: "m", FieldType.ANGLE: "rad"}


def written_type(field_type: FieldType) -> str:
    """Return what a port declares as its type, empty for any; a time stays our own word."""
    return "" if field_type is FieldType.ANY else _WRITTEN.get(field_type, field_type.value)


def read_type(word: str) -> FieldType:
    """Return the type that a port declares; one that our language does not have is any."""
    return _READ.get(word.strip(), FieldType.ANY)


def quantity(value: Plain, field_type: FieldType) -> str | None:
    """Return a value in SI with its unit, None when its type has none."""
    unit = _UNITS.get(field_type)
    if unit is None or isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return f"{int(value) if value == int(value) else value} {unit}"
