# SPDX-License-Identifier: Apache-2.0
"""Names and plain texts in the values of a checked node."""

from __future__ import annotations

from collections.abc import Iterator

from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import (
    Computed,
    ListValue,
    Literal,
    MapValue,
    NodeSpec,
    Reference,
    Text,
    Value,
)
from bt_agents_language.nodes.catalogue import type_of


def names_read(spec: NodeSpec) -> Iterator[str]:
    """Yield the names that a node reads itself, those of its children not."""
    for value in spec.fields.values():
        if isinstance(value, Reference):
            yield value.name
        elif not isinstance(value, Literal):
            yield from _of_value(value)
    # The interface of a ROS leaf stands in the tree; that of a skill names the skill's inputs.
    binding = spec.skill.binding if spec.skill is not None else None
    if binding is not None and type_of(spec).interface is not None:
        yield from _of_value(binding.fields)
        if binding.succeed_when is not None:
            yield from binding.succeed_when.names


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


def texts_of(spec: NodeSpec) -> list[str]:
    """Return the plain texts in the values of a node, those of its children not."""
    texts: list[str] = []
    open_values: list[Value | Expression] = [*spec.fields.values()]
    while open_values:
        value = open_values.pop()
        if isinstance(value, Literal):
            if isinstance(value.value, str):
                texts.append(value.value)
        elif isinstance(value, Text):
            texts += [part for part in value.parts if isinstance(part, str)]
        elif isinstance(value, ListValue):
            open_values += value.items
        elif isinstance(value, MapValue):
            open_values += value.items.values()
    return texts
