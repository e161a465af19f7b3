# SPDX-License-Identifier: Apache-2.0
"""Assignment arguments of commands: ``name=number``."""

from __future__ import annotations

import math

import click

Assignments = tuple[tuple[str, float], ...]


def assignments(
    _context: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> Assignments:
    """Return ``name=number`` arguments as names and numbers; a click callback.

    Raises:
        click.BadParameter: An argument does not have that form.
    """
    found = []
    for text in texts:
        name, equals, number = text.partition("=")
        try:
            value = float(number if equals and name else "")
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise click.BadParameter(
                f"'{text}' is not of the form name=number, for example age=4.5"
            )
        found.append((name, value))
    return tuple(found)


def columns(values: Assignments) -> tuple[list[str], list[float]]:
    """Return the names and numbers of assignments as two lists."""
    return [name for name, _ in values], [value for _, value in values]
