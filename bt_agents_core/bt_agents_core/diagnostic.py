# SPDX-License-Identifier: Apache-2.0
"""Problems in files as data: code, place, message and hint."""

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
    """Severity of a problem; the value is its name in reports."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, kw_only=True)
class Diagnostic:
    """One problem in a file.

    Attributes:
        code: Key in the table of codes.
        position: First character of the faulty text.
        end: The character after its last one; None marks one character.
        message: What was found and what is expected.
        hint: How to fix it; may be empty.
        severity: A file with a warning can be used, one with an error cannot.
        excerpt: The line of ``position``; empty if unknown.
        inserted: Places that insert the faulty text; empty if no other file inserts it.
    """

    code: str
    position: Position
    message: str
    hint: str = ""
    end: Position | None = None
    severity: Severity = Severity.ERROR
    excerpt: str = field(default="", compare=False, repr=False)
    inserted: tuple[str, ...] = ()
