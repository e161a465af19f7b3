# SPDX-License-Identifier: Apache-2.0
"""What stands in the values of a node of a checked tree: the names that it reads, its texts."""

from __future__ import annotations

from collections.abc import Iterator

from bt_agents.language.expression.expressions import Expression
from bt_agents.language.nodes import KINDS
from bt_agents.language.specs import (
    Computed,
    ListValue,
    Literal,
    MapValue,
    NodeSpec,
    Reference,
    Text,
    Value,
)


def names_read(spec: NodeSpec) -> Iterator[str]:
    """Yield the names that a node reads itself, those of its children not."""
    for value in spec.fields.values():
        yield from _of_value(value)
    # The interface of a raw leaf stands in the tree; that of a skill names the skill's inputs.
    if spec.kind in KINDS and spec.skill is not None and spec.skill.binding is not None:
        yield from _of_value(spec.skill.binding.fields)
        if spec.skill.binding.succeed_when is not None:
            yield from spec.skill.binding.succeed_when.names


def _of_value(value: Value | Expression) -> Iterator[str]:
    match value:
        case Expression():
            yield from value.names
        case Reference():
            yield value.name
        case Computed():
            yield from value.expression.names
        case Text():
            for part in value.parts:
                if not isinstance(part, str):
                    yield from _of_value(part)
        case ListValue():
            for item in value.items:
                yield from _of_value(item)
        case MapValue():
            for item in value.items.values():
                yield from _of_value(item)


def texts_of(spec: NodeSpec) -> Iterator[str]:
    """Yield the plain texts in the values of a node, those of its children not."""
    open_values = [value for value in spec.fields.values() if not isinstance(value, Expression)]
    while open_values:
        match open_values.pop():
            case Literal(value=str() as text):
                yield text
            case Text(parts=parts):
                yield from (part for part in parts if isinstance(part, str))
            case ListValue(items=items):
                open_values += items
            case MapValue(items=fields):
                open_values += fields.values()
