# SPDX-License-Identifier: Apache-2.0
"""Imports of a file: skills and subtrees from libraries of the same trees folder."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from dataclasses import replace

from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_language.model.specs import SkillSpec, SubtreeSpec
from bt_agents_language.nodes.symbols import ImportProblem, Library, SymbolTable
from bt_agents_language.yaml.field_tables import TEXT, FieldDecl, Items
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Sequence

SUFFIXES = (".yaml", ".yml")
"""Suffixes of files in a trees folder."""

IMPORTS = FieldDecl(
    "imports", Items(TEXT), "Libraries, by their paths from the trees folder: libraries/x.yaml"
)


def read_imports(
    reading: TypedReader, fields: MappingReader, symbols: SymbolTable
) -> tuple[SymbolTable, Mapping[str, SubtreeSpec]]:
    """Return the symbols with imported skills, and the imported subtrees by name.

    Failed imports are reported at their paths.
    """
    skills: dict[str, SkillSpec] = dict(symbols.skills)
    subtrees: dict[str, SubtreeSpec] = {}
    seen: set[str] = set()
    imports = fields.get("imports")
    failed = imports is not None and not isinstance(imports, Sequence)
    for node in fields.items("imports"):
        path = reading.text(node, "an import")
        library = _load(reading, node, path, symbols, seen) if path is not None else None
        if library is None:
            failed = True
            continue
        for skill in library.skills.values():
            known = skills.setdefault(skill.name, skill)
            if known is not skill:
                _taken(reading, node, "skill", skill.name, known.position.file)
        for subtree in library.subtrees.values():
            other = subtrees.setdefault(subtree.name, subtree)
            if other is not subtree:
                _taken(reading, node, "subtree", subtree.name, other.position.file)
    return replace(symbols.with_skills(skills), incomplete=failed), subtrees


def _load(
    reading: TypedReader, node: Node, path: str, symbols: SymbolTable, seen: set[str]
) -> Library | None:
    problem, hint = _path_problem(path)
    if problem:
        meant = _meant(path, symbols)
        reading.error("bad-import", node, problem, f"write {meant}" if meant else hint)
        return None
    if path in seen:
        reading.error("duplicate-key", node, f"{quote(path)} is imported twice", "remove one")
        return None
    seen.add(path)
    if symbols.libraries is None:
        reading.error(
            "bad-import", node, "there is no trees folder to import from", "put the file into one"
        )
        return None
    try:
        return symbols.libraries.load(path)
    except ImportProblem as error:
        reading.error(error.code, node, error.message, error.hint)
        return None


def _meant(path: str, symbols: SymbolTable) -> str:
    """Return the path of the library with the most similar name; empty without one."""
    known = symbols.libraries.paths() if symbols.libraries is not None else []
    stems = {_stem(one): one for one in known}
    stem = nearest(_stem(path), stems)
    return stems[stem] if stem is not None else ""


def _stem(path: str) -> str:
    return posixpath.splitext(posixpath.basename(path))[0]


def _path_problem(path: str) -> tuple[str, str]:
    expected = "the path of a file from the trees folder on"
    example = "for example libraries/manners.yaml"
    if path.startswith(("/", "~")) or "\\" in path or ":" in path:
        return f"expected {expected}, found {quote(path)}", example
    if ".." in path.split("/"):
        return f"{quote(path)} leads out of the trees folder", f"write {expected}, {example}"
    if posixpath.normpath(path) != path:
        return f"{quote(path)} is not written plainly", f"write {posixpath.normpath(path)}"
    if not path.endswith(SUFFIXES):
        return f"{quote(path)} is not a YAML file", f"write {expected}, {example}"
    return "", ""


def _taken(reading: TypedReader, node: Node, what: str, name: str, file: str) -> None:
    reading.error(
        "name-taken",
        node,
        f"this import brings a {what} '{name}', which {file} has already",
        "rename one of the two",
    )
