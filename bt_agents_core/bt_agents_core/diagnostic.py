# SPDX-License-Identifier: Apache-2.0
"""Problems of files as data: code, place, message and hint."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple


class Position(NamedTuple):
    """Position in a file; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


class Severity(Enum):
    """Severity of a problem; the value is its name in a report."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, kw_only=True)
class Diagnostic:
    """One problem of a file.

    Attributes:
        code: Key of the table of codes.
        position: First character of what is wrong.
        end: The character after its last one; None marks one character.
        message: What was found and what is expected.
        hint: How to mend it; may be empty.
        severity: A file with a warning can be used, one with an error cannot.
        excerpt: The line of ``position``; empty when it is not known.
        inserted: Places that insert the text that is wrong; empty for what no other file inserts.
    """

    code: str
    position: Position
    message: str
    hint: str = ""
    end: Position | None = None
    severity: Severity = Severity.ERROR
    excerpt: str = field(default="", compare=False, repr=False)
    inserted: tuple[str, ...] = ()
