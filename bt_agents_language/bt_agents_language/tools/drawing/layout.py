# SPDX-License-Identifier: Apache-2.0
"""Layout of the boxes of a tree: children right of their parent, an only one below it."""

from __future__ import annotations

from dataclasses import dataclass

from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.model.specs import iter_nodes
from bt_agents_language.tools.drawing.boxes import Box, BoxKind
from bt_agents_language.tools.drawing.outline import head, packed

LINE = 17.0
"""Height of a line of text [px]; all lengths here are pixels."""

PADDING = 9.0
"""Space between a text and the border of its box."""

LONGEST_TEXT = 30
"""Characters of a text in a picture; the rest is left out."""

_LONGEST_LINE = 40

_COLUMN = 7.3
_GAP_ACROSS = 40.0
_GAP_DOWN = 16.0
_GAP_TO_ONLY = 10.0
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

    @property
    def right(self) -> float:
        """The right end of this box and all below it."""
        return max(one.x + one.width for one in iter_nodes(self))

    @property
    def bottom(self) -> float:
        """The lower end of this box and all below it."""
        return max(one.y + one.height for one in iter_nodes(self))


def place(box: Box, x: float, y: float) -> Placed:
    """Return a tree with its upper left corner at a point."""
    lines = tuple(filter(None, (head(box), *detail_lines(box), box.role)))
    width = _width(box, lines)
    height = len(lines) * LINE + 2 * PADDING
    children: list[Placed] = []
    # Decorators stand above what they decorate, which keeps the picture of a deep tree narrow.
    only = len(box.children) == 1
    left, below = (x, y + height + _GAP_TO_ONLY) if only else (x + width + _GAP_ACROSS, y)
    for child in box.children:
        children.append(place(child, left, below))
        below = children[-1].bottom + _GAP_DOWN
    return Placed(
        box=box, x=x, y=y, width=width, height=height, lines=lines, children=tuple(children)
    )


def detail_lines(box: Box) -> list[str]:
    """Return what a picture shows below the key of a node: all in one line, or one each."""
    whole = " ".join(box.details)
    if columns(whole) <= _LONGEST_LINE:
        return [whole] if whole else []
    return [line for detail in box.details for line in packed([detail], _LONGEST_LINE)]


def text_width(text: str) -> float:
    """Return how wide a text is at most, in any usual font of the size that is used."""
    return columns(text) * _COLUMN


def _width(box: Box, lines: tuple[str, ...]) -> float:
    first = columns(lines[0]) + _PLACE_OF_NUMBER + len(str(box.position.line))
    longest = max([first, *map(columns, lines[1:])])
    slant = 2 * PADDING if box.kind is BoxKind.DECORATOR else 0.0
    return max(_NARROWEST, longest * _COLUMN + 2 * PADDING + slant)
