# SPDX-License-Identifier: Apache-2.0
"""The line around a place in a text."""

from __future__ import annotations

import re

from bt_agents_language.yaml.source import Source

_LINE = re.compile(r"[^\r\n]*")


def line_start(source: Source, index: int) -> int:
    """Return the index of the first character of a line."""
    text = source.text
    return max(text.rfind("\n", 0, index), text.rfind("\r", 0, index)) + 1


def line_at(source: Source, start: int) -> str:
    """Return the line that starts at an index, without its end."""
    match = _LINE.match(source.text, start)
    return match[0] if match is not None else ""


def line_above(source: Source, start: int) -> int | None:
    """Return the start of the last line above that is not empty; None when there is none."""
    end = len(source.text[:start].rstrip())
    return line_start(source, end) if end else None


def end_above(source: Source, index: int) -> int:
    """Return the end of what stands above the line of a character."""
    return len(source.text[: line_start(source, index)].rstrip())


def indentation(line: str) -> int:
    """Return how many characters stand before the first that can be seen."""
    return len(line) - len(line.lstrip())
