# SPDX-License-Identifier: Apache-2.0
"""Collection of a file's diagnostics, and words that messages share."""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable
from dataclasses import replace
from itertools import accumulate
from typing import Protocol

from bt_agents_core.diagnostic import Diagnostic, Position, Severity
from bt_agents_core.errors import ReadError
from bt_agents_language.diagnostics.renderers import MAX_COLLECTED, as_lines, as_text

NO_TEXTS = "no-texts"
"""Code of a problem that all texts of a file share, so that it is reported once per file."""

_LONGEST_WORD = 64
_MANY_WORDS = 200
_LIST_COLUMNS = 140
_LEAST_ALIKE = 0.65
"""A word may be meant as another one if at least this ratio of their letters match."""

_SAME = (
    ("answers", "choices", "options", "replies"),
    ("clip", "image", "photo", "picture", "video"),
    ("say", "speak", "talk", "tell", "print"),
    ("drive", "go", "go_to", "move", "move_to", "navigate", "navigate_to"),
    ("sound", "play", "play_sound", "audio"),
    ("wait_for", "wait_until", "await"),
    ("selector", "fallback", "priority"),
    ("sequence", "steps", "serial"),
    ("subtree", "call", "include"),
    ("text", "question", "words"),
    ("message", "data", "payload"),
    ("rate", "speed", "tempo"),
    ("destination", "to", "target"),
    ("attempts", "times", "count", "tries"),
    ("pause", "delay"),
    ("on_failure", "on_error", "on_fail", "catch"),
    ("on_cancel", "on_stop", "on_abort"),
    ("tunables", "parameters", "params", "settings", "variables"),
    ("min", "minimum"),
    ("max", "maximum"),
    ("weight", "chance", "probability"),
    ("name", "id", "label"),
    ("forever", "always", "endless", "infinite", "unlimited"),
    ("positive", "good", "praise", "reward"),
    ("negative", "bad", "blame", "punish"),
    ("one", "any"),
    ("all", "both", "every"),
)
"""Words that people confuse."""

_CONFUSED = {word: same for same in _SAME for word in same}


class SourceText(Protocol):
    """Part of a file that a collection needs."""

    def line(self, number: int) -> str:
        """Return a line, counted from 1, without its line end."""


class Diagnostics:
    """Collects the problems of one file; its length is the number of errors."""

    def __init__(self, source: SourceText | None) -> None:
        self._source = source
        self._found: dict[Severity, dict[tuple[Position, str, str], Diagnostic]] = {
            severity: {} for severity in Severity
        }
        self._lines: dict[int, str] = {}

    def __len__(self) -> int:
        return len(self._found[Severity.ERROR])

    def beside(self, source: SourceText) -> Diagnostics:
        """Return the same collection, for problems of another file."""
        other = Diagnostics(source)
        other._found = self._found
        return other

    def add(
        self,
        code: str,
        position: Position,
        message: str,
        hint: str = "",
        end: Position | None = None,
        severity: Severity = Severity.ERROR,
        inserted: tuple[str, ...] = (),
    ) -> None:
        """Add a problem; duplicates at a place, or of all texts of a file, count once.

        Raises:
            ReadError: There are too many errors to continue reading.
        """
        found = self._found[severity]
        place = position._replace(line=0, column=0) if code == NO_TEXTS else position
        key = (place, code, message)
        if key in found:
            if inserted:
                found[key] = _joined(found[key], inserted)
            return
        if len(found) >= MAX_COLLECTED:
            return
        found[key] = Diagnostic(
            code=code,
            position=position,
            message=message,
            hint=hint,
            end=end,
            severity=severity,
            inserted=inserted,
            excerpt=self._line(position.line),
        )
        if len(self) >= MAX_COLLECTED:
            raise self.error()

    def sorted(self) -> list[Diagnostic]:
        """Return the errors in the order of the file."""
        return _in_order(self._found[Severity.ERROR].values())

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """Warnings in the order of the file; they do not make it unreadable."""
        return tuple(_in_order(self._found[Severity.WARNING].values()))

    def error(self) -> ReadError:
        """Return all errors as one exception."""
        return as_error(self.sorted())

    def raise_if_any(self) -> None:
        """Raise all errors as one exception.

        Raises:
            ReadError: There is an error; warnings do not count.
        """
        if len(self):
            raise self.error()

    def _line(self, number: int) -> str:
        # Store each line once: a hostile file may have one long line with many problems.
        if number not in self._lines:
            self._lines[number] = self._source.line(number) if self._source is not None else ""
        return self._lines[number]


