# SPDX-License-Identifier: Apache-2.0
"""Pages about kinds of files and their keys, made from the field tables of the readers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from dataclasses import field as data_field

from bt_agents_core.text import join_words
from bt_agents_language.files.file_kinds import FILE_KINDS
from bt_agents_language.reference.node_pages import FieldEntry
from bt_agents_language.yaml.field_tables import (
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Form,
    Items,
    KeyTable,
    SceneNameList,
    SceneValues,
    Several,
    Shared,
    Single,
    Value,
    WordChoice,
)
from bt_agents_language.yaml.typed_reader import FORMAT


@dataclass(frozen=True, kw_only=True)
class FilePage:
    """Page about a kind of file, or about one key of a file.

    Attributes:
        key: The word for the kind of file, or the key.
        where: What has the key; of a kind of file the word ``file``. The same key of several
            mappings has one page, with the first of them.
        expected: Allowed values of the key; empty for a kind of file.
        fields: Keys of the file, or of the mappings in the key.
    """

    key: str
    where: str = data_field(compare=False)
    description: str
    expected: str = ""
    fields: tuple[FieldEntry, ...] = ()


def file_pages(word: str, kinds: Mapping[str, FileKind] = FILE_KINDS) -> list[FilePage]:
    """Return the pages of the kind of file and of the keys with this name."""
    keys = [page for page in _key_pages(kinds) if page.key == word]
    kind = kinds.get(word)
    if kind is None:
        return keys
    fields = tuple(map(_entry, kind.fields))
    page = FilePage(key=word, where="file", description=kind.description, fields=fields)
    return [page, *keys]


def file_words(kinds: Mapping[str, FileKind] = FILE_KINDS) -> tuple[str, ...]:
    """Return the words for kinds of files, and all keys of files."""
    return tuple(dict.fromkeys([*kinds, *(page.key for page in _key_pages(kinds))]))


_FORMAT = FilePage(
    key="format",
    where="key of every file",
    description="The version of the language of the file.",
    expected=str(FORMAT),
)


def _key_pages(kinds: Mapping[str, FileKind]) -> tuple[FilePage, ...]:
    pages = (page for kind in kinds.values() for page in key_pages(kind))
    return tuple(dict.fromkeys([_FORMAT, *pages]))


def key_pages(kind: FileKind) -> Iterator[FilePage]:
    """Yield the pages of all keys of a kind of file, each mapping before its keys."""
    return _pages(kind, kind, "")


def _pages(table: KeyTable, kind: FileKind, above: str) -> Iterator[FilePage]:
    for one in table.fields:
        inner = tuple(_tables(one.value, kind.shared))
        below = dict.fromkeys(_entry(field) for part in inner for field in part.fields)
        yield FilePage(
            key=one.name,
            where=f"key{above} of {kind.what}",
            description=one.description,
            expected=_expected(one.value),
            fields=tuple(below),
        )
        for part in inner:
            yield from _pages(part, kind, f" below '{one.name}'")


def _tables(value: Value | None, shared: Mapping[str, KeyTable]) -> Iterator[KeyTable]:
    """Yield the tables of the mappings in a value, without those inside of them."""
    match value:
        case KeyTable():
            yield value
        case Shared(name=name):
            yield shared[name]
        case Items(item=inner) | Entries(value=inner):
            yield from _tables(inner, shared)
        case Several(one=one, other=other):
            yield from _tables(one, shared)
            yield from _tables(other, shared)
        case Either(options=options):
            for option in options:
                yield from _tables(option, shared)


def _entry(declared: FieldDecl) -> FieldEntry:
    return FieldEntry(
        name=declared.name,
        expected=_expected(declared.value),
        required=declared.required,
        default="" if declared.default is None else str(declared.default),
        description=declared.description,
    )


def _expected(value: Value) -> str:
    """Return the allowed values for people: ``number, 0 to 1`` or ``list, each: name``."""
    match value:
        case Single(form=Form.NUMBER | Form.INTEGER, minimum=low, maximum=high):
            limits = [f"{limit:.15g}" for limit in (low, high) if limit is not None]
            bounds = " to ".join(limits) if high is not None else "".join(limits) + " or more"
            return f"{value.form.value}, {bounds}" if limits else value.form.value
        case Single():
            return value.form.value
        case WordChoice():
            return join_words(value.words, "or")
        case Items():
            return f"list, each: {_expected(value.item)}"
        case Several():
            return f"{_expected(value.one)}, or a list"
        case Entries():
            return value.of or f"names, each with: {_expected(value.value)}"
        case SceneValues():
            return f"values of {'all ' if value.every else ''}scene parameters"
        case SceneNameList():
            return f"list of scene parameters, or {value.every}"
        case Either():
            return ", or ".join(map(_expected, value.options))
        case Shared():
            return value.name.replace("_", " ")
        case KeyTable():
            return "mapping"
