# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of the kinds of files, for one trees folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.files.folder_reader import read_symbols
from bt_agents_language.files.libraries import LIBRARY, FolderLibraries
from bt_agents_language.nodes.node_type import NodeType
from bt_agents_language.nodes.symbols import ImportProblem, SymbolTable
from bt_agents_language.tools.schema.generator import file_schema
from bt_agents_language.tools.schema.node_schemas import node_definitions
from bt_agents_language.tools.schema.value_schemas import Schema
from bt_agents_language.yaml.field_tables import FileKind

_WITH_TREES = (AGENT, LIBRARY)


def folder_symbols(folder: Path, plugins: Mapping[str, NodeType] | None = None) -> SymbolTable:
    """Return all words that files of a trees folder may use, including words of libraries.

    Plug-ins are by default those that are installed.

    Raises:
        ReadError: ``scene.yaml`` or a skills file is broken.
    """
    symbols = read_symbols(folder)
    if plugins is not None:
        symbols = replace(symbols, plugins=plugins)
    libraries = FolderLibraries(folder, symbols)
    for path in libraries.paths():
        try:
            symbols = symbols.with_skills(libraries.load(path).skills)
        except ImportProblem:
            # A library with errors offers nothing; other tools check it.
            continue
    return symbols


def schema_file(kind: str) -> str:
    """Return the name of the schema file for a kind of file."""
    return f"{kind}.schema.json"


def schema_of(kind: FileKind, symbols: SymbolTable) -> Schema:
    """Return the schema of a kind of file."""
    nodes = node_definitions(symbols) if kind in _WITH_TREES else {}
    return file_schema(kind, symbols.space, nodes)


def schema_text(kind: FileKind, symbols: SymbolTable) -> str:
    """Return the text of a schema file."""
    return json.dumps(schema_of(kind, symbols), indent=2, ensure_ascii=False) + "\n"
