# SPDX-License-Identifier: Apache-2.0
"""Block scalars moved to another indentation with their line breaks as they are."""

from __future__ import annotations

import re

_ESCAPED_SPACE = re.compile(r"(?<!\\)[ \t]+$")


def reindented(written: str, indent: int) -> list[str]:
    """Return the lines of a plain or quoted text, all but the first indented.

    Args:
        written: The text as it stands in the file, its quotes included.
        indent: Spaces before every line but the first.
    """
    first, *others = written.split("\n")
    strip = _without_space if written.startswith('"') else str.rstrip
    lines = [strip(first)]
    for number, other in enumerate(others, start=2):
        line = other.lstrip(" \t")
        line = line if number > len(others) else strip(line)
        lines.append(" " * indent + line if line else "")
    return lines


def reindented_block(written: str, text: str, indent: int, parent: int) -> list[str] | None:
    """Return the lines of a text block (``|`` or ``>``), the line with the sign first.

    Args:
        written: The block as it stands in the file.
        text: What it says.
        indent: Spaces before every line but the first.
        parent: Indentation of the list or mapping that it stands in.

    Returns:
        The lines, or None when the block holds only blank lines, which quotes show better.
    """
    if not text.strip(" \n"):
        return None
    lines = written.split("\n")[1:]
    first = next(line for line in lines if line.strip(" "))
    # What the text keeps of the indentation of its first line does not count as indentation.
    start = len(text) - len(text.lstrip(" \n"))
    kept = start - (text.rfind("\n", 0, start) + 1)
    base = len(first) - len(first.lstrip(" ")) - kept
    content = [line[base:] for line in lines]
    while not content[-1]:
        content.pop()
    ends = len(text) - len(text.rstrip("\n"))
    chomping = "-" if ends == 0 else "" if ends == 1 else "+"
    shown = next(line for line in content if line)
    indicator = str(indent - parent) if shown[0] in " \t" else ""
    return [
        f"{written[0]}{indicator}{chomping}",
        *(" " * indent + line if line else "" for line in content),
        *[""] * (ends - 1),
    ]


def _without_space(line: str) -> str:
    """Return a line of a double-quoted text without the spaces at its end that mean nothing."""
    return _ESCAPED_SPACE.sub("", line)
