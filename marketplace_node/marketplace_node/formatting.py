# SPDX-License-Identifier: Apache-2.0
"""Formats numbers, lists and texts from outside for people."""

from __future__ import annotations

from bt_agents_core.text import DIGITS, ellipsize, format_number, printable_line

ALL_DIGITS = 6
"""Digits of all other numbers."""

FEW = DIGITS
"""Digits of numbers whose further digits mean nothing to people, for example random ones."""

_LONGEST_LINE = 300  # characters


def distance(value: float, digits: int = ALL_DIGITS) -> str:
    """Return a number with a decimal point, so it does not look like a count: ``2.0``."""
    text = format_number(value, digits)
    return text if set(text) & set(".e") else f"{text}.0"


def percent(share: float) -> str:
    """Return a share of 1 in percent; only exactly 0 and 1 become 0 % and 100 %."""
    if 0.0 < share < 0.01:
        return "less than 1 %"
    if 0.99 < share < 1.0:
        return "more than 99 %"
    return f"{share * 100.0:.0f} %"


def shown(text: str) -> str:
    """Return a text from outside as one line of limited length."""
    return ellipsize(printable_line(text), _LONGEST_LINE)
