# SPDX-License-Identifier: Apache-2.0
"""Verdicts on claims, with the runs in which each was counted."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from bt_agents_lab.experiments.measures import Interval, wilson
from marketplace_node.strategies.arrays import Bools


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim of the paper and the criterion by which it is judged.

    Attributes:
        section: Where it stands.
        quote: The sentence of the paper.
        criterion: Property of a run in which the claim holds.
        figures: Numbers of the figures that show it.
    """

    name: str
    section: str
    quote: str
    criterion: str
    figures: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ClaimVerdict:
    """Verdict on a claim.

    Attributes:
        runs: Number of runs that were judged; 1 where nothing is left to chance.
        held: Number of those in which it holds.
        unit: Name of what was counted, in the plural.
        interval: Share of runs and its 95 % interval (Wilson).
        found: The measurements, for people.
        reason: Why it holds only sometimes or not at all; empty when it holds.
    """

    claim: Claim
    runs: int
    held: int
    unit: str
    interval: Interval
    found: str
    reason: str = ""

    @property
    def text(self) -> str:
        """``holds``, ``holds in 66.3 % of runs`` or ``fails``, with the runs."""
        if self.runs == 1:
            return "holds" if self.held else "fails"
        low, high = percent(self.interval.low), percent(self.interval.high)
        counted = f"{self.held} of {self.runs} {self.unit}, 95 % interval {low} to {high}"
        if self.held == self.runs:
            return f"holds ({counted})"
        if not self.held:
            return f"fails ({counted})"
        return f"holds in {percent(self.interval.share)} of {self.unit} ({counted})"


def judged(
    claim: Claim, held: Bools | Sequence[bool], found: str, reason: str = "", unit: str = "runs"
) -> ClaimVerdict:
    """Return the verdict on a claim from one answer a run.

    Args:
        claim: The claim.
        held: For each run whether it holds.
        found: The measurements, for people.
        reason: Why it does not hold in every run; left out when it does.
        unit: What is counted.
    """
    runs, hits = len(held), int(np.count_nonzero(held))
    return ClaimVerdict(
        claim=claim,
        runs=runs,
        held=hits,
        unit=unit,
        interval=wilson(hits, runs),
        found=found,
        reason="" if hits == runs else reason,
    )


def percent(share: float) -> str:
    """Return a share as text, with the digits that distinguish it from none and from all."""
    for digits in (1, 2, 3):
        rounded = round(share * 100, digits)
        if share in (0.0, 1.0) or 0.0 < rounded < 100.0:
            break
    return f"{rounded:.6g} %"


def as_markdown(verdicts: Iterable[ClaimVerdict]) -> str:
    """Return verdicts as a document."""
    lines = ["# What the paper claims, and what holds", ""]
    for verdict in verdicts:
        claim = verdict.claim
        lines += [
            f"## {claim.name}: {verdict.text}",
            "",
            f"> {claim.quote} (section {claim.section})",
            "",
            f"- Judged by: {claim.criterion}",
            f"- Found: {verdict.found}",
        ]
        if verdict.reason:
            lines.append(f"- Why: {verdict.reason}")
        links = (f"[figure {number}]({figure_name(number)}.svg)" for number in claim.figures)
        if claim.figures:
            lines.append(f"- Shown by: {', '.join(links)}")
        lines.append("")
    return "\n".join(lines)


def figure_name(number: int) -> str:
    """Return the name of the files of a figure of the paper, without an ending."""
    return f"figure-{number}"


def as_json(verdicts: Iterable[ClaimVerdict]) -> str:
    """Return verdicts as JSON, a list."""
    rows = [{**asdict(verdict), "verdict": verdict.text} for verdict in verdicts]
    return json.dumps(rows, indent=2, ensure_ascii=False) + "\n"
