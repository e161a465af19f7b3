# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of single values: texts, numbers, quantities, names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from bt_agents_core.field_types import FieldType
from bt_agents_language.expression.units import DIMENSIONS

Schema: TypeAlias = dict[str, object]
"""A JSON Schema, draft 7, with the annotations that yaml-language-server and VS Code know."""

NODE: Schema = {"$ref": "#/definitions/node"}
"""Node, at any place."""

_NUMBER = r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?"
_INTEGER = r"[-+]?[0-9]+"
_WITH_NAME = r"\$\{"
_SCALAR = ["string", "number", "boolean"]
_NAME = "^[a-z][a-z0-9_]*$"
_ROS_NAME = r"^[A-Za-z~/_][A-Za-z0-9_/~]*$"
_ROS_NAME_WITH_PLACEHOLDERS = r"^[A-Za-z~/_<][A-Za-z0-9_/~<>]*$"

TEXT: Schema = {"type": _SCALAR}
"""Text; a number or ``true`` is taken as written."""

CONDITION: Schema = {"type": ["string", "boolean"]}

BOOLEAN: Schema = {
    "type": ["boolean", "string"],
    "pattern": "^(true|True|TRUE|false|False|FALSE)$",
    "patternErrorMessage": "expected true or false",
}

NAME: Schema = {
    "type": "string",
    "pattern": _NAME,
    "patternErrorMessage": "a name has small letters a-z, digits and '_', a letter first",
}
"""Name that a file introduces."""

ROS_TYPE: Schema = {
    "type": "string",
    "pattern": r"^[A-Za-z][A-Za-z0-9_]*/(msg|srv|action)/[A-Za-z][A-Za-z0-9_]*$",
    "patternErrorMessage": "expected package/msg/Name, package/srv/Name or package/action/Name",
}


def described(schema: Schema, text: str) -> Schema:
    """Return a schema with its description for editors."""
    return {"description": text, **schema} if text else schema


def names(values: Schema, pattern: str = _NAME) -> Schema:
    """Return the schema of a mapping from names of the author's choice to values."""
    return {
        "type": "object",
        "propertyNames": {"pattern": pattern},
        "additionalProperties": values,
    }


def mapping(properties: Mapping[str, Schema], required: list[str]) -> Schema:
    """Return the schema of a mapping with these keys and no others."""
    schema: Schema = {
        "type": "object",
        "properties": {key: {"title": key, **one} for key, one in properties.items()},
        "additionalProperties": False,
    }
    return {**schema, "required": required} if required else schema


def number(minimum: float | None = None, maximum: float | None = None) -> Schema:
    """Return the schema of a number in a range, without names."""
    schema = _quantity(f"^\\s*{_NUMBER}\\s*$", "a number")
    return schema | _limits(minimum, maximum)


def integer(minimum: float | None = None, maximum: float | None = None) -> Schema:
    """Return the schema of an integer, without names."""
    schema = _quantity(f"^\\s*{_INTEGER}\\s*$", "a whole number")
    return schema | {"type": ["string", "integer"]} | _limits(minimum, maximum)


def quantity(field_type: FieldType) -> Schema:
    """Return the schema of a non-negative time or length, without names."""
    return _with_unit(field_type) | _limits(0, None)


def ros_name(*, placeholders: bool = False) -> Schema:
    """Return the schema of the name of a topic, service or action."""
    expected = "expected words of letters, digits and '_' joined by '/'"
    more = "; <person> stands for the id of a person"
    return {
        "type": "string",
        "pattern": _ROS_NAME_WITH_PLACEHOLDERS if placeholders else _ROS_NAME,
        "patternErrorMessage": expected + more if placeholders else expected,
    }


def value(
    field_type: FieldType, minimum: float | None = None, words: tuple[str, ...] = ()
) -> Schema:
    """Return the schema of a value that may contain ``${…}``, or of one of some words."""
    match field_type:
        case FieldType.ANY:
            return {"type": [*_SCALAR, "array", "object"]}
        case FieldType.TEXT:
            return TEXT
        case FieldType.BOOLEAN:
            schema = BOOLEAN
        case FieldType.INTEGER:
            schema = integer()
        case FieldType.NUMBER:
            schema = number()
        case _:
            schema = _with_unit(field_type)
    expected = str(schema["patternErrorMessage"])
    also = "".join(f"|^{word}$" for word in words)
    snippets = [{"label": word, "body": word} for word in words]
    return {
        **schema,
        "pattern": f"{schema['pattern']}|{_WITH_NAME}{also}",
        "patternErrorMessage": " or ".join([expected, *words, "${…}"]),
        **({"defaultSnippets": snippets} if snippets else {}),
        **_limits(minimum, None),
    }


def _quantity(pattern: str, expected: str) -> Schema:
    return {
        "type": ["string", "number"],
        "pattern": pattern,
        "patternErrorMessage": f"expected {expected}",
    }


def _with_unit(field_type: FieldType) -> Schema:
    dimension = DIMENSIONS[field_type]
    pattern = f"^\\s*{_NUMBER}\\s*({'|'.join(dimension.units)})?\\s*$"
    return _quantity(pattern, f"{dimension.a} such as {dimension.example}")


def _limits(minimum: float | None, maximum: float | None) -> Schema:
    limits = {"minimum": minimum, "maximum": maximum}
    return {key: limit for key, limit in limits.items() if limit is not None}
