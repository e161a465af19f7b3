# SPDX-License-Identifier: Apache-2.0
"""What a translation could not say the same way, for the terminal and for comments in the file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from bt_agents_core.diagnostic import Position


class RemarkLevel(Enum):
    """How much a remark matters; the value is the word before it."""

    LOST = "not translated"
    NOTE = "note"


@dataclass(frozen=True, kw_only=True)
class Remark:
    """One remark about a place in the file that was translated."""

    weight: RemarkLevel
    position: Position
    message: str

    def __str__(self) -> str:
        return f"{self.position}: {self.weight.value}: {self.message}"

    @property
    def comment(self) -> str:
        """The remark as it stands in the file that was made."""
        return f"{self.weight.value}: {self.message}"


class Remarks:
    """Collects remarks; the same one at the same place counts once."""

    def __init__(self) -> None:
        self._remarks: dict[Remark, None] = {}

    def __iter__(self) -> Iterator[Remark]:
        return iter(sorted(self._remarks, key=lambda r: (r.position.line, r.position.column)))

    def add(self, weight: RemarkLevel, position: Position, message: str) -> Remark:
        """Add a remark and return it."""
        remark = Remark(weight=weight, position=position, message=message)
        self._remarks.setdefault(remark)
        return remark
