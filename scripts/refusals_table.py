# SPDX-License-Identifier: Apache-2.0
"""The refusals of docs/errors.md: each code with its sentence and the packages that use it."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from bt_agents_core.refusal_codes import RefusalCode

_HEAD = """
## Refusals at run time

A running system refuses an input, a request or a file with one of these codes and a reason in
words. Responses, results and events carry the code in `code` and the reason in `message` or
`reason`; logs and the command line print `CODE: reason`. Programs compare only the code, never the
reason, and accept codes that they do not know.

| code | what happened and what to do | raised in |
|---|---|---|
"""


def refusals_table(root: Path) -> str:
    """Return the section of all refusals for the packages of a source tree."""
    packages = defaultdict(set)
    for manifest in root.glob("*/package.xml"):
        package = manifest.parent.name
        for path in (manifest.parent / package).rglob("*.py"):
            for name in _raised(ast.parse(path.read_text(encoding="utf-8"))):
                packages[name].add(package)
    rows = (
        f"| `{code}` | {code.sentence} | `{'`, `'.join(sorted(packages[code.name]))}` |\n"
        for code in sorted(RefusalCode)
    )
    return _HEAD + "".join(rows)


def _raised(node: ast.AST) -> Iterator[str]:
    """Yield the codes in a syntax tree, except those in comparisons."""
    match node:
        case ast.Attribute(attr=name) if _is_code(node):
            yield name
        case ast.Compare() | ast.Dict():
            return
        case ast.Tuple(elts=[*codes]) if all(map(_is_code, codes)):
            return
    for child in ast.iter_child_nodes(node):
        yield from _raised(child)


def _is_code(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and ast.unparse(node.value) == "RefusalCode"
