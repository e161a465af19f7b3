# SPDX-License-Identifier: Apache-2.0
"""Values of a tree as short words for a picture: ``"Hello."``, ``8 s``, ``${voice_rate}``."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents.language.expressions import Expression
from bt_agents.language.quantities import spoken
from bt_agents.language.specs import (
    Computed,
    FieldType,
    ListValue,
    Literal,
    MapValue,
    Plain,
    Reference,
    Text,
    Tunable,
    Value,
)
from bt_agents.scene import SceneSpace, Vector

LONGEST_TEXT = 60
"""Characters of a text; the rest is left out."""


def shown_value(value: Value | Expression, field_type: FieldType = FieldType.ANY) -> str:
    """Return a value as an author would write it, long texts shortened."""
    match value:
        case Expression():
            return shortened(value.text)
        case Literal():
            known = field_type if field_type is not FieldType.ANY else value.type
            return shown_plain(value.value, known)
        case Reference():
            return f"${{{value.name}}}"
        case Computed():
            return f"${{{shortened(value.expression.text)}}}"
        case Text():
            parts = (part if isinstance(part, str) else shown_value(part) for part in value.parts)
            return f'"{shortened("".join(parts))}"'
        case ListValue():
            return f"[{', '.join(map(shown_value, value.items))}]"
        case MapValue():
            return f"{{{_pairs({k: shown_value(v) for k, v in value.items.items()})}}}"


def shown_plain(value: Plain, field_type: FieldType = FieldType.ANY) -> str:
    """Return a value without names as an author would write it."""
    match value:
        case None:
            return "nothing"
        case bool():
            return "true" if value else "false"
        case int() | float():
            return spoken(value, field_type)
        case str():
            return f'"{shortened(value)}"'
        case tuple():
            return f"[{', '.join(map(shown_plain, value))}]"
    return f"{{{_pairs({key: shown_plain(one) for key, one in value.items()})}}}"


def shown_tunable(tunable: Tunable) -> str:
    """Return a tunable with its range: ``patience 8 s (2 s to 30 s)``."""
    default = shown_plain(tunable.default, tunable.type)
    if tunable.minimum is None or tunable.maximum is None:
        return f"{tunable.name} {default}"
    limits = (spoken(limit, tunable.type) for limit in (tunable.minimum, tunable.maximum))
    return f"{tunable.name} {default} ({' to '.join(limits)})"


def shown_profile(profile: Vector, space: SceneSpace) -> str:
    """Return a profile in words: ``age 4, familiarity 1.5``."""
    values = zip(space.names, profile, strict=True)
    return ", ".join(f"{name} {value:g}" for name, value in values)


def shortened(text: str) -> str:
    """Return a text in one line, its end left out when it is long."""
    flat = " ".join(text.split())
    return flat if len(flat) <= LONGEST_TEXT else f"{flat[: LONGEST_TEXT - 1].rstrip()}…"


def _pairs(items: Mapping[str, str]) -> str:
    return ", ".join(f"{key}: {value}" for key, value in items.items())
