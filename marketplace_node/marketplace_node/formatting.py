# SPDX-License-Identifier: Apache-2.0
"""Formatting of numbers, lists and foreign texts for people."""

from __future__ import annotations

from bt_agents_core.text import DIGITS, ellipsize, format_number, printable_line

ALL_DIGITS = 6
"""Digits of all other numbers."""

FEW = DIGITS
"""Digits of numbers of which more would tell people nothing, as where chance is part of them."""

_LONGEST_LINE = 300  # characters


def distance(value: float, digits: int = ALL_DIGITS) -> str:
    """Return a number that shows that it is no count: ``2.0``."""
    text = format_number(value, digits)
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
    return ellipsize(printable_line(text), _LONGEST_LINE)
