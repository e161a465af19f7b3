# SPDX-License-Identifier: Apache-2.0
"""Catalogue of the built-in nodes of BehaviorTree.CPP v4 and their equivalents in our language."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from importlib.resources import files
from typing import Any

import yaml


class PortKind(Enum):
    """Kind of value that a port of a built-in node takes; the value is text for messages."""

    TEXT = "a text"
    SCRIPT = "a script"
    COUNT = "a whole number, or -1 for without end"
    THRESHOLD = "a whole number; below 0 it counts from the number of children"
    MILLISECONDS = "a whole number of milliseconds"
    BOOLEAN = "true or false"
    STATUS = "SUCCESS, FAILURE, RUNNING or SKIPPED"


Limits = tuple[int, int | None]
"""Smallest and largest number of children; None means any number."""


@dataclass(frozen=True, kw_only=True)
class Builtin:
    """Built-in node.

    Attributes:
        ours: Equivalent in our language; empty if there is none.
        ports: Port → kind of its value.
        children: Allowed number of children.
        note: Difference between the two; empty if they do the same.
    """

    id: str
    ours: str
    ports: Mapping[str, PortKind]
    required: tuple[str, ...]
    children: Limits
    note: str


def _builtin(name: str, entry: Mapping[str, Any]) -> Builtin:
    required, optional = entry.get("required", {}), entry.get("optional", {})
    ports = {port: PortKind[kind.upper()] for port, kind in {**required, **optional}.items()}
    low, high = entry.get("children", (0, 0))
    return Builtin(
        id=name,
        ours=entry.get("ours", ""),
        ports=ports,
        required=tuple(required),
        children=(low, high),
        note=entry.get("note", ""),
    )


_BUILTINS = yaml.load(
    files("bt_agents_groot").joinpath("builtins.yaml").read_text(encoding="utf-8"),
    Loader=yaml.CSafeLoader,
)

BUILTINS: Mapping[str, Builtin] = {
    name: _builtin(name, entry) for name, entry in _BUILTINS["nodes"].items()
}
"""Nodes of BehaviorTree.CPP 4, and control nodes of Nav2, by id."""

CONDITIONS: Mapping[str, tuple[str, str]] = {
    name: (entry.get("ours", ""), entry.get("note", ""))
    for name, entry in _BUILTINS["attributes"].items()
}
"""Attribute of any node → its equivalent in our language (may be empty) and the difference."""

WRITTEN_PORTS: Mapping[str, tuple[str, ...]] = {
    name: tuple(ports) for name, ports in _BUILTINS["writes"].items()
}
"""Leaf of Nav2 → ports that it writes; it reads the others."""

EXPLICIT = ("Action", "Condition", "Control", "Decorator")
"""Elements of the explicit form, with the node name in ``ID``."""

SKIP_IF, FAILURE_IF, SUCCESS_IF, WHILE = "_skipIf", "_failureIf", "_successIf", "_while"
ON_SUCCESS, ON_FAILURE, ON_HALTED, POST = "_onSuccess", "_onFailure", "_onHalted", "_post"

OTHER_ATTRIBUTES = ("ID", "name", "_autoremap", "_description", "_fullpath", "_uid", "_collapsed")
"""Attributes of any node that have no effect on the tree or are read elsewhere."""

_HEAD = "| BehaviorTree.CPP | here | difference |\n|---|---|---|\n"
_TABLE = re.compile(re.escape(_HEAD) + r"(\|.*\n)*")


def with_table(page: str) -> str:
    """Return the documentation page about Groot2 with a newly generated table."""
    return _TABLE.sub(lambda _: groot_table(), page)


def groot_table() -> str:
    """Return the table of nodes and attributes of BehaviorTree.CPP with their equivalents."""
    rows = [(f"<{one.id}{_ports(one)}>", one.ours, one.note) for one in BUILTINS.values()]
    rows.append(('<SubTree ID="…">', "`subtree` with `with` and `outputs`", ""))
    rows += [(_with_value(name).strip(), *words) for name, words in CONDITIONS.items()]
    lines = (f"| `{theirs}` | {ours or 'nothing'} | {note} |\n" for theirs, ours, note in rows)
    return _HEAD + "".join(lines)


def _ports(one: Builtin) -> str:
    shown = "".join(map(_with_value, one.required[:2]))
    return f"{shown} …" if len(one.required) > 2 else shown


def _with_value(name: str) -> str:
    return f' {name}="…"'
