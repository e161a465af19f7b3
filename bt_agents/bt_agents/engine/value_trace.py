# SPDX-License-Identifier: Apache-2.0
"""Trace of the values that the nodes of a tree read and write."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, NamedTuple

from py_trees.behaviour import Behaviour

from bt_agents.engine.scope import QUANTITIES, Scope, format_value
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.text import ellipsize, printable_line

LONGEST_VALUE = 200
"""Most characters of a value as text."""

_MOST_ITEMS = 20
_MOST_BITS = 512


class TracedValue(NamedTuple):
    """A value that a node read or wrote."""

    path: str
    name: str
    value: Plain
    written: bool


@dataclass(frozen=True, kw_only=True)
class _TracedNames:
    """The names that a node sees; each read or written value is noted."""

    path: str
    names: Scope
    note: Callable[[TracedValue], None]

    def lookup(self, name: str) -> Plain:
        value = self.names.lookup(name)
        self.note(TracedValue(self.path, name, value, False))
        return value

    def declare(self, names: Iterable[str]) -> None:
        self.names.declare(names)

    def write(self, name: str, value: Plain) -> bool:
        changes = self.names.write(name, value)
        self.note(TracedValue(self.path, name, value, True))
        return changes


class ValueTrace:
    """Reads and writes of all nodes of a tree from now until :meth:`close`.

    A tree without a trace has no overhead. Only values are noted that differ from the last one
    that the same node read or wrote under the name; with ``repeated``, all values are noted.
    """

    def __init__(self, root: Behaviour, *, repeated: bool = False) -> None:
        self._repeated = repeated
        self._known: dict[tuple[str, str, bool], Plain] = {}
        self._news: dict[tuple[str, str, bool], TracedValue] = {}
        self._nodes: list[Any] = list(root.iterate())
        for node in self._nodes:
            names = _TracedNames(path=node.spec.path, names=node.fields.names, note=self._note)
            node.fields = replace(node.fields, names=names)
            if hasattr(node, "scope"):
                node.scope = names

    def take(self) -> list[TracedValue]:
        """Return the notes since the last call, in order."""
        news = list(self._news.values())
        self._news.clear()
        return news

    def close(self) -> None:
        """Stop the trace."""
        for node in self._nodes:
            names = self._untraced(node.fields.names)
            node.fields = replace(node.fields, names=names)
            if hasattr(node, "scope"):
                node.scope = names
        self._nodes.clear()

    def _untraced(self, names: _TracedNames) -> Scope:
        """Return the names without this trace; other traces of the tree continue."""
        if names.note == self._note:
            return names.names
        inner = names.names
        assert isinstance(inner, _TracedNames)
        return replace(names, names=self._untraced(inner))

    def _note(self, traced: TracedValue) -> None:
        key = (traced.path, traced.name, traced.written)
        if not self._repeated and key in self._known and self._known[key] == traced.value:
            return
        self._known[key] = traced.value
        self._news.pop(key, None)
        self._news[key] = traced


def as_written(value: Plain, field_type: FieldType = FieldType.ANY) -> str:
    """Return a value on one line as an author writes it; a long one is truncated."""
    if field_type in QUANTITIES:
        return format_value(value, field_type)
    text = ""
    for part in _parts(value):
        text += part
        if len(text) > LONGEST_VALUE:
            break
    return ellipsize(printable_line(text), LONGEST_VALUE)


def _parts(value: Plain) -> Iterator[str]:
    """Yield the parts of a written value; a large one is not read to its end."""
    match value:
        case None:
            yield "null"
        case bool():
            yield "true" if value else "false"
        case int():
            yield str(value) if value.bit_length() < _MOST_BITS else "…"
        case float():
            yield f"{round(value, 3):.15g}"
        case str():
            yield f"'{value[:LONGEST_VALUE]}'"
        case Mapping():
            yield "{"
            for number, (key, one) in enumerate(islice(value.items(), _MOST_ITEMS + 1)):
                yield ", " if number else ""
                if number == _MOST_ITEMS:
                    yield "…"
                    break
                yield f"{key[:LONGEST_VALUE]}: "
                yield from _parts(one)
            yield "}"
        case tuple() | list():
            yield "["
            for number, one in enumerate(value[: _MOST_ITEMS + 1]):
                yield ", " if number else ""
                if number == _MOST_ITEMS:
                    yield "…"
                    break
                yield from _parts(one)
            yield "]"
        case _:
            yield str(value)
