# SPDX-License-Identifier: Apache-2.0
"""Style of a scalar: plain where that is safe, else quoted."""

from __future__ import annotations

import json
import re

from bt_agents_language.yaml.yaml_reader import Node, Scalar

_ESCAPED_SPACE = re.compile(r"(?<!\\)[ \t]+$")
_WORDS = re.compile(r"[^\W\d_][\w/-]*(?:[ .][\w/-]+)*")
_REFERENCE = re.compile(r"\$\{[\w.]+\}")
_TRAPS = frozenset(
    ("true", "false", "null", "yes", "no", "on", "off", "y", "n", "nan", "inf", "infinity")
)


def quoted(text: str) -> str:
    """Return a text in quotes, in one line: double ones unless they would need a backslash."""
    if text.isprintable():
        if '"' not in text and "\\" not in text:
            return f'"{text}"'
        if "'" not in text:
            return f"'{text}'"
    return json.dumps(text, ensure_ascii=False)


def in_one_line(scalar: Scalar, written: str, *, flow: bool, keep_quotes: bool = False) -> str:
    """Return a value as it is to be written in one line, ``flow`` inside of ``{}`` or ``[]``.

    Quotes are dropped only around a few words and, outside of ``{}`` and ``[]``, around
    ``${name}``: there nobody can take the text for anything else. Numbers, times and the words
    that other programs take for true or false keep what they have. A question gets quotes.
    """
    if scalar.style == "":
        return quoted(scalar.text) if "?" in scalar.text else scalar.text
    if not keep_quotes and droppable(scalar, flow=flow):
        return scalar.text
    return _in_quotes(scalar, written)


def key_in_one_line(key: Scalar, written: str) -> str:
    """Return a key as it is to be written."""
    if key.style == "" and "\n" not in written:
        return key.text
    return key.text if droppable(key, flow=True) else _in_quotes(key, written)


def droppable(scalar: Scalar, *, flow: bool) -> bool:
    """Return whether a text says the same without its quotes, to people and to programs."""
    text = scalar.text
    if _WORDS.fullmatch(text):
        return text.lower() not in _TRAPS
    return not flow and _REFERENCE.fullmatch(text) is not None


def fits_one_line(scalar: Scalar, written: str) -> bool:
    """Return whether a value can be written in one line without changing how it looks."""
    return scalar.style not in ("|", ">") and not ("\n" in written and "\n" in scalar.text)


def needs_quotes(items: tuple[Node, ...], *, flow: bool) -> bool:
    """Return whether one item of a list needs its quotes, so that the others keep theirs too."""
    return any(
        isinstance(item, Scalar) and item.style in ("'", '"') and not droppable(item, flow=flow)
        for item in items
    )


def _in_quotes(scalar: Scalar, written: str) -> str:
    """Return a text in quotes; escapes that the author wrote stay."""
    if scalar.style == '"' and "\n" not in written:
        return written
    return quoted(scalar.text)


def reindented(written: str, indent: int) -> list[str]:
    """Return the lines of a text as it stands in the file, all but the first indented."""

    def strip(line: str) -> str:
        # An escaped space at the end of a line of a double-quoted text is a part of it.
        return _ESCAPED_SPACE.sub("", line) if written.startswith('"') else line.rstrip()

    first, *others = written.split("\n")
    lines = [strip(first)]
    for number, other in enumerate(others, start=2):
        line = other.lstrip(" \t")
        line = line if number > len(others) else strip(line)
        lines.append(" " * indent + line if line else "")
    return lines


def reindented_block(written: str, text: str, indent: int, parent: int) -> list[str] | None:
    """Return the lines of a text block (``|`` or ``>``), the line with the sign first.

    The lines behind it are indented by so many spaces, ``parent`` of which are those of the list
    or mapping around the block. None for a block of blank lines, which quotes show better.
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
    first_shown = next(line for line in content if line)
    indicator = str(indent - parent) if first_shown[0] in " \t" else ""
    return [
        f"{written[0]}{indicator}{chomping}",
        *(" " * indent + line if line else "" for line in content),
        *[""] * (ends - 1),
    ]
