# SPDX-License-Identifier: Apache-2.0
"""The schemas of all kinds of files for one trees folder, as texts to be written down."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from bt_agents_language.files.folder_reader import read_vocabulary
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.model.node_type import NodeType
from bt_agents_language.model.symbols import ImportProblem, SymbolTable
from bt_agents_language.tools.schema.agent_schema import agent_schema, library_schema
from bt_agents_language.tools.schema.documents import (
    experiment_schema,
    market_schema,
    script_schema,
)
from bt_agents_language.tools.schema.scene_files import scene_schema
from bt_agents_language.tools.schema.test_schema import cases_schema
from bt_agents_language.tools.schema.value_schemas import Schema

SCHEMAS: Mapping[str, Callable[[SymbolTable], Schema]] = {
    "agent": agent_schema,
    "library": library_schema,
    "test": cases_schema,
    "scene": lambda _: scene_schema(),
    "market": lambda _: market_schema(),
    "script": lambda vocabulary: script_schema(vocabulary.space),
    "experiment": lambda vocabulary: experiment_schema(vocabulary.space),
}
"""Kind of file → its schema."""


def folder_vocabulary(folder: Path, plugins: Mapping[str, NodeType] | None = None) -> SymbolTable:
    """Return all words that some file of a trees folder may use, those of libraries included.

    Args:
        folder: The trees folder.
        plugins: Kinds of nodes of plug-ins; None takes the installed ones.

    Raises:
        ReadError: ``scene.yaml`` or a skills file is broken.
    """
    vocabulary = read_vocabulary(folder, read_scene(folder / "scene.yaml"))
    if plugins is not None:
        vocabulary = replace(vocabulary, plugins=plugins)
    libraries = FolderLibraries(folder, vocabulary)
    for path in libraries.paths():
        try:
            vocabulary = vocabulary.with_skills(libraries.load(path).skills)
        except ImportProblem:
            # A library with errors offers nothing; checking it is somebody else's part.
            continue
    return vocabulary


def schema_file(kind: str) -> str:
    """Return the name of the file that the schema of a kind of file stands in."""
    return f"{kind}.schema.json"


def schema_text(kind: str, vocabulary: SymbolTable) -> str:
    """Return what stands in the file of a schema."""
    return json.dumps(SCHEMAS[kind](vocabulary), indent=2, ensure_ascii=False) + "\n"
