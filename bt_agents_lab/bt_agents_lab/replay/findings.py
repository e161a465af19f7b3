# SPDX-License-Identifier: Apache-2.0
"""Findings of a replay: equal, different, or not recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum


class ReplayVerdict(Enum):
    """Outcome of one comparison; the value is its text for people."""

    EQUAL = "equal"
    DIFFERENT = "different"
    NOT_RECORDED = "not recorded"


@dataclass(frozen=True, kw_only=True)
class ReplayFinding:
    """Comparison of one item with its replay.

    Attributes:
        kind: ``decision`` or ``profile change``.
        where: Identification of the item, for people.
        text: The first difference, or the missing part; empty if equal.
    """

    kind: str
    where: str
    verdict: ReplayVerdict
    text: str = ""


def compared(kind: str, where: str, difference: str) -> ReplayFinding:
    """Return the finding of a comparison; an empty difference means equal."""
    verdict = ReplayVerdict.DIFFERENT if difference else ReplayVerdict.EQUAL
    return ReplayFinding(kind=kind, where=where, verdict=verdict, text=difference)


def not_recorded(kind: str, where: str, missing: str) -> ReplayFinding:
    """Return the finding that something is missing for a replay."""
    verdict = ReplayVerdict.NOT_RECORDED
    return ReplayFinding(kind=kind, where=where, verdict=verdict, text=missing)


class FindingCounts:
    """Counts of findings.

    Attributes:
        counts: Kind and verdict → number.
        unequal: Findings that are not equal, in order.
    """

    def __init__(self, findings: Iterable[ReplayFinding]) -> None:
        self.counts: Counter[tuple[str, ReplayVerdict]] = Counter()
        self.unequal: list[ReplayFinding] = []
        for finding in findings:
            self.counts[finding.kind, finding.verdict] += 1
            if finding.verdict is not ReplayVerdict.EQUAL:
                self.unequal.append(finding)

    @property
    def different(self) -> int:
        """Number of findings of differences."""
        return sum(one.verdict is ReplayVerdict.DIFFERENT for one in self.unequal)
