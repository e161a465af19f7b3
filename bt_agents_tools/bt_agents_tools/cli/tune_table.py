# SPDX-License-Identifier: Apache-2.0
"""Values of agents as a table that fits the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from bt_agents.host.tuning.tunable import Setting, TunableKind, TunableParameter, shown_value
from bt_agents_core.text import ellipsize

_WIDEST = 22
_GAP = "  "
_NARROWEST = 28
"""Columns that a description needs beside the rest of its row; else it gets lines of its own."""

_INDENT = " " * 6


class Stand(Protocol):
    """A knob and where it stands."""

    @property
    def knob(self) -> TunableParameter:
        """The knob."""

    @property
    def value(self) -> Setting:
        """Its value."""


def table(states: Iterable[Stand], width: int) -> Iterator[str]:
    """Yield the lines of a table: the knobs of the host, then those of each agent.

    Args:
        states: The knobs.
        width: Of the terminal, in columns.
    """
    ordered = sorted(
        states, key=lambda one: (one.knob.agent, one.knob.kind is TunableKind.PROFILE)
    )
    cells = [_cells(state) for state in ordered]
    widths = [
        min(max((len(row[column]) for row in cells), default=0), _WIDEST) for column in range(4)
    ]
    agent = ""
    for state, row in zip(ordered, cells, strict=True):
        if state.knob.agent != agent:
            agent = state.knob.agent
            yield agent
        yield from _lines(row, widths, state.knob.description, width)


def _cells(state: Stand) -> tuple[str, str, str, str]:
    """Return name, value, default and limits; a column that is empty in all rows is left out."""
    knob = state.knob
    name = f"  {knob.name[len(knob.agent) + 1 :]}" if knob.agent else knob.name
    changed = state.value != knob.default
    default = f"file: {ellipsize(shown_value(knob, knob.default))}" if changed else ""
    limits = ""
    if knob.minimum is not None and knob.maximum is not None:
        limits = f"{knob.written(knob.minimum)} to {knob.written(knob.maximum)}"
    return name, ellipsize(shown_value(knob, state.value)), default, limits


def _lines(
    cells: Sequence[str], widths: Sequence[int], description: str, width: int
) -> Iterator[str]:
    used = [(cell, size) for cell, size in zip(cells, widths, strict=True) if size]
    row = _GAP.join(f"{cell:<{size}}" for cell, size in used) + _GAP
    rest = width - (sum(size for _, size in used) + len(_GAP) * len(used))
    if rest < _NARROWEST:
        yield row.rstrip()
        yield from textwrap.wrap(
            description, width, initial_indent=_INDENT, subsequent_indent=_INDENT
        )
        return
    first, *more = textwrap.wrap(description, rest) or [""]
    yield f"{row}{first}".rstrip()
    yield from (" " * (width - rest) + line for line in more)
