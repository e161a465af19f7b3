# SPDX-License-Identifier: Apache-2.0
"""Where the boxes of a tree stand: children to the right of their parent, one below the other."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

from bt_agents.language.drawing.boxes import Box, BoxKind
from bt_agents.language.renderers import columns

LINE = 17.0
"""Height of a line of text [px]; all lengths here are pixels."""

PADDING = 9.0
"""Space between a text and the border of its box."""

_COLUMN = 7.3
_GAP_ACROSS = 40.0
_GAP_DOWN = 10.0
_LONGEST_LINE = 38
_NARROWEST = 84.0
_PLACE_OF_NUMBER = 4


@dataclass(frozen=True, kw_only=True)
class Placed:
    """One box with its place; ``lines`` are its texts, the one with its key first."""

    box: Box
    x: float
    y: float
    width: float
    height: float
    lines: tuple[str, ...]
    children: tuple[Placed, ...]

    def walk(self) -> Iterator[Placed]:
        """Return this box and all below it."""
        yield self
        for child in self.children:
            yield from child.walk()

    @property
    def right(self) -> float:
        """The right end of this box and all below it."""
        return max(one.x + one.width for one in self.walk())

    @property
    def bottom(self) -> float:
        """The lower end of this box and all below it."""
        return max(one.y + one.height for one in self.walk())


def place(box: Box, x: float, y: float) -> Placed:
    """Return a tree with its upper left corner at a point."""
    lines = _lines(box)
    width = _width(box, lines)
    children: list[Placed] = []
    below = y
    for child in box.children:
        children.append(place(child, x + width + _GAP_ACROSS, below))
        below = children[-1].bottom + _GAP_DOWN
    return Placed(
        box=box,
        x=x,
        y=y,
        width=width,
        height=len(lines) * LINE + 2 * PADDING,
        lines=lines,
        children=tuple(children),
    )


def text_width(text: str) -> float:
    """Return how wide a text is at most, in any usual font of the size that is used."""
    return columns(text) * _COLUMN


def _width(box: Box, lines: tuple[str, ...]) -> float:
    first = columns(lines[0]) + _PLACE_OF_NUMBER + len(str(box.position.line))
    longest = max([first, *map(columns, lines[1:])])
    slant = 2 * PADDING if box.kind is BoxKind.MODIFIER else 0.0
    return max(_NARROWEST, longest * _COLUMN + 2 * PADDING + slant)


def _lines(box: Box) -> tuple[str, ...]:
    head = box.word if not box.name else f"{box.name}: {box.word}"
    role = [box.role] if box.role else []
    return (
        head,
        *textwrap.wrap(box.detail, _LONGEST_LINE, break_on_hyphens=False),
        *role,
    )
