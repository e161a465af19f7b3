# SPDX-License-Identifier: Apache-2.0
"""What the table of codes says about one code, and how its examples are written."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from enum import Enum


class Severity(Enum):
    """How bad a problem is; the value is the word in a report."""

    ERROR = "error"
    WARNING = "warning"


class FileKind(Enum):
    """What the examples of a code are; the value says it to people."""

    AGENT = "part of an agent file"
    SKILLS = "a skills file"
    SCENE = "a scene file"
    SCRIPT = "a script"
    TEST = "part of a test file"
    FOLDER = "files of a trees folder"
    XML = "a file of Groot2"
    PACKAGE = "the pyproject.toml of a Python package"

    @property
    def language(self) -> str:
        """What the examples are written in, as Markdown and highlighters name it."""
        return {FileKind.XML: "xml", FileKind.PACKAGE: "toml"}.get(self, "yaml")


@dataclass(frozen=True, kw_only=True)
class Code:
    """One code.

    Attributes:
        code: Its name in reports.
        meaning: One sentence.
        wrong: The smallest file with this problem as its first; see :func:`written`.
        right: The same file without it.
        kind: What the examples are. Of an agent or test file they show only what matters; of a
            folder each file comes below a line ``# path``.
        severity: A file with a warning can be used, one with an error cannot.
    """

    code: str
    meaning: str
    wrong: str
    right: str
    kind: FileKind
    severity: Severity


def error(
    code: str, meaning: str, wrong: str, right: str, kind: FileKind = FileKind.AGENT
) -> Code:
    """Return an entry of the table; the examples may be indented as a whole."""
    return _entry(code, meaning, wrong, right, kind, Severity.ERROR)


def warning(
    code: str, meaning: str, wrong: str, right: str, kind: FileKind = FileKind.AGENT
) -> Code:
    """Return an entry of the table for what is legal but dangerous; as :func:`error`."""
    return _entry(code, meaning, wrong, right, kind, Severity.WARNING)


def _entry(
    code: str, meaning: str, wrong: str, right: str, kind: FileKind, severity: Severity
) -> Code:
    return Code(
        code=code,
        meaning=meaning,
        wrong=_text(wrong),
        right=_text(right),
        kind=kind,
        severity=severity,
    )


def _text(example: str) -> str:
    return textwrap.dedent(example).strip("\n") + "\n"


_MARK = re.compile(r"⟨(?:(?P<tab>tab)|U\+(?P<point>[0-9A-F]{4})|byte (?P<byte>[0-9A-F]{2})"
                   r"|(?P<unit>.+?) × (?P<times>[0-9,]+))⟩")  # fmt: skip


def written(example: str) -> bytes:
    """Return an example as it would stand in a file.

    Examples stand for what cannot be seen or is too long by marks: ``⟨tab⟩``, ``⟨U+202E⟩`` for a
    character, ``⟨byte FC⟩``, and ``⟨[] × 1,000⟩`` for so many times the same.
    """
    data = b""
    at = 0
    for mark in _MARK.finditer(example):
        data += example[at : mark.start()].encode() + _marked(mark)
        at = mark.end()
    return data + example[at:].encode()


def _marked(mark: re.Match[str]) -> bytes:
    if mark["tab"]:
        return b"\t"
    if mark["point"]:
        return chr(int(mark["point"], 16)).encode()
    if mark["byte"]:
        return bytes([int(mark["byte"], 16)])
    return mark["unit"].encode() * int(mark["times"].replace(",", ""))
