# SPDX-License-Identifier: Apache-2.0
"""Pieces of text put into lines: broken between pieces, inside of one only where it must be."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents_language.yaml.renderers import columns


def packed(pieces: Iterable[str], width: int) -> list[str]:
    """Return lines that hold the pieces one after the other.

    Args:
        pieces: Each stays in one line if it fits; a longer one is broken between its words.
        width: Columns of a line; only a single word may be wider.
    """
    lines: list[str] = []
    for piece in pieces:
        whole = columns(piece) <= width
        for part in [piece] if whole else piece.split(" "):
            if lines and columns(lines[-1]) + 1 + columns(part) <= width:
                lines[-1] += f" {part}"
            else:
                lines.append(part)
    return lines
