# SPDX-License-Identifier: Apache-2.0
"""Tables of commands: for people in any width without cuts, or as JSON or CSV."""

from __future__ import annotations

import csv
import functools
import io
import json
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import click
from rich.cells import cell_len

from bt_agents_core.scene import finite_or_none
from bt_agents_core.text import printable

_GAP = "  "
_INDENT = " " * 4
_BETWEEN = " · "


class TableForm(Enum):
    """Output form of a table."""

    FITTED = auto()
    WIDE = auto()
    JSON = auto()
    CSV = auto()

    @property
    def for_program(self) -> bool:
        """Whether a program reads the table, so that messages for people go to standard error."""
        return self in (TableForm.JSON, TableForm.CSV)


@dataclass(frozen=True, kw_only=True)
class Column:
    """Column of a table; the most important columns come first.

    Attributes:
        key: Its name in JSON and CSV.
        title: Its heading for people.
        text: Returns a value for people.
        right: True for numbers.
    """

    key: str
    title: str = ""
    text: Callable[[Any], str] = str
    right: bool = False

    @property
    def heading(self) -> str:
        """Heading for people: its title, else its key."""
        return self.title or self.key

    def cell(self, value: Any) -> str:
        """Return a value in one line that is safe for a terminal; an empty text for None."""
        return "" if value is None else printable(self.text(value))


def table_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options for the form of its table, as its argument ``form``."""

    @click.option("--wide", is_flag=True, help="One line a row, however long.")
    @click.option("--json", "as_json", is_flag=True, help="As JSON.")
    @click.option("--csv", "as_csv", is_flag=True, help="As CSV.")
    @functools.wraps(command)
    def with_form(*args: Any, wide: bool, as_json: bool, as_csv: bool, **values: Any) -> None:
        asked = {"--wide": wide, "--json": as_json, "--csv": as_csv}
        given = [name for name, on in asked.items() if on]
        if len(given) > 1:
            raise click.UsageError(f"{given[0]} and {given[1]} do not go together")
        forms = {"--wide": TableForm.WIDE, "--json": TableForm.JSON, "--csv": TableForm.CSV}
        command(*args, form=forms[given[0]] if given else TableForm.FITTED, **values)

    return with_form


def print_table(
    columns: Sequence[Column], rows: Sequence[Sequence[Any]], form: TableForm = TableForm.FITTED
) -> None:
    """Print a table: fitted to a terminal, or one line per row for a file or pipe."""
    if form is TableForm.JSON:
        keys = [column.key for column in columns]
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    elif form is TableForm.CSV:
        click.echo(as_csv(columns, rows), nl=False)
    else:
        fitted = form is TableForm.FITTED and sys.stdout.isatty()
        width = _terminal_width() if fitted else None
        for number, line in enumerate(table_lines(columns, rows, width) if rows else ()):
            click.secho(line, bold=True if number == 0 else None)


def print_json(document: Any) -> None:
    """Print plain data as JSON that is valid in every encoding; null for NaN and infinity."""
    click.echo(json.dumps(_finite(document), indent=2, allow_nan=False))


def as_csv(columns: Sequence[Column], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table as CSV with a header of keys and unformatted values."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(column.key for column in columns)
    writer.writerows(rows)
    return text.getvalue()


def table_lines(
    columns: Sequence[Column], rows: Sequence[Sequence[Any]], width: int | None
) -> Iterator[str]:
    """Yield heading and rows for people.

    Columns beyond the width are below each row, each cell after its heading.
    """
    headings = [column.heading for column in columns]
    cells = [[c.cell(value) for c, value in zip(columns, row, strict=True)] for row in rows]
    sizes = [max(map(cell_len, column)) for column in zip(headings, *cells, strict=True)]
    beside = _fitting(sizes, width)
    for row in (headings, *cells):
        line = _line(columns[:beside], row[:beside], sizes)
        if width is None or cell_len(line) <= width:
            yield line
        else:
            yield from _wrapped(line, width, "")
        more = zip(headings[beside:], row[beside:], strict=True)
        below = _BETWEEN.join(f"{heading} {cell}" for heading, cell in more if cell)
        if width is not None and row is not headings:
            yield from _wrapped(below, width, _INDENT)


def _wrapped(text: str, width: int, indent: str) -> list[str]:
    """Return a text in lines of a width, broken at blanks only; all but the first are indented."""
    return textwrap.wrap(
        text,
        width,
        initial_indent=indent,
        subsequent_indent=_INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _terminal_width() -> int:
    """Return the width in COLUMNS, at most the terminal's."""
    asked = shutil.get_terminal_size().columns
    try:
        return min(asked, os.get_terminal_size(sys.stdout.fileno()).columns or asked)
    except OSError:
        return asked


def _fitting(sizes: Sequence[int], width: int | None) -> int:
    """Return how many columns fit next to each other: at least one, all without a width."""
    if width is None:
        return len(sizes)
    used = 0
    for count, size in enumerate(sizes):
        used += size + (len(_GAP) if count else 0)
        if count and used > width:
            return count
    return len(sizes)


def _line(columns: Sequence[Column], row: Sequence[str], sizes: Sequence[int]) -> str:
    parts = []
    for column, cell, size in zip(columns, row, sizes, strict=False):
        blanks = " " * (size - cell_len(cell))
        parts.append(blanks + cell if column.right else cell + blanks)
    return _GAP.join(parts).rstrip()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return finite_or_none(value)
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return value
