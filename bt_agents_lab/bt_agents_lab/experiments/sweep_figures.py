# SPDX-License-Identifier: Apache-2.0
"""Results of a sweep: figures, a table, and files for other programs."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bt_agents_core.feedback import LearningRule
from bt_agents_lab.experiments.drawing import COLOURS, sheet, smooth, writing_into
from bt_agents_lab.experiments.measures import LAST, Measures, PerRun, summary
from bt_agents_lab.experiments.simulated_world import Selection
from bt_agents_lab.experiments.sweep import Cell, SweepSpec, rule_label
from bt_agents_lab.experiments.verdicts import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Played = Sequence[tuple[Cell, PerRun]]

HEADINGS = {
    "wrong": "wrong feedback",
    "right": f"right, last {LAST} rounds",
    "worst": "right, worst run",
    "starved": "runs with a starved agent",
    "never": "runs where one never ran",
    "regret": "regret",
    "settles": "rounds to converge",
    "cancelled": "scenes with a cancelled run",
    "error": "profile error",
}
"""Columns of a table of results."""

WINDOW = 10
"""Number of rounds over which a learning curve is averaged."""

_THICKEST, _THINNEST = 3.0, 0.9
"""Widths of the first and the last line [points]."""

_DASHES = ("-", "--", ":", "-.")
_STAR: Mapping[str, Any] = {"marker": "*", "markersize": 14.0, "markeredgecolor": "black"}
_CURVE_SHARE = 0.2
"""Learning curves show the share of wrong feedback closest to this one."""


def write(folder: Path, spec: SweepSpec, played: Played) -> None:
    """Write results.csv, results.json, table.md and all figures.

    Raises:
        BtAgentsError: A file cannot be written, or matplotlib is not installed.
    """
    with writing_into(folder):
        _csv(folder / "results.csv", played)
        (folder / "results.json").write_text(_json(spec, played), encoding="utf-8")
        (folder / "table.md").write_text(table(spec, played), encoding="utf-8")
    curves(folder, spec, played)
    robustness(folder, spec, played)


def best_cells(played: Played) -> tuple[Cell, ...]:
    """Return the best cell for each share of wrong feedback.

    It starves the fewest agents, then is right most often, then has the least regret.
    """
    by_share: dict[float, list[tuple[Cell, Measures]]] = {}
    for cell, runs in played:
        by_share.setdefault(cell.share, []).append((cell, summary(runs)))

    def quality(one: tuple[Cell, Measures]) -> tuple[float, float, float]:
        found = one[1]
        return found.starved.share, -found.accuracy, found.regret

    return tuple(min(cells, key=quality)[0] for cells in by_share.values())


def table(spec: SweepSpec, played: Played) -> str:
    """Return the results as a Markdown table."""
    head = ("strategy", "update", *HEADINGS.values())
    lines = [
        f"{spec.title}: {spec.runs} runs of {spec.rounds} rounds a row, seeds {spec.seed} to "
        f"{spec.seed + spec.runs - 1}. Bold is the best for its share of wrong feedback.",
        "",
        f"| {' | '.join(head)} |",
        f"|{'---|' * len(head)}",
    ]
    best = best_cells(played)
    for cell, runs in played:
        label = cell.selection.label
        row = (
            f"**{label}**" if cell in best else label,
            rule_label(cell.learning),
            *cells(cell, summary(runs)).values(),
        )
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines) + "\n"


def cells(cell: Cell, found: Measures) -> dict[str, str]:
    """Return the share of wrong feedback and the measures as text, by keys of :data:`HEADINGS`."""
    return {
        "wrong": f"{cell.share:.0%}",
        "right": f"{found.accuracy:.2%}",
        "worst": f"{found.worst:.0%}",
        "starved": f"{found.starved.share:.1%}",
        "never": f"{found.never.share:.1%}",
        "regret": f"{found.regret:.0f}",
        "settles": "never" if math.isinf(found.cycles) else f"{found.cycles:.0f}",
        "cancelled": f"{found.cancelled:.1%}",
        "error": f"{found.error:.2f}",
    }


def curves(folder: Path, spec: SweepSpec, played: Played) -> None:
    """Draw the growth of the share of right selections, one panel per learning rule."""
    share = min(spec.shares, key=lambda one: abs(one - _CURVE_SHARE))
    columns = len(spec.learnings)
    with sheet(folder, "curves", (3.2 * columns + 0.4, 4.2), columns=columns) as (figure, panels):
        for axes, learning in zip(panels, spec.learnings, strict=True):
            for selection, line in zip(spec.selections, _lines(spec.selections), strict=True):
                runs = _of(played, selection, learning, share)
                right = smooth(runs.right / len(runs.late), WINDOW)
                axes.plot(np.arange(1, len(right) + 1), right, **line)
            axes.set_title(rule_label(learning))
            axes.set_xlabel("round")
            axes.set_xlim(0, spec.rounds)
            axes.set_ylim(0.0, 1.02)
        panels[0].set_ylabel("right selections (share of runs)")
        _legend(figure, panels[0], columns)
        figure.suptitle(
            f"{spec.title}: {percent(share)} wrong feedback, {spec.runs} runs, mean of {WINDOW} "
            "rounds",
            fontsize=10,
        )


def robustness(folder: Path, spec: SweepSpec, played: Played) -> None:
    """Draw the final right selections and the starvation over the share of wrong feedback."""
    columns = len(spec.learnings)
    size = (3.2 * columns + 0.4, 6.4)
    least = 100.0 * min(float(runs.late.mean()) for _, runs in played)
    best = best_cells(played)
    with sheet(folder, "robustness", size, rows=2, columns=columns) as (figure, panels):
        for column, learning in enumerate(spec.learnings):
            upper, lower = panels[column], panels[columns + column]
            for selection, line in zip(spec.selections, _lines(spec.selections), strict=True):
                found = [summary(_of(played, selection, learning, one)) for one in spec.shares]
                wrong = [100.0 * one for one in spec.shares]
                upper.plot(wrong, [100.0 * one.accuracy for one in found], marker=".", **line)
                for share, one in zip(spec.shares, found, strict=True):
                    if Cell(selection=selection, learning=learning, share=share) in best:
                        upper.plot(
                            100.0 * share, 100.0 * one.accuracy, color=line["color"], **_STAR
                        )
                starved = [(one.starved.share, one.starved.low, one.starved.high) for one in found]
                share, low, high = 100.0 * np.array(starved).T
                lower.plot(wrong, share, marker=".", **line)
                lower.fill_between(wrong, low, high, color=line["color"], alpha=0.12, linewidth=0)
            upper.set_title(rule_label(learning))
            upper.set_ylim(least - 2.0, 101.0)
            lower.set_ylim(-2, 102)
            lower.set_xlabel("wrong feedback [%]")
        panels[0].set_ylabel(f"right selections, last {LAST} rounds [%]")
        panels[columns].set_ylabel("runs with a starved agent [%]")
        _legend(figure, panels[0], columns)
        figure.suptitle(
            f"{spec.title}: {spec.runs} runs of {spec.rounds} rounds; bands: 95 % intervals; "
            "stars: best for that share of wrong feedback",
            fontsize=10,
        )


def _lines(selections: Sequence[Selection]) -> list[dict[str, Any]]:
    """Return the style of each line: a colour per strategy, dashes for its other options.

    Each line is thinner than the previous one, which stays visible on both sides if they are
    equal.
    """
    families = list(dict.fromkeys(one.strategy for one in selections))
    counts = dict.fromkeys(families, 0)
    widths = np.linspace(_THICKEST, _THINNEST, len(selections)).tolist()
    lines = []
    for one, width in zip(selections, widths, strict=True):
        lines.append(
            {
                "color": COLOURS[families.index(one.strategy) % len(COLOURS)],
                "linestyle": _DASHES[counts[one.strategy] % len(_DASHES)],
                "label": one.label,
                "linewidth": width,
                "markersize": 2.0 + 2.0 * width,
            }
        )
        counts[one.strategy] += 1
    return lines


def _legend(figure: Figure, axes: Axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="lower center", ncols=max(columns, 2))
    # Versions before 3.7, such as Ubuntu's, know no location "outside".
    top = legend.get_window_extent().y1 / figure.bbox.height
    figure.set_layout_engine("constrained", rect=(0.0, top, 1.0, 1.0 - top))


def _of(played: Played, selection: Selection, learning: LearningRule, share: float) -> PerRun:
    wanted = Cell(selection=selection, learning=learning, share=share)
    return next(runs for cell, runs in played if cell == wanted)


def _csv(path: Path, played: Played) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        best = best_cells(played)
        rows = [measured(cell, summary(runs), cell in best) for cell, runs in played]
        writer.writerow(rows[0])
        writer.writerows(row.values() for row in rows)


def measured(cell: Cell, found: Measures, best: bool) -> dict[str, object]:
    """Return a cell with its measures as numbers, flat, by the columns of results.csv.

    ``best`` states whether it is one of :func:`best_cells`.
    """
    values = asdict(found)
    flat: dict[str, object] = {
        "strategy": cell.selection.label,
        "update": rule_label(cell.learning),
        "wrong_share": cell.share,
        "best": best,
    }
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= {f"{name}_{part}": number for part, number in value.items()}
        else:
            flat[name] = value if math.isfinite(value) else None
    return flat


def _json(spec: SweepSpec, played: Played) -> str:
    best = best_cells(played)
    rows = [
        {**measured(cell, summary(runs), cell in best), "right_by_round": runs.right.tolist()}
        for cell, runs in played
    ]
    document = {
        "title": spec.title,
        "runs": spec.runs,
        "rounds": spec.rounds,
        "seed": spec.seed,
        "agents": spec.world.agents,
        "parameters": spec.world.space.names,
        "cells": rows,
    }
    return json.dumps(document, indent=1) + "\n"
