# SPDX-License-Identifier: Apache-2.0
"""Names that a checked node reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bt_agents_language.expression.expressions import Expression
from bt_agents_language.model.specs import (
    Computed,
    ListValue,
    MapValue,
    NodeSpec,
    Reference,
    Text,
    Value,
    Variants,
)
from bt_agents_language.nodes.catalogue import type_of


def names_read(spec: NodeSpec) -> Iterator[str]:
    """Yield the names in the values and conditions of a node, as often as they occur."""
    values: list[Value | Expression] = [*spec.fields.values()]
    # The interface of a ROS leaf is in the tree; a skill's interface names its inputs.
    binding = spec.skill.binding if spec.skill is not None else None
    if binding is not None and type_of(spec).interface is not None:
        values.append(binding.fields)
        if binding.succeed_when is not None:
            values.append(binding.succeed_when)
    for value in parts_of(values):
        match value:
            case Expression(names=names) | Computed(expression=Expression(names=names)):
                yield from names
            case Reference(name=name):
                yield name


def parts_of(values: Iterable[Value | Expression]) -> Iterator[Value | Expression | str]:
    """Yield values and all of their parts; plain parts of texts unchanged."""
    waiting: list[Value | Expression | str] = [*values]
    while waiting:
        value = waiting.pop()
        yield value
        match value:
            case Text(parts=parts):
                waiting += parts
            case Variants(texts=texts):
                waiting += texts
            case ListValue(items=items):
                waiting += items
            case MapValue(items=entries):
                waiting += entries.values()
