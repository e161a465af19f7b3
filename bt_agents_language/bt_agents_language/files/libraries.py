# SPDX-License-Identifier: Apache-2.0
"""Loader of libraries of a trees folder: reads each once, and refuses import cycles."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from bt_agents_core.errors import ReadError
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.imports import IMPORTS, SUFFIXES, read_imports
from bt_agents_language.files.skills_reader import SKILLS, SkillsReader
from bt_agents_language.files.texts_reader import AskedTexts, FolderTexts
from bt_agents_language.nodes.symbols import ImportProblem, Library, SymbolTable
from bt_agents_language.tree.trees_reader import SUBTREES, TreesReader
from bt_agents_language.yaml.field_tables import FileKind
from bt_agents_language.yaml.typed_reader import TypedReader

LIBRARY = FileKind(
    name="library",
    what="a library",
    title="Library",
    description="Skills, their bindings to a robot, and subtrees that agents share.",
    fields=(*SKILLS.fields[:2], IMPORTS, *SKILLS.fields[2:], SUBTREES),
)
MAX_CHAIN = 16
"""Maximum length of a chain of imports."""

_OTHERS = ("agents/", "scripts/")
"""Folders whose files are of other kinds, so that reading them here reports a problem."""


class FolderLibraries:
    """Libraries of one trees folder.

    Args:
        folder: The trees folder; nothing outside it is read.

    Attributes:
        symbols: Symbols for the files of the folder, including these libraries.
        broken: The unreadable libraries, by path.
        imports: Path of a library → its own imports, including inserted texts.
        texts: The texts of the folder.
    """

    def __init__(
        self, folder: Path, symbols: SymbolTable, robot: str = "", texts: FolderTexts | None = None
    ) -> None:
        self.broken: dict[str, ReadError] = {}
        self.imports: dict[str, set[str]] = {}
        self._folder = folder
        self.texts = texts or FolderTexts(folder, "")
        self.symbols = replace(symbols, libraries=self, texts=self.texts)
        self._robot = robot
        self._read: dict[str, Library] = {}
        self._chain: list[str] = []
        self._circles: dict[str, tuple[str, ...]] = {}
        self._of_languages: dict[str, FolderLibraries] = {self.texts.language: self}

    def speaking(self, language: str) -> FolderLibraries:
        if language not in self._of_languages:
            texts = self.texts.speaking(language)
            other = FolderLibraries(self._folder, self.symbols, self._robot, texts)
            # The imports of a library are the same in every language, except for texts.
            other.imports, other._of_languages = self.imports, self._of_languages
            self._of_languages[language] = other
        return self._of_languages[language]

    def load(self, path: str) -> Library:
        if self._chain:
            self.imports.setdefault(self._chain[-1], set()).add(path)
        if path in self._read:
            return self._read[path]
        if path.startswith(_OTHERS):
            raise ImportProblem(
                "bad-import",
                f"{quote(path)} is not a library",
                "import a file of libraries; what two agents share stands there",
            )
        if path in self._chain:
            circle = self._chain[self._chain.index(path) :]
            self._circles.update(dict.fromkeys(circle, (*circle, path)))
        elif len(self._chain) >= MAX_CHAIN:
            raise ImportProblem(
                "bad-import",
                f"imports are nested more than {MAX_CHAIN} deep",
                "import what is needed directly",
            )
        elif path not in self.broken:
            file = self._inside(path)
            self._chain.append(path)
            try:
                with TypedReader.of(file) as reading:
                    self._read[path] = self._library(reading)
                return self._read[path]
            except ReadError as error:
                self.broken[path] = error
            finally:
                self._chain.pop()
        if self._chain and path in self._circles.get(self._chain[-1], ()):
            steps = " → ".join(self._circles[path])
            raise ImportProblem(
                "import-cycle",
                f"the import leads back to itself: {steps[:120]}",
                "move what both need into a third library",
            )
        problems = self.broken[path].diagnostics
        first = problems[0]
        more = f" and {len(problems) - 1} more" if len(problems) > 1 else ""
        raise ImportProblem(
            "broken-import",
            f"{quote(path)} has errors itself: {first.code} in line {first.position.line}{more}",
            "fix it first",
        )

    def behind(self, paths: Iterable[str]) -> frozenset[str]:
        """Return libraries with all their direct and indirect imports."""
        found: set[str] = set()
        waiting = list(paths)
        while waiting:
            path = waiting.pop()
            if path not in found:
                found.add(path)
                waiting += self.imports.get(path, ())
        return frozenset(found)

    def _inside(self, path: str) -> Path:
        file = self._folder / path
        try:
            inside = file.resolve().is_relative_to(self._folder.resolve())
            there, link = file.exists(), file.is_symlink()
        except (OSError, RuntimeError, ValueError):
            inside, there, link = True, False, False
        if not inside:
            raise ImportProblem(
                "bad-import", f"{quote(path)} leads out of the trees folder", "copy the file here"
            )
        if there:
            return file
        message, hint = f"the link {quote(path)} leads nowhere", "put the file in its place"
        if not link:
            message = f"there is no file {quote(path)} in the trees folder"
            hint = did_you_mean(path, self.paths())
        raise ImportProblem("no-file", message, hint)

    def paths(self) -> list[str]:
        found = sorted((self._folder / "libraries").glob("*"))
        return [f"libraries/{path.name}" for path in found if path.suffix in SUFFIXES]

    def with_subtree(self, name: str) -> list[str]:
        found = []
        for path in self.paths():
            # The others may import the file being read now, which would look like a cycle.
            if not self._chain:
                with suppress(ImportProblem):
                    self.load(path)
            if path in self._read and name in self._read[path].subtrees:
                found.append(path)
        return found

    def _library(self, reading: TypedReader) -> Library:
        fields = reading.file(LIBRARY)
        if not any(fields.get(key) is not None for key in ("skills", "bindings", "subtrees")):
            reading.error(
                "missing-key",
                fields.mapping.position,
                "a library needs the key 'skills' or 'subtrees'",
                "add what it offers to the files that import it",
            )
        fields.text("description")
        texts = AskedTexts(self.texts)
        symbols, imported = read_imports(reading, fields, replace(self.symbols, texts=texts))
        skills = SkillsReader(symbols.interfaces, self._robot)
        if fields.get("skills") is not None or fields.get("bindings") is not None:
            skills.declare(reading, fields)
            skills.bind(reading, fields)
        own = skills.skills()
        for name in own.keys() & symbols.skills.keys():
            reading.error(
                "duplicate-skill",
                own[name].position,
                f"there is a skill '{name}' already: {symbols.skills[name].position}",
                "rename or remove one of them",
            )
        symbols = symbols.with_skills(own)
        trees = TreesReader(reading, fields.entries("subtrees"), symbols, imported, {})
        subtrees = trees.library()
        if texts.asked:
            self.imports.setdefault(self._chain[-1], set()).add(texts.path)
        reading.problems.raise_if_any()
        return Library(
            file=reading.source.file,
            skills=own,
            subtrees=subtrees,
            unused_inputs=tuple(trees.unused_inputs),
            warnings=reading.problems.warnings,
        )
