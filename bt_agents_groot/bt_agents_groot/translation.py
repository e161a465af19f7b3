# SPDX-License-Identifier: Apache-2.0
"""Remarks of a translation about differences and losses in the new file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from bt_agents_core.diagnostic import Position


class RemarkLevel(Enum):
    """Severity of a remark; the value is its prefix in texts."""

    LOST = "not translated"
    NOTE = "note"


@dataclass(frozen=True, kw_only=True)
class Remark:
    """Difference or loss at a place in the source file."""

    level: RemarkLevel
    position: Position
    message: str

    def __str__(self) -> str:
        return f"{self.position}: {self.comment}"

    @property
    def comment(self) -> str:
        """Text of the remark, for a comment in the translated file."""
        return f"{self.level.value}: {self.message}"


class Remarks:
    """Collection of remarks; the same remark at the same place counts once."""

    def __init__(self) -> None:
        self._remarks: dict[Remark, None] = {}

    def __iter__(self) -> Iterator[Remark]:
        return iter(sorted(self._remarks, key=lambda r: (r.position.line, r.position.column)))

    def lost(self, position: Position, message: str) -> Remark:
        """Add and return a remark on a loss."""
        return self._add(Remark(level=RemarkLevel.LOST, position=position, message=message))

    def note(self, position: Position, message: str) -> Remark:
        """Add and return a remark on a difference."""
        return self._add(Remark(level=RemarkLevel.NOTE, position=position, message=message))

    def _add(self, remark: Remark) -> Remark:
        self._remarks.setdefault(remark)
        return remark
