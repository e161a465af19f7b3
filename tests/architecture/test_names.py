# SPDX-License-Identifier: Apache-2.0
"""Unique names: each module of a package and each public class has a name of its own."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from product_modules import product_modules

MODULES = product_modules()

ENTRY_POINTS = ("__init__", "__main__")


def public_classes(path: Path) -> Iterator[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.name


def namesakes(named: Iterable[tuple[str, Path]]) -> dict[str, list[Path]]:
    """Return the names that several files share, with those files."""
    files = defaultdict(list)
    for name, path in named:
        files[name].append(path)
    return {name: found for name, found in files.items() if len(found) > 1}


def test_module_names_are_unique_within_package():
    modules = ((f"{name.partition('.')[0]}: {path.stem}", path) for name, path in MODULES.items())
    assert namesakes(one for one in modules if not one[0].endswith(ENTRY_POINTS)) == {}


def test_public_class_names_are_unique():
    paths = MODULES.values()
    assert namesakes((name, path) for path in paths for name in public_classes(path)) == {}


def test_comprehensions_do_not_shadow_module_names_functions_use():
    """In Python 3.12.0 to 3.12.3 the module's name is lost then, with an UnboundLocalError."""
    assert taken_from_module(
        "import g\ndef f(a):\n    b = {g for g in a}\n    return {g(c) for c in b}"
    )
    assert not taken_from_module(
        "import g\ndef f(a):\n    return {g for g in a}, {h(c) for c in a}"
    )
    for path in MODULES.values():
        assert taken_from_module(path.read_text(encoding="utf-8")) == set(), path


def taken_from_module(source: str) -> set[str]:
    """Return the module's names that a function uses and a comprehension binds."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    tree = ast.parse(source)
    found: set[str] = set()
    for function in ast.walk(tree):
        if isinstance(function, functions):
            arguments = {one.arg for one in ast.walk(function) if isinstance(one, ast.arg)}
            bound, free = _names(function, frozenset(arguments))
            found |= bound & free
    own = {getattr(one, "name", "") for one in tree.body}
    imports = [one for one in tree.body if isinstance(one, ast.Import | ast.ImportFrom)]
    return found & (own | {name.asname or name.name for one in imports for name in one.names})


def _names(node: ast.AST, hidden: frozenset[str]) -> tuple[set[str], set[str]]:
    """Return the names that comprehensions in a node bind, and the names used but not bound."""
    bound: set[str] = set()
    free: set[str] = set()
    if isinstance(node, ast.ListComp | ast.SetComp | ast.DictComp):
        targets = [name for one in node.generators for name in ast.walk(one.target)]
        bound = {name.id for name in targets if isinstance(name, ast.Name)}
        hidden |= bound
    elif isinstance(node, ast.Name) and node.id not in hidden:
        free = {node.id}
    for child in ast.iter_child_nodes(node):
        more_bound, more_free = _names(child, hidden)
        bound, free = bound | more_bound, free | more_free
    return bound, free
