# SPDX-License-Identifier: Apache-2.0
"""What a replay finds: equal, different, or not recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum


class ReplayVerdict(Enum):
    """What is to be said about one thing that was done again; the value is the word for people."""

    EQUAL = "equal"
    DIFFERENT = "different"
    NOT_RECORDED = "not recorded"


@dataclass(frozen=True, kw_only=True)
class ReplayFinding:
    """One thing that was done again.

    Attributes:
        kind: What it is: ``decision``, ``profile change``, ``run of a tree``.
        where: Which one, in words.
        verdict: How it went.
        words: The first difference, or what is missing; empty when equal.
        size: Of how many parts it is made, ticks for example.
    """

    kind: str
    where: str
    verdict: ReplayVerdict
    words: str = ""
    size: int = 1


@dataclass(kw_only=True)
class FindingCounts:
    """Findings counted.

    Attributes:
        counts: Kind and verdict → number.
        sizes: Kind → parts of all that are equal.
        told: Those that are not equal, in order.
    """

    counts: Counter[tuple[str, ReplayVerdict]] = field(default_factory=Counter)
    sizes: Counter[str] = field(default_factory=Counter)
    told: list[ReplayFinding] = field(default_factory=list)

    @property
    def different(self) -> int:
        """How many are different."""
        return sum(
            n for (_, verdict), n in self.counts.items() if verdict is ReplayVerdict.DIFFERENT
        )


def tally(findings: Iterable[ReplayFinding]) -> FindingCounts:
    """Count findings."""
    counted = FindingCounts()
    for finding in findings:
        counted.counts[finding.kind, finding.verdict] += 1
        if finding.verdict is ReplayVerdict.EQUAL:
            counted.sizes[finding.kind] += finding.size
        else:
            counted.told.append(finding)
    return counted
