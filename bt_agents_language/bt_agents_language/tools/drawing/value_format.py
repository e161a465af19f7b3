# SPDX-License-Identifier: Apache-2.0
"""Values of a tree as short words for a drawing: ``"Hello."``, ``8 s``, ``${voice_rate}``."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_core.text import excerpt
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.expression.quantities import format_quantity
from bt_agents_language.model.specs import (
    Computed,
    ListValue,
    Literal,
    MapValue,
    Reference,
    Text,
    Tunable,
    Value,
    Variants,
)

LONGEST_TEXT = 60
"""Maximum number of characters of a text or expression; the rest is left out."""


def format_value(
    value: Value | Expression,
    field_type: FieldType = FieldType.ANY,
    longest_text: int = LONGEST_TEXT,
) -> str:
    """Return a value as an author would write it, with longer texts shortened."""

    def inner(one: Value) -> str:
        return format_value(one, longest_text=longest_text)

    match value:
        case Expression():
            return excerpt(value.text, LONGEST_TEXT)
        case Literal():
            known = field_type if field_type is not FieldType.ANY else value.type
            return format_plain(value.value, known, longest_text)
        case Reference():
            return f"${{{value.name}}}"
        case Computed():
            return f"${{{excerpt(value.expression.text, LONGEST_TEXT)}}}"
        case Text():
            parts = (part if isinstance(part, str) else inner(part) for part in value.parts)
            return f'"{excerpt("".join(parts), longest_text)}"'
        case Variants():
            return f"one of {', '.join(map(inner, value.texts))}"
        case ListValue():
            return f"[{', '.join(map(inner, value.items))}]"
        case MapValue():
            return f"{{{_pairs({key: inner(one) for key, one in value.items.items()})}}}"


def format_plain(
    value: Plain, field_type: FieldType = FieldType.ANY, longest_text: int = LONGEST_TEXT
) -> str:
    """Return a value without names as an author would write it."""

    def inner(one: Plain) -> str:
        return format_plain(one, longest_text=longest_text)

    match value:
        case None:
            return "nothing"
        case bool():
            return "true" if value else "false"
        case int() | float():
            return format_quantity(value, field_type)
        case str():
            return f'"{excerpt(value, longest_text)}"'
        case tuple():
            return f"[{', '.join(map(inner, value))}]"
    return f"{{{_pairs({key: inner(one) for key, one in value.items()})}}}"


def format_tunable(tunable: Tunable) -> str:
    """Return a tunable with its range: ``patience 8 s (2 s to 30 s)``."""
    default = format_plain(tunable.default, tunable.type)
    if tunable.minimum is None or tunable.maximum is None:
        return f"{tunable.name} {default}"
    limits = (format_quantity(limit, tunable.type) for limit in (tunable.minimum, tunable.maximum))
    return f"{tunable.name} {default} ({' to '.join(limits)})"


def format_profile(profile: Vector, space: SceneSpace) -> str:
    """Return a profile in words: ``age 4, familiarity 1.5``."""
    values = zip(space.profiles.names, profile, strict=True)
    return ", ".join(f"{name} {value:g}" for name, value in values)


def _pairs(items: Mapping[str, str]) -> str:
    return ", ".join(f"{key}: {value}" for key, value in items.items())
