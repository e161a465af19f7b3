# SPDX-License-Identifier: Apache-2.0
"""Modules form no import cycles, not even for a type checker."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from product_modules import product_modules


def imported(path: Path) -> Iterator[str]:
    """Yield the imports of a module; a name counts first as a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_no_module_imports_itself_through_others():
    known = product_modules()
    assert len(known) > 300
    graph: dict[str, set[str]] = {}
    for name, path in known.items():
        found = set(imported(path)) & known.keys()
        # What a package's own name stands for beside a module of it is that module.
        parents = {one.rpartition(".")[0] for one in found}
        graph[name] = found - {name, *parents}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None
