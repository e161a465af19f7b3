# SPDX-License-Identifier: Apache-2.0
"""The table of the page about Groot2, made from what translates."""

from __future__ import annotations

import re

from bt_agents_groot.catalogue import BUILTINS, CONDITIONS, Builtin

_HEAD = "| BehaviorTree.CPP | here | difference |\n|---|---|---|\n"
_TABLE = re.compile(re.escape(_HEAD) + r"(\|.*\n)*")


def with_table(page: str) -> str:
    """Return the page with its table as it should be."""
    return _TABLE.sub(lambda _: groot_table(), page)


def groot_table() -> str:
    """Return what stands for each node and attribute of BehaviorTree.CPP, and how it differs."""
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
