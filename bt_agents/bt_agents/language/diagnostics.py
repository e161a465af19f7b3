# SPDX-License-Identifier: Apache-2.0
"""Problems of a file, collected in one pass and shown with the line they are about."""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from bt_agents.errors import ReadError
from bt_agents.language.specs import Position

CODES = {
    "no-file": "The file does not exist or may not be read.",
    "not-a-file": "A folder, pipe, socket or device stands where a file is expected.",
    "too-large": "The file is larger than 1 MiB.",
    "not-utf8": "The file is not saved as UTF-8 text.",
    "bad-character": "The file holds an invisible character that no script needs.",
    "syntax": "The line is not valid YAML.",
    "tab": "A tab is used to indent; YAML indents with spaces.",
    "too-deep": "Lists and mappings are nested more than 64 deep.",
    "too-many-values": "The file holds more than 50,000 values.",
    "anchor": "Anchors (&name) and aliases (*name) are not part of this language.",
    "too-long": "One text has more than 20,000 characters.",
    "tag": "Tags (!name) are not part of this language.",
    "merge-key": "The merge key (<<) is not part of this language.",
    "several-documents": "A second document starts in the file (---).",
    "empty-file": "Nothing is written in the file.",
    "bad-key": "A key is empty, a list or a mapping instead of a word.",
    "duplicate-key": "The same key stands twice in one mapping.",
    "missing-key": "A key that is needed is not there.",
    "unknown-key": "Nothing reads a key of this name here.",
    "missing-value": "A key has nothing behind its colon.",
    "wrong-type": "One kind of value is expected, another was found.",
    "bad-number": "The value is not a finite number in plain writing.",
    "bad-duration": "The value is not a time with a unit.",
    "bad-choice": "The value is none of the words that are possible here.",
    "bad-name": "A name has other characters than names can have, or is too long.",
    "out-of-range": "A number is smaller or larger than it may be.",
    "off-step": "The default of a tunable lies between two of its steps.",
    "wrong-format": "The file is written for another version of the language.",
    "bad-ros-name": "The name of a topic, service or action breaks the rules of ROS.",
    "bad-ros-type": "The name of a ROS type is not written package/kind/Name.",
    "unknown-ros-type": "No installed ROS package has this type.",
    "unknown-ros-field": "The ROS type has no such field.",
    "bad-reference": "A ${…} does not hold exactly one name.",
    "unknown-name": "No tunable, input, output or scene value has this name.",
    "name-taken": "Two things have the same name, or one has a reserved name.",
    "wrong-value": "A name's value has another type than the place where it is used.",
    "bad-expression": "A condition is not written as conditions are.",
    "not-a-node": "A node is expected, something else was found.",
    "no-node": "There are modifiers but no node that they modify.",
    "two-nodes": "Two nodes stand in one item.",
    "unknown-node": "No node, skill or modifier has this name.",
    "no-children": "A composite has no children.",
    "misplaced-key": "A modifier stands where it has nothing to modify.",
    "unknown-subtree": "The file has no subtree of this name.",
    "unused-input": "A subtree declares an input that it never uses.",
    "recursion": "A subtree contains itself.",
    "tree-too-large": "A tree has more than 2,000 nodes, or is nested more than 64 deep.",
    "bad-binding": "A skill is not bound to exactly one action, service or topic.",
    "duplicate-agent": "Another file has an agent of the same name.",
    "duplicate-skill": "Another file has a skill of the same name.",
}
"""Every code that an error can have, with its meaning in one sentence."""

MAX_SHOWN = 100
"""So many errors of one file are shown; more help nobody."""

MAX_COLLECTED = 500
"""After so many errors reading ends: what is being read is no script."""

_EXCERPT_WIDTH = 96
_LONGEST_WORD = 64


class SourceText(Protocol):
    """What the renderer needs of a file."""

    def line(self, number: int) -> str:
        """Return a line, counted from 1, without its end."""


@dataclass(frozen=True, kw_only=True)
class Diagnostic:
    """One problem of a file.

    Attributes:
        code: Key of :data:`CODES`.
        position: First character of what is wrong.
        end: The character after its last one; None marks one character.
        message: What was found and what is expected.
        hint: How to mend it; may be empty.
    """

    code: str
    position: Position
    message: str
    hint: str = ""
    end: Position | None = None

    def __str__(self) -> str:
        return f"{self.position}: error[{self.code}]: {self.message}"


