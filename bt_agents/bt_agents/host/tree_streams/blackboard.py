# SPDX-License-Identifier: Apache-2.0
"""Blackboard of a run for the tools of py_trees_ros: keys, values, activity."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from bt_agents.engine.scope import RunScope
from bt_agents.engine.value_trace import TracedValue, as_written
from bt_agents.host.tree_streams.tree_snapshot import key_of
from bt_agents_core.errors import Refused
from bt_agents_core.field_path import NoSuchField, item_of, value_at
from bt_agents_core.field_types import Plain
from bt_agents_language.expression.expression_values import EvaluationError, NoValue

NOTHING = "-"
"""Placeholder for a missing value."""

MOST_VARIABLES = 500
"""Most variables in one answer, snapshot or message."""

_MOST_LEVELS = 4
_INDENT = "    "


@dataclass(frozen=True, kw_only=True)
class Activity:
    """One access of a node to the blackboard; a missing value is empty."""

    key: str
    path: str
    type: str
    previous: str
    current: str


class BlackboardView:
    """The names of one run by their keys.

    Names of subtrees are private to them and not included.
    """

    def __init__(self, scope: RunScope) -> None:
        self._scope = scope
        names = [f"scene.{name}" for name in scope.space.names]
        names += [f"live.{name}" for name in scope.space.names]
        self._names = {key_of(name): name for name in (*names, *scope.tunables)}

    def keys(self) -> list[str]:
        """Return all keys, sorted."""
        self._names |= {key_of(name): name for name in self._scope.blackboard}
        return sorted(self._names)

    def variables(self) -> list[str]:
        """Return all keys, each followed by the attributes of its value: ``/answer.text``."""
        found: list[str] = []
        for key in self.keys():
            found += [key, *_attributes(key, self._value(key), _MOST_LEVELS)]
        return found[:MOST_VARIABLES]

    def text(self, variable: str) -> str:
        """Return the value of a key, or of ``key.attribute``, on one line."""
        key, _, attribute = variable.partition(".")
        value = self._value(key)
        if attribute and value is not None:
            try:
                value = value_at(value, attribute, item_of)
            except NoSuchField:
                value = None
        return NOTHING if value is None else as_written(value)

    def values(self, variables: Iterable[str]) -> list[tuple[str, str]]:
        """Return variables with their values."""
        return [(one, self.text(one)) for one in list(variables)[:MOST_VARIABLES]]

    def _value(self, key: str) -> Plain:
        name = self._names.get(key) or key.removeprefix("/").replace("/", ".", 1)
        try:
            return self._scope.lookup(name)
        except (NoValue, Refused, EvaluationError):
            return None


def absolute(variable: str) -> str:
    """Return the name of a variable with a leading slash."""
    return variable if variable.startswith("/") else f"/{variable}"


def chosen(
    wanted: Sequence[str], keys: Sequence[str], visited: Collection[str] | None
) -> list[str]:
    """Return the variables of a blackboard stream.

    Args:
        wanted: The requested variables; none means all.
        keys: All keys.
        visited: Keys of the nodes that answered, to restrict to; None for no restriction.
    """
    every = list(dict.fromkeys(map(absolute, wanted))) or list(keys)
    if visited is None:
        return every
    return [one for one in every if one.partition(".")[0] in visited]


def activities(traced: Iterable[TracedValue], known: dict[str, str]) -> list[Activity]:
    """Return accesses in order; ``known`` has the written values and is updated."""
    found = []
    for one in traced:
        key, value = key_of(one.name), as_written(one.value)
        previous = known.get(key, "")
        if one.written:
            kind = "WRITE" if key in known else "INITIALISED"
            known[key] = value
        else:
            kind, previous = "READ", ""
        found.append(Activity(key=key, path=one.path, type=kind, previous=previous, current=value))
    return found[-MOST_VARIABLES:]


def table(values: Sequence[tuple[str, str]]) -> str:
    """Return variables and values as lines with aligned values."""
    width = max((len(name) for name, _ in values), default=0)
    return "\n".join(f"{_INDENT}{name:<{width}} : {value}" for name, value in values)


def activity_table(accesses: Sequence[Activity]) -> str:
    """Return accesses as lines: key, kind of access, node and values."""
    lines = []
    for one in accesses:
        change = f"{one.previous} → {one.current}" if one.previous else one.current
        lines.append(f"{_INDENT}{one.key} : {one.type} | {one.path} | {change}")
    return "\n".join(lines)


def _attributes(name: str, value: Plain, levels: int) -> Iterator[str]:
    if not levels or not isinstance(value, Mapping):
        return
    for field, inner in list(value.items())[:MOST_VARIABLES]:
        yield f"{name}.{field}"
        yield from _attributes(f"{name}.{field}", inner, levels - 1)
