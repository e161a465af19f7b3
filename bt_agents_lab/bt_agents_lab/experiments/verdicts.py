# SPDX-License-Identifier: Apache-2.0
"""Verdicts on claims, with the runs that were counted for each."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from bt_agents_lab.experiments.measures import Interval, wilson
from bt_agents_lab.experiments.simulated_world import Bools


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Claim of the paper, and the criterion for judging it.

    Attributes:
        section: Section of the paper.
        quote: The sentence of the paper.
        criterion: Property of a run in which the claim holds.
        figures: Numbers of figures that show it.
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
        runs: Number of judged runs; 1 if nothing is random.
        held: Number of runs where it holds.
        unit: Name of the counted items, in the plural.
        interval: Share of runs, with its 95 % interval (Wilson).
        found: The measurements, for people.
        reason: Why it holds only sometimes or not at all; empty if it holds.
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
    """Return the verdict on a claim from one answer per run.

    Args:
        claim: The claim.
        held: For each run, whether it holds.
        found: The measurements, for people.
        reason: Why it does not hold in every run; ignored if it does.
        unit: Name of the counted items.
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
    """Return a share as text, with enough digits to distinguish it from none and all."""
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
    """Return the file name of a figure of the paper, without extension."""
    return f"figure-{number}"


def as_json(verdicts: Iterable[ClaimVerdict]) -> str:
    """Return verdicts as JSON, a list."""
    rows = [{**asdict(verdict), "verdict": verdict.text} for verdict in verdicts]
    return json.dumps(rows, indent=2, ensure_ascii=False) + "\n"
