# SPDX-License-Identifier: Apache-2.0
"""Comments of a YAML file, which the parser drops and the formatter writes back."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence

_COMMENT = re.compile(r"#[^\n]*")
_ONLY_INDICATORS = re.compile(r"[\s\-?:{\[,]*")


@dataclass(frozen=True, kw_only=True)
class Comment:
    """One comment.

    Attributes:
        index: Index of its ``#`` in the file's text.
        text: From its ``#`` on, without spaces at its end.
        column: Where the first character of its line that is no space stands, from 0.
        own_column: Where its ``#`` stands in its line, from 0.
        blank_before: Whether it is the first of its line, below a blank line.
    """

    index: int
    text: str
    column: int
    own_column: int
    blank_before: bool


def find_comments(source: Source, root: Node) -> tuple[Comment, ...]:
    """Return the comments of a file, whose lines end with a line feed alone, in their order."""
    found: list[Comment] = []
    at = 0
    for scalar in sorted(scalars(root), key=lambda one: one.span):
        found += _in_gap(source, at, scalar.span[0])
        at = scalar.span[1]
        if scalar.style in ("|", ">"):
            # A comment may stand behind the sign; what follows is text.
            end_of_line = source.text.find("\n", scalar.span[0])
            found += _in_gap(source, scalar.span[0], at if end_of_line < 0 else end_of_line)
    found += _in_gap(source, at, len(source.text))
    return tuple(found)


def scalars(node: Node) -> Iterator[Scalar]:
    """Return every key and value of a document."""
    match node:
        case Scalar():
            yield node
        case Sequence():
            for item in node.items:
                yield from scalars(item)
        case Mapping():
            for entry in node.entries:
                yield entry.key
                yield from scalars(entry.value)


def blank_before(source: Source, index: int) -> bool:
    """Return whether what starts at ``index`` is the first of its line, below a blank line."""
    start = source.text.rfind("\n", 0, index) + 1
    if not _ONLY_INDICATORS.fullmatch(source.text, start, index):
        return False
    before = source.text.rfind("\n", 0, max(start - 1, 0)) + 1
    return start > 0 and not source.text[before:start].strip()


def _in_gap(source: Source, start: int, end: int) -> Iterator[Comment]:
    for match in _COMMENT.finditer(source.text, start, end):
        line = source.text[source.text.rfind("\n", 0, match.start()) + 1 : match.start() + 1]
        yield Comment(
            index=match.start(),
            text=match[0].rstrip(),
            column=len(line) - len(line.lstrip()),
            own_column=len(line) - 1,
            blank_before=blank_before(source, match.start()),
        )
