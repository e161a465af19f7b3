# SPDX-License-Identifier: Apache-2.0
"""Values of our fields as ports of BehaviorTree.CPP, which are texts, and back."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from itertools import pairwise

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_groot.formulas import GROUPS, script_name
from bt_agents_groot.port_types import quantity
from bt_agents_groot.written import Data, Raw
from bt_agents_language.expression.expression_tokens import ExpressionError, TokenKind, tokenize
from bt_agents_language.expression.quantities import QuantityError
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence

JSON = "json:"
"""Start of a port whose value is written as JSON; a convention of BehaviorTree.CPP."""

MAX_JSON_DEPTH = 16
"""Nesting of lists and mappings in one port."""

_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)\}")
_NAME = re.compile(r"[^\W\d]\w*(\.\w+)?")
_NOWHERE = Source("", "")


class PortError(BtAgentsError):
    """The text of a port means nothing; the message says why."""


def pointed_at(text: str) -> str | None:
    """Return the name in ``{name}``, None when a text is no such pointer."""
    text = text.strip(" ")
    return text[1:-1] if len(text) > 2 and text[0] == "{" and text[-1] == "}" else None


def as_port(node: Node, field_type: FieldType) -> str:
    """Return the text of a port for what stands in a field of our language.

    Args:
        node: What stands there.
        field_type: Type of the field; only a text is always taken as it is written.
    """
    if not isinstance(node, Scalar):
        return _as_json(_plain(node))
    name = only_name(node.text)
    if name is not None:
        return f"{{{script_name(name)}}}"
    special = node.text.startswith(JSON) or pointed_at(node.text) is not None
    if special or (field_type is not FieldType.TEXT and not node.plain and _means_more(node.text)):
        return _as_json(node.text)
    return node.text


def plain_port(value: Plain, field_type: FieldType) -> str:
    """Return the text of a port for a value without names."""
    with_unit = quantity(value, field_type)
    if with_unit is not None:
        return with_unit
    if isinstance(value, str) and not (field_type is not FieldType.TEXT and _means_more(value)):
        return value
    return json.dumps(value) if isinstance(value, bool | int | float) else _as_json(value)


def _as_json(value: Plain) -> str:
    return JSON + json.dumps(value, ensure_ascii=False)


def only_name(text: str) -> str | None:
    """Return the name in a text that is ``${name}`` and nothing else, if a port can hold it."""
    match = _REFERENCE.fullmatch(text)
    name = match[1].strip() if match is not None and match[1] is not None else ""
    if not _NAME.fullmatch(name):
        return None
    return name if "." not in name or name.partition(".")[0] in GROUPS else None


def from_port(text: str, field_type: FieldType, rename: Callable[[str], str]) -> Data:
    """Return what stands in a field of our language for the text of a port.

    Args:
        text: The text.
        field_type: Type of the field; a text is taken as it is written.
        rename: Returns what a blackboard entry is called in our language.

    Raises:
        PortError: It starts as JSON but is none.
    """
    entry = pointed_at(text)
    if entry is not None:
        return Raw(f"${{{rename(entry)}}}")
    if text.startswith(JSON):
        return _from_json(text[len(JSON) :])
    if field_type is FieldType.TEXT or not _means_more(text):
        return text
    return Raw(text)


def names_in(data: Data) -> Iterator[str]:
    """Return the names that stand in the ``${…}`` of a value."""
    match data:
        case str() | Raw():
            text = data if isinstance(data, str) else data.text
            for match in _REFERENCE.finditer(text):
                if match[1] is not None:
                    yield from names_of_expression(match[1])
        case list():
            for item in data:
                yield from names_in(item)
        case dict():
            for value in data.values():
                yield from names_in(value)


def names_of_expression(text: str) -> Iterator[str]:
    """Return the names in an expression of our language; none when it is no expression."""
    try:
        tokens = tokenize(text)
    except ExpressionError:
        return
    for token, following in pairwise(tokens):
        if token.kind is TokenKind.NAME and following.text != "(":
            yield token.text


def _plain(node: Node) -> Plain:
    match node:
        case Sequence():
            return tuple(map(_plain, node.items))
        case Mapping():
            return {entry.key.text: _plain(entry.value) for entry in node.entries}
        case Scalar():
            return node.text if "${" in node.text else plain_value(node)


def _means_more(text: str) -> bool:
    """Return whether a text without quotes would be taken for a number, a time, or the like."""
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
        raise PortError(f"what stands behind '{JSON}' is not JSON: {str(error)[:80]}") from None


def _refuse_constant(word: str) -> None:
    raise ValueError(f"{word} is no finite number")


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