def _in_order(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    return sorted(diagnostics, key=lambda one: (one.position.line, one.position.column))


def warning(code: str, position: Position, width: int, message: str, hint: str) -> Diagnostic:
    """Return a warning about some characters from a position on."""
    end = position._replace(column=position.column + width)
    return Diagnostic(
        code=code,
        position=position,
        message=message,
        hint=hint,
        end=end,
        severity=Severity.WARNING,
    )


def merged(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return problems in order, without duplicates, with all places that insert their texts."""
    found: dict[Diagnostic, Diagnostic] = {}
    for one in diagnostics:
        key = replace(one, inserted=())
        found[key] = _joined(found[key], one.inserted) if key in found else one
    return list(found.values())


def _joined(first: Diagnostic, inserted: tuple[str, ...]) -> Diagnostic:
    """Return a problem with the places of its duplicates, limited to a readable number."""
    places = dict.fromkeys((*first.inserted, *inserted))
    return replace(first, inserted=tuple(places)[:MAX_COLLECTED])


def as_error(diagnostics: Iterable[Diagnostic]) -> ReadError:
    """Return errors as one exception."""
    listed = tuple(diagnostics)
    return ReadError(as_text(listed), as_lines(listed), listed)


def joined(errors: Iterable[ReadError]) -> ReadError:
    """Return the errors of several files as one exception."""
    return as_error(merged(one for error in errors for one in error.diagnostics))


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word most similar to another one; None if none is similar."""
    if len(word) > _LONGEST_WORD:
        return None
    words = list(known)
    head, dot, member = word.rpartition(".")
    group = head + dot
    members = [one.removeprefix(group) for one in words if dot and one.startswith(group)]
    if members:
        # Only what stands after the point is misspelled.
        near = members[0] if len(members) == 1 else nearest(member, members)
        return f"{group}{near}" if near is not None else None
    tail = next((other for other in words if other.rpartition(".")[2] == word), None)
    if tail is not None:
        return tail
    longer = next((other for other in words if other.startswith(f"{word}_")), None)
    if longer is not None:
        return longer
    same = _CONFUSED.get(word.casefold(), ())
    meant = next((one for one in words if one in same), None) if same else None
    if meant is not None:
        return meant
    if len(words) > _MANY_WORDS:
        # Too many words are not a list of keys; then a wrong first letter is not worth the time.
        words = [other for other in words if other[:1] == word[:1]][:_MANY_WORDS]
    folded = {other.casefold(): other for other in reversed(words)}
    alike = difflib.get_close_matches(word.casefold(), list(folded), n=1, cutoff=_LEAST_ALIKE)
    return folded[alike[0]] if alike else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown word: the most similar one, or all if there are few."""
    words = list(known)
    near = nearest(word, words)
    if near is not None:
        strange = next((c for c in word if not c.isascii()), None)
        name = unicodedata.name(strange, "an unusual character") if strange is not None else ""
        return f"did you mean '{near}'?" + (f" ('{strange}' is {name})" if name else "")
    if not words:
        return ""
    group = word[: word.rfind(".") + 1]
    words = [other for other in words if group and other.startswith(group)] or words
    ends = accumulate(len(other) + 2 for other in words)
    listed = words[: sum(end <= _LIST_COLUMNS for end in ends)]
    return f"possible here: {', '.join(listed)}{', …' if len(words) > len(listed) else ''}"
