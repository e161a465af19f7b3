# SPDX-License-Identifier: Apache-2.0
"""Ports of BehaviorTree.CPP: conversion between their texts and values of our fields."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_groot.formulas import GROUPS, Untranslatable, script_name
from bt_agents_groot.yaml_nodes import Data, Raw
from bt_agents_language.expression.expression_tokens import ExpressionError, TokenKind, tokenize
from bt_agents_language.expression.quantities import QuantityError, quantity
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.fields.values import ONE_OF
from bt_agents_language.nodes.node_type import FOREVER
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence

JSON = "json:"
"""Prefix of a port whose value is JSON; a convention of BehaviorTree.CPP."""

MAX_JSON_DEPTH = 16
"""Maximum nesting of lists and mappings in one port."""

REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)\}")
"""``${expression}``, or ``$${``, which means ``${`` itself."""

_LONGEST_MS = 999_999_999
_NAME = re.compile(r"[^\W\d]\w*(\.\w+)?")
_NOWHERE = Source("", "")

_CPP_TYPES = {
    FieldType.TEXT: "std::string",
    FieldType.NUMBER: "double",
    FieldType.INTEGER: "int",
    FieldType.BOOLEAN: "bool",
}
_FIELD_TYPES = {
    **{type_name: field_type for field_type, type_name in _CPP_TYPES.items()},
    **{field_type.value: field_type for field_type in FieldType},
    "string": FieldType.TEXT,
    "unsigned int": FieldType.INTEGER,
    "unsigned": FieldType.INTEGER,
    "long": FieldType.INTEGER,
    "float": FieldType.NUMBER,
}


class PortError(BtAgentsError):
    """Raised for a port text without a value."""


def pointed_at(text: str) -> str | None:
    """Return the entry in ``{entry}``; None if the text is not a pointer."""
    text = text.strip(" ")
    return text[1:-1] if len(text) > 2 and text[0] == "{" and text[-1] == "}" else None


def as_port(node: Node, field_type: FieldType) -> str:
    """Return the text of a port for the value of a field; only texts in it are literal."""
    if not isinstance(node, Scalar):
        return _as_json(plain_data(node))
    name = only_name(node.text)
    if name is not None:
        return f"{{{script_name(name)}}}"
    literal = field_type is FieldType.TEXT or node.plain or not _needs_quotes(node.text)
    return node.text if literal and not _is_special(node.text) else _as_json(node.text)


def _is_special(text: str) -> bool:
    """Return whether a port takes a text for something else: JSON or the name of an entry."""
    return text.startswith(JSON) or pointed_at(text) is not None


def variants_port(node: Node) -> str:
    """Return the text of a port for several texts; a skill takes one of them."""
    return _as_json({ONE_OF: plain_data(node)})


def plain_port(value: Plain, field_type: FieldType) -> str:
    """Return the text of a port for a value without names."""
    if isinstance(value, bool | int | float):
        dimension = DIMENSIONS.get(field_type)
        if dimension is None or isinstance(value, bool):
            return json.dumps(value)
        return f"{int(value) if value == int(value) else value} {dimension.si}"
    # An empty default would be none.
    if isinstance(value, str) and value and not _is_special(value):
        return (
            value if field_type is FieldType.TEXT or not _needs_quotes(value) else _as_json(value)
        )
    return _as_json(value)


def plain_data(node: Node) -> Plain:
    """Return the value of a field; texts with names in it stay unchanged."""
    match node:
        case Sequence():
            return tuple(map(plain_data, node.items))
        case Mapping():
            return {entry.key.text: plain_data(entry.value) for entry in node.entries}
        case Scalar():
            return node.text if "${" in node.text else plain_value(node)


def _as_json(value: Plain) -> str:
    return JSON + json.dumps(value, ensure_ascii=False)


def only_name(text: str) -> str | None:
    """Return the name in a text that is only ``${name}``, if a port can hold it."""
    match = REFERENCE.fullmatch(text)
    name = match[1].strip() if match is not None and match[1] is not None else ""
    if not _NAME.fullmatch(name):
        return None
    return name if "." not in name or name.partition(".")[0] in GROUPS else None


def from_port(text: str, field_type: FieldType, rename: Callable[[str], str]) -> Data:
    """Return the value of a field for the text of a port; only texts in it are literal.

    Raises:
        PortError: It starts like JSON but is not JSON.
    """
    entry = pointed_at(text)
    if entry is not None:
        return Raw(f"${{{rename(entry)}}}")
    if text.startswith(JSON):
        return _from_json(text[len(JSON) :])
    if field_type is FieldType.TEXT or not _needs_quotes(text):
        return text
    return Raw(text)


Mention = tuple[str, bool]
"""Name in an expression, and whether it needs a value there: it does not before ``else``."""


def names_in(data: Data) -> Iterator[Mention]:
    """Yield the names in the ``${…}`` of a value."""
    match data:
        case str() | Raw():
            text = data if isinstance(data, str) else data.text
            for match in REFERENCE.finditer(text):
                if match[1] is not None:
                    yield from names_of_expression(match[1])
        case list():
            for item in data:
                yield from names_in(item)
        case dict():
            for value in data.values():
                yield from names_in(value)


def names_of_expression(text: str) -> Iterator[Mention]:
    """Yield the names in an expression of our language; none if it is invalid."""
    try:
        tokens = tokenize(text)
    except ExpressionError:
        return
    for token, following in pairwise(tokens):
        if token.kind is TokenKind.NAME and following.text != "(":
            yield token.text, following.text != "else"


def _needs_quotes(text: str) -> bool:
    """Return whether YAML would read a text without quotes as a number, a time or the like."""
    scalar = Scalar(_NOWHERE, 0, 0, text, "")
    try:
        return isinstance(plain_value(scalar), bool | int | float)
    except QuantityError:
        return False


def _from_json(text: str) -> Data:
    try:
        value = json.loads(text, parse_constant=_refuse_constant)
        return _data(value, 0)
    except (ValueError, RecursionError) as error:
        raise PortError(f"the text after '{JSON}' is not JSON: {str(error)[:80]}") from None


def _refuse_constant(literal: str) -> None:
    raise ValueError(f"{literal} is not a finite number")


def _data(value: object, depth: int) -> Data:
    if depth > MAX_JSON_DEPTH:
        raise ValueError(f"nested more than {MAX_JSON_DEPTH} deep")
    match value:
        case bool() | int() | str():
            return value
        case float() if abs(value) != float("inf"):
            return value
        case list():
            return [_data(item, depth + 1) for item in value]
        case dict():
            return {str(key): _data(item, depth + 1) for key, item in value.items()}
    raise ValueError("null and infinite numbers mean nothing here")


def milliseconds(node: Node) -> str:
    """Return a time as whole milliseconds.

    Raises:
        Untranslatable: It is not a constant time.
    """
    if isinstance(node, Scalar) and "${" not in node.text:
        with suppress(QuantityError):
            amount = quantity(node.text, FieldType.DURATION) * 1000
            whole = round(amount)
            if 0 < whole <= _LONGEST_MS and abs(amount - whole) < 1e-6:
                return str(whole)
    raise Untranslatable("a port takes whole milliseconds")


def number_port(node: Node) -> str:
    """Return a number of attempts for a port.

    Raises:
        Untranslatable: It is not a number or a single name.
    """
    if isinstance(node, Scalar):
        if node.text == FOREVER:
            return "-1"
        name = only_name(node.text)
        if name is not None:
            return f"{{{name.replace('.', '__')}}}"
        if node.text.isdigit():
            return node.text
    raise Untranslatable("a port takes a number or a single name")


def cpp_type(field_type: FieldType) -> str:
    """Return the declared C++ type of a port; empty for any; times have our own type name."""
    return "" if field_type is FieldType.ANY else _CPP_TYPES.get(field_type, field_type.value)


def field_type_of(type_name: str) -> FieldType:
    """Return our type for the declared type of a port; any if we have no equivalent."""
    return _FIELD_TYPES.get(type_name.strip(), FieldType.ANY)
