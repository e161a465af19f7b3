# SPDX-License-Identifier: Apache-2.0
"""Formatting of numbers, lists and foreign texts for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

ALL_DIGITS = 6
"""Digits of all other numbers."""

FEW = 4
"""Digits of numbers of which more would tell people nothing, as where chance is part of them."""

_NAMES_SHOWN = 4
_LONGEST_LINE = 300  # characters


def listed(items: Iterable[str]) -> str:
    """Return items with commas, the first of many."""
    all_items = list(items)
    if len(all_items) <= _NAMES_SHOWN:
        return ", ".join(all_items)
    return f"{', '.join(all_items[:_NAMES_SHOWN])} and {len(all_items) - _NAMES_SHOWN} more"


def joined(items: Sequence[str]) -> str:
    """Return items as a sentence lists them: ``a, b and c``."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"


@lru_cache(maxsize=4096)
def number(value: float, digits: int = ALL_DIGITS) -> str:
    """Return a number in at most so many digits, with a real minus sign."""
    return f"{value + 0.0:.{digits}g}".replace("-", "−")


def distance(value: float, digits: int = ALL_DIGITS) -> str:
    """Return a number that shows that it is no count: ``2.0``."""
    text = number(value, digits)
    return text if set(text) & set(".e") else f"{text}.0"


def percent(share: float) -> str:
    """Return a share of 1 in percent; what is not all and not nothing is never shown so."""
    if 0.0 < share < 0.01:
        return "less than 1 %"
    if 0.99 < share < 1.0:
        return "more than 99 %"
    return f"{share * 100.0:.0f} %"


def shown(text: str) -> str:
    """Return words from outside as one line that is not too long."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= _LONGEST_LINE else line[: _LONGEST_LINE - 1] + "…"
