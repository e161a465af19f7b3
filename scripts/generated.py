# SPDX-License-Identifier: Apache-2.0
"""The generated files of this repository, for scripts/generate."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path

from patterns_page import patterns_page
from protocol_types import protocol_types
from refusals_table import refusals_table
from ros_reference import ros_reference

from bt_agents_groot.catalogue import with_table
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.reference.reference_page import codes_page, reference_page
from bt_agents_language.tools.schema.folder import folder_symbols, schema_file, schema_text
from bt_agents_tools.cli.installed_kinds import installed_kinds

ROOT = Path(__file__).parents[1]


@cache
def shipped() -> SymbolTable:
    """Return the symbol table of this repository's trees folder, without installed plug-ins."""
    return folder_symbols(ROOT / "trees", plugins={})


def _schema(kind: str) -> str:
    return schema_text(installed_kinds()[kind], shipped())


GENERATED: Mapping[str, Callable[[], str]] = {
    "bt_agents_studio/frontend/src/protocol.ts": protocol_types,
    "docs/errors.md": lambda: codes_page() + refusals_table(ROOT),
    "docs/groot.md": lambda: with_table((ROOT / "docs" / "groot.md").read_text(encoding="utf-8")),
    "docs/nodes.md": lambda: reference_page(shipped()),
    "docs/patterns.md": lambda: patterns_page(ROOT / "trees"),
    **{f"schema/{schema_file(kind)}": partial(_schema, kind) for kind in installed_kinds()},
}
"""File → function that makes its content."""

OF_NODES: Mapping[str, Callable[[], str]] = {"docs/ros_reference.md": ros_reference}
"""The same for content that needs real nodes."""


def main() -> None:
    """Write all files, or compare them with ``--check``; exit code 1 when one is outdated."""
    check = sys.argv[1:] == ["--check"]
    if sys.argv[1:] and not check:
        sys.exit("usage: scripts/generate [--check]")
    outdated = []
    for name, made in {**GENERATED, **OF_NODES}.items():
        file = ROOT / name
        text = made()
        if file.exists() and file.read_text(encoding="utf-8") == text:
            continue
        outdated.append(name)
        if not check:
            file.parent.mkdir(exist_ok=True)
            file.write_text(text, encoding="utf-8")
            print(f"wrote {name}")
    if check and outdated:
        sys.exit(f"outdated: {', '.join(outdated)}; run scripts/generate")


if __name__ == "__main__":
    main()
