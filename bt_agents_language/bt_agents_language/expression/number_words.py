# SPDX-License-Identifier: Apache-2.0
"""Numbers from zero to twelve as people say them, in English and German."""

from __future__ import annotations

import re

_WORDS = (
    ("zero", "null"),
    ("one", "eins"),
    ("two", "zwei", "zwo"),
    ("three", "drei"),
    ("four", "vier"),
    ("five", "fünf", "fuenf"),
    ("six", "sechs"),
    ("seven", "sieben"),
    ("eight", "acht"),
    ("nine", "neun"),
    ("ten", "zehn"),
    ("eleven", "elf"),
    ("twelve", "zwölf", "zwoelf"),
)
_NUMBERS = {word: number for number, words in enumerate(_WORDS) for word in words}
_LARGER = ("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
_POWERS = ("hundred", "thousand", "million", "hundert", "tausend")
_FRACTIONS = ("half", "point", "minus", "halb", "komma")
_PART_OF_ANOTHER = frozenset((*_LARGER, *_POWERS, *_FRACTIONS))
_WORD = re.compile(r"[^\W\d_]+(?:-[^\W\d_]+)*")


def numbers_in_words(text: str) -> list[int]:
    """Return the numbers of the number words in a text, in their order.

    There is none in a text with a word that makes a number word a part of another number, such as
    ``twenty four`` and ``six point five``.
    """
    words = _WORD.findall(text.casefold())
    if not _PART_OF_ANOTHER.isdisjoint(words):
        return []
    return [_NUMBERS[word] for word in words if word in _NUMBERS]
