# SPDX-License-Identifier: Apache-2.0
"""Variants of the texts of one node: never the same variant twice in a row."""

from __future__ import annotations

from bt_agents.engine.context import RunContext
from bt_agents_language.model.specs import Computed, Literal, Reference, Text, Value, Variants


class VariantPicker:
    """Picks of the node at ``path``, kept for its run."""

    def __init__(self, context: RunContext, path: str) -> None:
        self._context = context
        self._path = path
        self._last: dict[Variants, int] = {}

    def settled(self, value: Value) -> Value:
        """Return a value with one text instead of its variants."""
        match value:
            case Variants():
                return self._pick(value)
            case Text(parts=parts) if any(isinstance(part, Variants) for part in parts):
                return Text(parts=tuple(one for part in parts for one in self._parts(part)))
        return value

    def _parts(
        self, part: str | Reference | Computed | Variants
    ) -> tuple[str | Reference | Computed | Variants, ...]:
        if not isinstance(part, Variants):
            return (part,)
        picked = self._pick(part)
        if isinstance(picked, Text):
            return picked.parts
        return (picked if isinstance(picked, Reference) else str(picked.value),)

    def _pick(self, variants: Variants) -> Literal | Reference | Text:
        last = self._last.get(variants)
        number = self._context.pick(self._path, len(variants.texts), last)
        self._last[variants] = number
        return variants.texts[number]
