# SPDX-License-Identifier: Apache-2.0
"""The colours of the kinds of nodes, the same in every picture."""

from __future__ import annotations

from dataclasses import dataclass

from bt_agents_language.tools.drawing.boxes import BoxKind


@dataclass(frozen=True, kw_only=True)
class Colours:
    """Colours of one kind of box, as CSS; the text stands out from the fill by at least 7 : 1."""

    fill: str
    stroke: str
    text: str


COLOURS = {
    BoxKind.COMPOSITE: Colours(fill="#dbe9ff", stroke="#2f6fd0", text="#0b2a5b"),
    BoxKind.MODIFIER: Colours(fill="#fff1cc", stroke="#c98a00", text="#4a3200"),
    BoxKind.LEAF: Colours(fill="#eef0f3", stroke="#6b7480", text="#222a33"),
    BoxKind.SKILL: Colours(fill="#daf3df", stroke="#2e8b47", text="#0d3b1a"),
    BoxKind.SUBTREE: Colours(fill="#eee0fb", stroke="#8247b8", text="#3a125e"),
}
"""By kind of box."""
