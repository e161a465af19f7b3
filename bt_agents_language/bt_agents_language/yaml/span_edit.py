# SPDX-License-Identifier: Apache-2.0
"""Edit of one value by its source span, so that tuning a value changes only its line."""

from __future__ import annotations

from collections.abc import Iterator

from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.scalars import quoted, value_type
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence, read_yaml


def replace_value(source: Source, node: Scalar, new_text: str) -> str:
    """Return the text of a file with one changed value; every other character stays.

    In place of a text, the new value stays a text, in quotes if needed; in place of a number,
    time, boolean or nothing, it means what it would mean to an author.

    Raises:
        ValueError: ``node`` is not a value of this file, or no file can hold ``new_text``.
    """
    before = _read(source)
    if before is None or not any(part == node for part in _parts(before)):
        raise ValueError(f"{node.position}: {quote(node.text)} is not a value of this file")
    start, end = node.span
    end = start + len(source.text[start:end].rstrip())
    space = " " if start == end and source.text[start - 1 : start] in (":", "-") else ""
    sign = source.text[start:end].split("\n")[0] if node.style in ("|", ">") else ""
    comment = f"  {sign[sign.index('#') :].rstrip()}" if "#" in sign else ""
    for written in _writings(node, source.text[start:end], new_text):
        text = f"{source.text[:start]}{space}{written}{comment}{source.text[end:]}"
        after = _read(Source(source.file, text))
        if after is not None and _only_changed(before, after, node, new_text):
            return text
    raise ValueError(f"{node.position}: {quote(new_text)} cannot be written into a file")


def _writings(node: Scalar, written: str, new_text: str) -> list[str]:
    """Return the possible notations of a new value, the one most similar to the old one first."""
    in_quotes = quoted(new_text)
    if written.startswith("'") and new_text.isprintable():
        in_quotes = "'" + new_text.replace("'", "''") + "'"
    return [new_text, in_quotes] if node.plain else [in_quotes]


def _read(source: Source) -> Node | None:
    problems = Diagnostics(None)
    root = read_yaml(source, problems)
    return None if problems else root


def _only_changed(before: Node, after: Node, node: Scalar, new_text: str) -> bool:
    old, new = list(_parts(before)), list(_parts(after))
    if len(old) != len(new):
        return False

    def fits(one: Scalar | str, other: Scalar | str) -> bool:
        if isinstance(one, str) or isinstance(other, str):
            return one == other
        if one.span != node.span:
            return (one.text, one.style) == (other.text, other.style)
        stays_text = value_type(one) is not str or value_type(other) is str
        return other.text == new_text and stays_text

    return all(map(fits, old, new))


def _parts(node: Node) -> Iterator[Scalar | str]:
    """Return the scalars of a document in order, with marks that show its structure."""
    match node:
        case Scalar():
            yield node
        case Sequence():
            yield "["
            for item in node.items:
                yield from _parts(item)
            yield "]"
        case Mapping():
            yield "{"
            for entry in node.entries:
                yield f"{entry.key.text}:"
                yield from _parts(entry.value)
            yield "}"
