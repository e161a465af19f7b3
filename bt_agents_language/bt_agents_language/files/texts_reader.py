# SPDX-License-Identifier: Apache-2.0
"""Reader of the texts of one language: ``texts/de.yaml`` of a trees folder."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.errors import ReadError
from bt_agents_core.text import join_words, quote
from bt_agents_language.diagnostics.collection import NO_TEXTS, did_you_mean, warning
from bt_agents_language.fields.texts import TEXT_PREFIX, NoText, WrittenText
from bt_agents_language.yaml.field_tables import (
    TEXT,
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    KeyTable,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar

FOLDER = "texts"
"""Folder of a trees folder with a file for each language."""

SUFFIX = ".yaml"

_VARIANTS = KeyTable(
    what="a text",
    fields=(
        FieldDecl(
            "one_of",
            Items(TEXT, filled=True),
            "Several texts; the main text of a skill is a different one each time.",
            required=True,
        ),
    ),
)
TEXTS = FileKind(
    name="texts",
    what="a file of texts",
    title="Texts",
    description="What agents say, ask and show in one language; the language is the name of the "
    "file.",
    fields=(
        FieldDecl(
            "texts",
            Entries(Either((TEXT, _VARIANTS)), "names and texts", empty="there is no text"),
            "Name → text, which nodes insert with ${t.name}; ${…} in the text has the value that "
            "it has in the node.",
            required=True,
        ),
    ),
)

_LANGUAGE = re.compile(r"[a-z][a-z0-9_]{0,31}")


@dataclass(frozen=True, kw_only=True)
class TextFile:
    """Texts of one language by name, with the place of each name."""

    texts: Mapping[str, WrittenText]
    keys: Mapping[str, Scalar]


def read_texts(file: Path | Source) -> TextFile:
    """Return the texts of a file, or raise a ``ReadError`` with all problems."""
    with TypedReader.of(file) as reading:
        fields = reading.file(TEXTS)
        texts: dict[str, WrittenText] = {}
        keys: dict[str, Scalar] = {}
        for entry in fields.entries("texts"):
            name = reading.name(entry.key, "the name of a text")
            scalars = _scalars(reading, entry)
            if name is not None and scalars:
                texts[name] = WrittenText(source=reading.source, scalars=scalars)
                keys[name] = entry.key
        reading.problems.raise_if_any()
        return TextFile(texts=texts, keys=keys)


def _scalars(reading: TypedReader, entry: MappingEntry) -> tuple[Scalar, ...]:
    what = f"text '{entry.key.text[:40]}'"
    items: tuple[Node, ...] = (entry.value,)
    if isinstance(entry.value, MappingNode):
        fields = reading.keys(entry.value, _VARIANTS, what)
        items = fields.items("one_of") if fields is not None else ()
        if fields is not None and len(items) < 2 and "one_of" in fields.nodes:
            reading.error(
                "missing-value",
                fields.nodes["one_of"],
                f"{what} needs two texts or more, found {len(items)}",
                "add another one, or write the text without 'one_of'",
            )
    sound = [item for item in items if reading.text(item, what) is not None]
    return tuple(item for item in sound if isinstance(item, Scalar))


class FolderTexts:
    """Texts of one language in a trees folder.

    Attributes:
        language: The language, empty for none.
        broken: Errors of its file; None for none.
        found: Names that were found in any language.
    """

    def __init__(self, folder: Path, language: str) -> None:
        self._of_languages: dict[str, FolderTexts] = {language: self}
        self.language = language
        self.broken: ReadError | None = None
        self.found: set[str] = set()
        self._folder = folder
        self._file: TextFile | None = None
        if language in self.languages():
            try:
                self._file = read_texts(self.path)
            except ReadError as error:
                self.broken = error

    def speaking(self, language: str) -> FolderTexts:
        if language not in self._of_languages:
            other = FolderTexts(self._folder, language)
            other.found, other._of_languages = self.found, self._of_languages
            self._of_languages[language] = other
        return self._of_languages[language]

    @property
    def spoken(self) -> tuple[FolderTexts, ...]:
        """These texts, and the texts of all other requested languages."""
        return tuple(self._of_languages.values())

    @property
    def path(self) -> Path:
        """File of the language."""
        return self._folder / FOLDER / f"{self.language}{SUFFIX}"

    def languages(self) -> list[str]:
        paths = sorted((self._folder / FOLDER).glob(f"*{SUFFIX}"))
        return [path.stem for path in paths if _LANGUAGE.fullmatch(path.stem)]

    def find(self, name: str) -> WrittenText:
        if self._file is None:
            # Why no text can be found is reported once per file.
            raise NoText(*self._why_no_file(), code=NO_TEXTS)
        if name not in self._file.texts:
            known = [f"{TEXT_PREFIX}{one}" for one in self._file.texts]
            raise NoText(
                f"there is no text {quote(name)} in {self._shown}",
                did_you_mean(f"{TEXT_PREFIX}{name}", known),
            )
        self.found.add(name)
        return self._file.texts[name]

    @property
    def _shown(self) -> str:
        return f"{FOLDER}/{self.language}{SUFFIX}"

    def _why_no_file(self) -> tuple[str, str]:
        if self.broken is not None:
            first = self.broken.diagnostics[0]
            return (
                f"'{self._shown}' has errors itself: {first.code} in line {first.position.line}",
                "fix it first",
            )
        languages = self.languages()
        if not languages:
            return f"there are no texts: no file in {FOLDER}/", f"write one: {FOLDER}/en{SUFFIX}"
        known = join_words(languages, "or")
        if not self.language:
            return (
                "no language is chosen for the texts that this file inserts",
                f"write 'language: {known}' in scene.yaml",
            )
        return (
            f"there are no texts in the language {quote(self.language)}",
            f"there are some in {known}; or write {FOLDER}/<language>{SUFFIX}",
        )


def uneven_texts(
    files: Mapping[Path, TextFile], used: Collection[str] | None
) -> Iterator[Diagnostic]:
    """Yield a warning for each text that a language lacks, and for each unused text.

    ``used`` are the texts that are inserted somewhere, None if unknown.
    """
    every = {name: path for path, one in reversed([*files.items()]) for name in one.texts}
    for path, one in files.items():
        for name in sorted(every.keys() - one.texts.keys()):
            yield warning(
                "missing-text",
                Position(file=str(path), line=1, column=1),
                1,
                f"there is no text {quote(name)}, which {every[name].name} has",
                f"add '{name}: …' below 'texts'",
            )
        for name in () if used is None else one.keys.keys() - {*used}:
            key = one.keys[name]
            yield warning(
                "unused-text",
                key.position,
                len(name),
                f"nothing inserts the text {quote(name)}",
                f"write ${{{TEXT_PREFIX}{name}}} where it is needed, or remove it",
            )


class AskedTexts:
    """Texts of a folder; records whether one file uses any of them."""

    def __init__(self, texts: FolderTexts) -> None:
        self.asked = False
        self._texts = texts

    def find(self, name: str) -> WrittenText:
        self.asked = True
        return self._texts.find(name)

    def languages(self) -> list[str]:
        return self._texts.languages()

    def speaking(self, language: str) -> AskedTexts:
        """Return these texts, switched to another language."""
        self._texts = self._texts.speaking(language)
        return self

    @property
    def path(self) -> str:
        """File of the language, relative to the trees folder."""
        return f"{FOLDER}/{self._texts.path.name}"
