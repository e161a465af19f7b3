# SPDX-License-Identifier: Apache-2.0
"""Shows the figures of benchmarks as tables, in a terminal and in a page of the documentation.

``python benchmarks/figures.py build/benchmarks.json docs/performance.md`` writes into the page.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import click
from rich import box
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from measuring import Row

BEGIN = "<!-- figures: benchmarks/figures.py writes what is between these lines -->"
END = "<!-- end of figures -->"

COLUMNS = ("who", "median", "least … most", "beside", "ratio", "least … most", "goal")

BAR = "\\|"
"""A bar inside a cell in Markdown."""

_WRAPPED = ("who", "beside")


def as_json(row: Row) -> dict[str, Any]:
    """Return a row as plain data, including derived values."""
    return {
        **asdict(row),
        "ratio": row.ratio,
        "ratios": row.ratios if row.floor_values else [],
        "met": row.is_met,
    }


def from_json(kept: dict[str, Any]) -> Row:
    """Return the row of stored plain data."""
    return Row(**{one.name: kept[one.name] for one in fields(Row)})


def cells(row: Row) -> tuple[str, ...]:
    """Return the texts of a row's cells, one per :data:`COLUMNS`."""
    goal = ""
    if row.is_met is not None:
        goal = f"{_bound(row)} {'met' if row.is_met else 'missed'}"
    median, between = _spread(row.values, row.unit)
    if row.ratio is None:
        return row.side, median, between, row.floor, "", "", goal
    return (
        row.side,
        median,
        between,
        f"{row.floor} {_spread(row.floor_values, row.unit)[0]}",
        _number(row.ratio),
        _between(row.ratios, "{:.2g}"),
        goal,
    )


def table(title: str, rows: Sequence[Row]) -> RenderableType:
    """Return text for a terminal: the rows under their cases, then all notes."""
    shown = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, title_style="bold")
    for column in COLUMNS:
        shown.add_column(column, no_wrap=column not in _WRAPPED)
    notes: list[str] = []
    before = ""
    for row in rows:
        if _case(row) != before:
            before = _case(row)
            shown.add_row(f"[bold]{escape(before)}[/]")
        who, *others = (escape(cell) for cell in cells(row))
        if row.is_met is False:
            others[-1] = f"[bold red]{others[-1]}[/]"
        shown.add_row(f"  {who}{_mark(row, notes)}", *others)
    below = [
        Padding(Text(f"{number}) {note}", style="dim"), (0, 2))
        for number, note in enumerate(notes, 1)
    ]
    return Group(shown, *below)


def markdown(rows: Iterable[Row]) -> str:
    """Return the rows as a Markdown table, followed by their notes."""
    lines = [f"| what | {' | '.join(COLUMNS)} |", "|---" * (len(COLUMNS) + 1) + "|"]
    notes: list[str] = []
    before = ""
    for row in rows:
        repeated, before = _case(row) == before, _case(row)
        who, *others = cells(row)
        if row.is_met is False:
            others[-1] = f"**{others[-1]}**"
        found = ("" if repeated else before, f"{who}{_mark(row, notes)}", *others)
        lines.append(f"| {' | '.join(cell.replace('|', BAR) for cell in found)} |")
    if notes:
        lines += ["", *(f"{number}) {note}  " for number, note in enumerate(notes, 1))]
        lines[-1] = lines[-1].rstrip()
    return "\n".join(lines) + "\n"


def summary(figures: dict[str, Any]) -> str:
    """Return how many goals are met."""
    met = [from_json(row).is_met for kept in figures.values() for row in kept["rows"]]
    goals = [one for one in met if one is not None]
    return f"**{sum(goals)} of {len(goals)} goals are met.** Missed ones are bold.\n"


def section(name: str, kept: dict[str, Any]) -> str:
    """Return the section of a page for one benchmark."""
    machine = kept["machine"]
    on = (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['system']}, Python "
        f"{machine['python']}, load before {machine['load']}"
    )
    rows = [from_json(row) for row in kept["rows"]]
    missed = sum(row.is_met is False for row in rows)
    goals = sum(row.is_met is not None for row in rows)
    verdict = f"{goals - missed} of {goals} goals met" if goals else "no goals"
    return (
        f"### `{name}`: {kept['what']}\n\n"
        f"{verdict}; {kept['measured'][:10]}, {on}.\n\n{markdown(rows)}"
    )


def put_into(page: str, figures: dict[str, Any]) -> str:
    """Return a page with these figures between the marks.

    Raises:
        ValueError: A mark is missing, or the figures are of a short measurement and mean nothing.
    """
    short = [name for name, kept in figures.items() if kept["short"]]
    if short:
        raise ValueError(f"measured with --short: {', '.join(short)}")
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError("the page has no place for figures")
    sections = "\n".join(section(name, kept) for name, kept in figures.items())
    return f"{head}{BEGIN}\n\n{summary(figures)}\n{sections}\n{END}{tail}"


def _mark(row: Row, notes: list[str]) -> str:
    """Return the number of a row's note after a space; empty without a note."""
    if not row.note:
        return ""
    if row.note not in notes:
        notes.append(row.note)
    return f" {notes.index(row.note) + 1})"


def _case(row: Row) -> str:
    return f"{row.case}, {row.pace}" if row.pace else row.case


def _spread(values: Sequence[float], unit: str) -> tuple[str, str]:
    """Return the median with its unit, and the range of the values in the same unit."""
    median = statistics.median(values)
    factor, word = _scale(median, unit)
    between = _between([value * factor for value in values], "{:.3g}")
    return f"{_number(median * factor)} {word}".rstrip(), between


def _between(values: Iterable[float], form: str) -> str:
    values = list(values)
    return f"{_number(min(values), form)} … {_number(max(values), form)}"


def _scale(median: float, unit: str) -> tuple[float, str]:
    """Return the factor that makes a value readable, and the unit that goes with it."""
    if unit != "s":
        return 1.0, unit
    for factor, word in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if abs(median) * factor >= 1:
            return factor, word
    return 1e9, "ns"


def _number(value: float, form: str = "{:.3g}") -> str:
    """Return a number with few digits and without an exponent."""
    return f"{value:,.0f}" if abs(value) >= 100 else form.format(value)


def _bound(row: Row) -> str:
    return f"{'≥' if row.at_least else '≤'} {row.goal:g}"


@click.command()
@click.argument("figures", type=click.Path(path_type=Path, exists=True))
@click.argument("page", type=click.Path(path_type=Path, exists=True))
def main(figures: Path, page: Path) -> None:
    """Put FIGURES, the JSON of benchmarks, into a PAGE in Markdown."""
    kept = json.loads(figures.read_text(encoding="utf-8"))
    text = put_into(page.read_text(encoding="utf-8"), kept)
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
