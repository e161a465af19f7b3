# SPDX-License-Identifier: Apache-2.0
"""Table of tunable parameters that fits the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from bt_agents.host.tuning.tunable import TunableKind, shown_value
from bt_agents_core.text import ellipsize

if TYPE_CHECKING:
    from bt_agents_tools.client.write_back import ParameterState

_MAX_COLUMN = 22
_GAP = "  "
_MIN_DESCRIPTION = 28
"""Fewest columns for a description next to its row; with fewer it gets its own lines."""

_INDENT = " " * 6


def table(states: Iterable[ParameterState], width: int) -> Iterator[str]:
    """Yield the lines of the table: the parameters of the host, then of each agent."""
    ordered = sorted(
        states, key=lambda one: (one.parameter.agent, one.parameter.kind is TunableKind.PROFILE)
    )
    cells = [_cells(state) for state in ordered]
    widths = [
        min(max((len(row[column]) for row in cells), default=0), _MAX_COLUMN)
        for column in range(4)
    ]
    agent = ""
    for state, row in zip(ordered, cells, strict=True):
        if state.parameter.agent != agent:
            agent = state.parameter.agent
            yield agent
        yield from _lines(row, widths, state.parameter.description, width)


def _cells(state: ParameterState) -> tuple[str, str, str, str]:
    """Return name, value, default and limits; empty if there is nothing to show."""
    parameter = state.parameter
    name = f"  {parameter.name[len(parameter.agent) + 1 :]}" if parameter.agent else parameter.name
    changed = state.value != parameter.default
    default = f"file: {ellipsize(shown_value(parameter, parameter.default))}" if changed else ""
    limits = ""
    if parameter.minimum is not None and parameter.maximum is not None:
        limits = f"{parameter.format(parameter.minimum)} to {parameter.format(parameter.maximum)}"
    return name, ellipsize(shown_value(parameter, state.value)), default, limits


def _lines(
    cells: Sequence[str], widths: Sequence[int], description: str, width: int
) -> Iterator[str]:
    used = [(cell, size) for cell, size in zip(cells, widths, strict=True) if size]
    row = _GAP.join(f"{cell:<{size}}" for cell, size in used) + _GAP
    rest = width - (sum(size for _, size in used) + len(_GAP) * len(used))
    if rest < _MIN_DESCRIPTION:
        yield row.rstrip()
        yield from textwrap.wrap(
            description, width, initial_indent=_INDENT, subsequent_indent=_INDENT
        )
        return
    first, *more = textwrap.wrap(description, rest) or [""]
    yield f"{row}{first}".rstrip()
    yield from (" " * (width - rest) + line for line in more)
