# SPDX-License-Identifier: Apache-2.0
"""Formatting of texts for people: shortened texts, lists of words, numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from unicodedata import category, normalize

EXCERPT = 40
"""Characters of a found text that messages show."""

DIGITS = 4
"""Digits of values of scenes and profiles for people."""

_MOST_QUOTED = 5

_JOINERS = "\u200c\u200d"


def ellipsize(text: str, longest: int = EXCERPT) -> str:
    """Return a text, or its start and "…" if it exceeds a number of characters."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def folded(text: str) -> str:
    """Return a text for comparison: case and the encoding of accents do not matter."""
    return text.lower() if text.isascii() else normalize("NFC", normalize("NFC", text).casefold())


def single_spaced(text: str) -> str:
    """Return a text in one line, with each run of blanks as one space."""
    return " ".join(text.split())


def excerpt(text: str, longest: int) -> str:
    """Return a text in one line, or its start and "…" if it has more characters."""
    flat = single_spaced(text)
    return flat if len(flat) <= longest else f"{flat[: longest - 1].rstrip()}…"


def printable(text: str) -> str:
    r"""Return a text from outside in one line that is safe for terminals and logs.

    Control characters, the starts of escape sequences, line ends, direction marks, invisible
    characters and lone surrogates become escapes: ``\x1b``, ``\n``, ``\u202e``. Words in any
    language and other printable characters stay as they are.
    """
    if text.isprintable():
        return text
    around = zip(f" {text}", text, f"{text[1:]} ", strict=False)
    return "".join(
        one if one.isprintable() or _is_written(before, one, after) else ascii(one)[1:-1]
        for before, one, after in around
    )


def printable_lines(text: str) -> str:
    """Return a text of several lines, each made :func:`printable`; tabs stay."""
    if text.isprintable():
        return text
    lines = text.split("\n")
    return "\n".join("\t".join(map(printable, line.split("\t"))) for line in lines)


def printable_line(text: str) -> str:
    """Return a text in one line, with blanks for what :func:`printable` escapes."""
    return single_spaced("".join(c if c.isprintable() else " " for c in text))


def _is_written(before: str, one: str, after: str) -> bool:
    """Return whether languages use a character that :meth:`str.isprintable` rejects.

    These are blanks of other widths, and the joiners between letters and in emoji.
    """
    if one in _JOINERS:
        return all(not near.isascii() and near.isprintable() for near in (before, after))
    return category(one) == "Zs"


def quote(text: str) -> str:
    """Return the start of a text in one line and in quotes."""
    return f"'{ellipsize(single_spaced(text))}'"


def join_words(words: Sequence[str], last: str = "and") -> str:
    """Return words as a list in a sentence: ``a, b and c``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def join_first(words: Iterable[str], most: int = 4) -> str:
    """Return words as in :func:`join_words`; of many, the first ones and how many more."""
    every = list(words)
    if len(every) > most:
        every[most:] = [f"{len(every) - most} more"]
    return join_words(every)


def join_quoted(words: Iterable[str]) -> str:
    """Return words in quotes; of many, the first ones."""
    every = list(words)
    more = ", …" if len(every) > _MOST_QUOTED else ""
    return ", ".join(f"'{word}'" for word in every[:_MOST_QUOTED]) + more


@lru_cache(maxsize=4096)
def format_number(value: float, digits: int = 6) -> str:
    """Return a number with a maximum number of digits and a real minus sign."""
    return f"{value + 0.0:.{digits}g}".replace("-", "−")


def format_known(value: float) -> str:
    """Return a value of a scene or profile with :data:`DIGITS` digits, a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{DIGITS}g}"


_REFERENCE = re.compile(r'wait \$\{.*|\S+ (?P<text>".*\$\{.*")', re.DOTALL)
"""Name of a node that is named by a reference: ``wait ${patience}``, ``say "${words}"``."""


def filled_name(name: str, message: str) -> str:
    """Return a name whose reference is replaced by the message of the node: ``wait 8 s``.

    The message of a node that is named by a reference gives its current value; without a message,
    the name stays as the author wrote it.
    """
    reference = _REFERENCE.fullmatch(name)
    if reference is None or not message:
        return name
    quotes = '"' if reference["text"] else ""
    return f"{name.partition(' ')[0]} {quotes}{message}{quotes}"


def counted_answer(text: str, choices: Sequence[str]) -> str:
    """Return an answer spelled like its choice, or as given if there are no choices.

    Case, surrounding blanks and the encoding of accents do not matter. An answer that matches no
    choice counts as no answer: the empty text.
    """
    answer = text.strip()
    if not choices:
        return answer
    same = (choice for choice in choices if folded(choice.strip()) == folded(answer))
    return next(same, "") if answer else ""