class Diagnostics:
    """Collects the problems of one file."""

    def __init__(self, source: SourceText | None) -> None:
        self._source = source
        self._found: dict[tuple[Position, str, str], Diagnostic] = {}

    def __len__(self) -> int:
        return len(self._found)

    def add(
        self,
        code: str,
        position: Position,
        message: str,
        hint: str = "",
        end: Position | None = None,
    ) -> None:
        """Add a problem; as :meth:`append`."""
        self.append(Diagnostic(code=code, position=position, message=message, hint=hint, end=end))

    def append(self, diagnostic: Diagnostic) -> None:
        """Add a problem; the same one at the same place counts once.

        Raises:
            ReadError: There are so many that reading on makes no sense.
        """
        key = (diagnostic.position, diagnostic.code, diagnostic.message)
        self._found.setdefault(key, diagnostic)
        if len(self._found) >= MAX_COLLECTED:
            raise self.error()

    def sorted(self) -> list[Diagnostic]:
        """Return the problems in the order of the file."""
        return sorted(self._found.values(), key=lambda d: (d.position.line, d.position.column))

    def error(self) -> ReadError:
        """Return all problems as one exception."""
        return as_error((diagnostic, self._source) for diagnostic in self.sorted())

    def raise_if_any(self) -> None:
        """Raise all problems as one exception.

        Raises:
            ReadError: There is a problem.
        """
        if self._found:
            raise self.error()


def as_error(problems: Iterable[tuple[Diagnostic, SourceText | None]]) -> ReadError:
    """Return problems, each with the text it is about, as one exception."""
    listed = list(problems)
    blocks = [render(diagnostic, source) for diagnostic, source in listed[:MAX_SHOWN]]
    lines = [str(diagnostic) for diagnostic, _ in listed[:MAX_SHOWN]]
    if len(listed) > MAX_SHOWN:
        count = len(listed) - MAX_SHOWN
        more = f"{listed[0][0].position.file}: … and {count} or more other errors"
        blocks.append(more)
        lines.append(more)
    return ReadError("\n".join(blocks), tuple(lines))


def render(diagnostic: Diagnostic, source: SourceText | None) -> str:
    """Return a problem as text: place and message, the line with a caret, the hint.

    Example:
        ::

            a.yaml:3:5: error[unknown-node]: there is no node 'sya'
                3 |   - sya: Hello.
                  |     ^^^
                  hint: did you mean 'say'?
    """
    lines = [str(diagnostic)]
    excerpt = source.line(diagnostic.position.line) if source is not None else ""
    if excerpt.strip():
        lines += _excerpt(diagnostic, excerpt)
    if diagnostic.hint:
        lines.append(f"{'':6}hint: {diagnostic.hint}")
    return "\n".join(lines)


def _excerpt(diagnostic: Diagnostic, line: str) -> list[str]:
    column = diagnostic.position.column - 1
    end = diagnostic.end
    width = 1
    if end is not None:
        last = end.column - 1 if end.line == diagnostic.position.line else len(line)
        width = max(1, min(last, len(line)) - column)
    line = line.replace("\t", " ")
    cut = max(0, column - _EXCERPT_WIDTH // 2) if len(line) > _EXCERPT_WIDTH else 0
    shown = line[cut : cut + _EXCERPT_WIDTH]
    before = "…" if cut else ""
    after = "…" if cut + _EXCERPT_WIDTH < len(line) else ""
    pad = " " * (columns(before + shown[: column - cut]))
    carets = "^" * max(1, columns(shown[column - cut : column - cut + width]))
    number = f"{diagnostic.position.line:>5}"
    return [f"{number} | {before}{shown}{after}", f"{'':5} | {pad}{carets}"]


def columns(text: str) -> int:
    """Return how many columns of a terminal a text takes."""
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )


def shown(text: str) -> str:
    """Return a found text in quotes, in one line and shortened, for a message."""
    flat = " ".join(text.split())
    return f"'{flat}'" if len(flat) <= 40 else f"'{flat[:39]}…'"


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that is most like another one, None when none is."""
    if len(word) > _LONGEST_WORD:
        return None
    words = list(known)
    tail = next((other for other in words if other.rpartition(".")[2] == word), None)
    if tail is not None:
        return tail
    folded = {other.casefold(): other for other in reversed(words)}
    alike = difflib.get_close_matches(word.casefold(), list(folded), n=1, cutoff=0.6)
    return folded[alike[0]] if alike else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint for a word that is not known: the most similar one, else all of a few."""
    words = list(known)
    near = nearest(word, words)
    if near is not None:
        strange = next((c for c in word if not c.isascii()), None)
        name = unicodedata.name(strange, "an unusual character") if strange is not None else ""
        return f"did you mean '{near}'?" + (f" ('{strange}' is {name})" if name else "")
    if not words:
        return ""
    return f"possible here: {', '.join(words[:16])}{', …' if len(words) > 16 else ''}"
