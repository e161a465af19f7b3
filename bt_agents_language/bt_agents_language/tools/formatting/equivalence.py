# SPDX-License-Identifier: Apache-2.0
"""Equivalence of documents apart from their layout."""

from __future__ import annotations

from bt_agents_language.expression.quantities import QuantityError
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence


def same_meaning(one: Node, other: Node) -> bool:
    """Return whether two documents say the same; the keys of a mapping may be in another order."""
    match one, other:
        case Scalar(), Scalar():
            return one.text == other.text and value_type(one) is value_type(other)
        case Sequence(), Sequence():
            return len(one.items) == len(other.items) and all(
                map(same_meaning, one.items, other.items)
            )
        case Mapping(), Mapping():
            values = {entry.key.text: entry.value for entry in other.entries}
            return len(one.entries) == len(values) and all(
                entry.key.text in values and same_meaning(entry.value, values[entry.key.text])
                for entry in one.entries
            )
    return False


def value_type(scalar: Scalar) -> type:
    """Return the type of a value where any type may stand; an error's for an impossible number."""
    try:
        return type(plain_value(scalar))
    except QuantityError:
        return QuantityError
