# SPDX-License-Identifier: Apache-2.0
"""The names that a place in a file may use, their types, and which of them were used."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from bt_agents.language.diagnostics import did_you_mean
from bt_agents.language.expressions import ValueKind
from bt_agents.language.specs import FieldType
from bt_agents.scene import SceneSpace

RESERVED = (
    "scene", "live", "mood", "profile", "msg", "result",
    "and", "or", "not", "true", "false", "null",
)  # fmt: skip
"""Words that no tunable, input or output may be called."""

_KINDS = {
    FieldType.TEXT: ValueKind.TEXT,
    FieldType.NUMBER: ValueKind.NUMBER,
    FieldType.INTEGER: ValueKind.NUMBER,
    FieldType.DURATION: ValueKind.NUMBER,
    FieldType.BOOLEAN: ValueKind.BOOLEAN,
}

FieldCheck = Callable[[str], str | None]
"""Returns why a message has no field of this path, None when it has."""


class Names:
    """Names with their types; remembers which of them were asked for."""

    def __init__(
        self, types: Mapping[str, FieldType], messages: Mapping[str, FieldCheck] | None = None
    ) -> None:
        """Take the names.

        Args:
            types: Type of each name.
            messages: Name of a message (``msg``, ``result``) → check of the paths behind it.
        """
        self.used: set[str] = set()
        self._types = dict(types)
        self._messages = dict(messages or {})

    def and_these(self, types: Mapping[str, FieldType]) -> Names:
        """Return these and more names."""
        return Names({**self._types, **types}, self._messages)

    def and_message(self, name: str, check: FieldCheck) -> Names:
        """Return these names and the fields of a message; both remember uses together."""
        names = Names(self._types, {**self._messages, name: check})
        names.used = self.used
        return names

    def type_of(self, name: str) -> FieldType | None:
        """Return the type of a name and remember it as used; None when there is no such name."""
        self.used.add(name)
        head, _, path = name.partition(".")
        if path and head in self._messages:
            return FieldType.ANY
        return self._types.get(name)

    def kind_of(self, name: str) -> ValueKind | None:
        """Return the kind of a name's value for operators, None where only a run shows it."""
        found = self.type_of(name)
        return _KINDS.get(found) if found is not None else None

    def problem(self, name: str) -> tuple[str, str, str] | None:
        """Return code, message and hint when a name cannot be used."""
        head, _, path = name.partition(".")
        if path and head in self._messages:
            problem = self._messages[head](path)
            return ("unknown-ros-field", problem, "") if problem else None
        if self.type_of(name) is not None:
            return None
        known = [*self._types, *(f"{message}.…" for message in self._messages)]
        if head in self._messages:
            return ("unknown-name", f"'{name}' is a whole message", f"name a field: {name}.data")
        if name == "mood.change" or name == "mood":
            hint = did_you_mean(name, known) if "mood.change" in known else (
                "scene.yaml does not say which parameter is the mood; add 'mood: …' there"
            )  # fmt: skip
            return ("unknown-name", f"there is no name '{name}' here", hint)
        return ("unknown-name", f"there is no name '{name[:80]}' here", did_you_mean(name, known))


def scene_names(
    space: SceneSpace, groups: Iterable[str] = ("scene", "live")
) -> dict[str, FieldType]:
    """Return the names of scene values: ``scene.age``, ``scene.person``, …."""
    types: dict[str, FieldType] = {}
    for group in groups:
        types.update({f"{group}.{name}": FieldType.NUMBER for name in space.names})
        if group != "profile":
            types[f"{group}.person"] = FieldType.BOOLEAN
    return types


def mood_names(space: SceneSpace) -> dict[str, FieldType]:
    """Return ``mood.change`` where a system knows a mood."""
    return {} if space.mood is None else {"mood.change": FieldType.NUMBER}
