# SPDX-License-Identifier: Apache-2.0
"""SVG picture of an agent's trees, which needs no other program to be drawn."""

from __future__ import annotations

import re
from xml.sax.saxutils import escape, quoteattr

from bt_agents_core.scene import SceneSpace
from bt_agents_language.model.specs import AgentSpec, iter_nodes
from bt_agents_language.tools.drawing.boxes import COLOURS, Box, BoxKind, box_of
from bt_agents_language.tools.drawing.layout import (
    LINE,
    LONGEST_TEXT,
    PADDING,
    Placed,
    place,
    text_width,
)
from bt_agents_language.tools.drawing.outline import head_lines, sentence

_MARGIN = 24.0
_TITLE = 22.0
_HEAD_WIDTH = 100
_STEM = 2 * PADDING
_CORNERS = {BoxKind.COMPOSITE: 2.0, BoxKind.LEAF: 7.0, BoxKind.SKILL: 15.0, BoxKind.SUBTREE: 2.0}
_NO_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_STYLE = (
    "text{font:13px system-ui,'Segoe UI',Roboto,'DejaVu Sans',Arial,sans-serif;white-space:pre}"
    ".title{font-size:20px;font-weight:700;fill:#111}"
    ".head{fill:#444}"
    ".tree{font-weight:700;fill:#111}"
    ".edge{fill:none;stroke:#8a94a0;stroke-width:1.5}"
    ".key{font-weight:600}"
    ".line{font-size:10px;opacity:.65}"
    ".role{font-style:italic;font-size:12px;fill:#b3261e}"
) + "".join(
    f".{kind.value} .shape{{fill:{one.fill};stroke:{one.stroke};stroke-width:1.5}}"
    f".{kind.value} text:not(.role){{fill:{one.text}}}"
    for kind, one in COLOURS.items()
)


def svg(agent: AgentSpec, space: SceneSpace) -> str:
    """Return the agent's head and trees as one SVG file, ended by a line feed."""
    head = [" ".join(line.split()) for line in head_lines(agent, space, _HEAD_WIDTH)]
    y = _MARGIN + _TITLE
    parts = [_text(_MARGIN, y - 4, f"{agent.title} ({agent.name})", "title")]
    for line in head:
        y += LINE
        parts.append(_text(_MARGIN, y, line, "head"))
    right = max([text_width(agent.title + agent.name) * 1.6, *map(text_width, head), 300.0])
    for title, spec in (("tree", agent.tree), ("on_cancel", agent.on_cancel)):
        if spec is None:
            continue
        y += 2 * LINE
        parts.append(_text(_MARGIN, y, title, "tree"))
        tree = place(box_of(spec, LONGEST_TEXT), _MARGIN, y + 10)
        parts += _edges(tree)
        parts += map(_box, iter_nodes(tree), iter_nodes(box_of(spec)))
        right, y = max(right, tree.right - _MARGIN), tree.bottom
    y += 2 * LINE
    parts += _legend(y)
    width, height = right + 2 * _MARGIN, y + _MARGIN
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img">',
        f"<title>{_clean(agent.title)}</title>",
        f"<style>{_STYLE}</style>",
        '<rect width="100%" height="100%" fill="#fff"/>',
        *parts,
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _edges(tree: Placed) -> list[str]:
    edges = []
    for parent in iter_nodes(tree):
        if len(parent.children) == 1:
            bottom, end = parent.y + parent.height, parent.children[0].y
            edges.append(
                f'<path class="edge" d="M{parent.x + _STEM:.1f} {bottom:.1f}V{end:.1f}"/>'
            )
            continue
        for child in parent.children:
            start, turn = parent.x + parent.width, child.x - 20
            top, middle = parent.y + PADDING + LINE / 2, child.y + PADDING + LINE / 2
            bend = f"H{turn:.1f}V{middle:.1f}" if middle != top else ""
            edges.append(f'<path class="edge" d="M{start:.1f} {top:.1f}{bend}H{child.x:.1f}"/>')
    return edges


def _box(placed: Placed, whole: Box) -> str:
    box = placed.box
    left = placed.x + PADDING * (2 if box.kind is BoxKind.DECORATOR else 1)
    texts = []
    for row, line in enumerate(placed.lines):
        last = row == len(placed.lines) - 1
        style = "key" if not row else "role" if box.role and last else ""
        texts.append(_text(left, placed.y + PADDING + row * LINE + 13, line, style))
    number = (
        f'<text class="line" text-anchor="end" x="{placed.x + placed.width - PADDING:.1f}" '
        f'y="{placed.y + PADDING + 10:.1f}">{box.position.line}</text>'
    )
    tip = f"{sentence(whole)}\n{box.position}"
    return (
        f'<g class="{box.kind.value}" data-path={quoteattr(_NO_XML.sub("", box.path))}>'
        f"<title>{_clean(tip)}</title>"
        f"{_shape(placed)}{number}{''.join(texts)}</g>"
    )


def _shape(placed: Placed) -> str:
    x, y, width, height = placed.x, placed.y, placed.width, placed.height
    if placed.box.kind is BoxKind.DECORATOR:
        points = (
            (x, y + height / 2),
            (x + PADDING, y),
            (x + width - PADDING, y),
            (x + width, y + height / 2),
            (x + width - PADDING, y + height),
            (x + PADDING, y + height),
        )
        corners = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
        return f'<polygon class="shape" points="{corners}"/>'
    shape = _rectangle(x, y, width, height, _CORNERS[placed.box.kind])
    if placed.box.kind is BoxKind.SUBTREE:
        shape += _rectangle(x + 3, y + 3, width - 6, height - 6, 1)
    return shape


def _rectangle(x: float, y: float, width: float, height: float, corner: float) -> str:
    return (
        f'<rect class="shape" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
        f'rx="{corner:g}"/>'
    )


def _legend(y: float) -> list[str]:
    parts = []
    x = _MARGIN
    for kind in BoxKind:
        parts.append(
            f'<g class="{kind.value}">{_rectangle(x, y - 11, 16, 13, 3)}'
            f"{_text(x + 22, y, kind.value)}</g>"
        )
        x += 22 + text_width(kind.value) + 20
    return parts


def _text(x: float, y: float, text: str, style: str = "") -> str:
    named = f' class="{style}"' if style else ""
    return f'<text{named} x="{x:.1f}" y="{y:.1f}">{_clean(text)}</text>'


def _clean(text: str) -> str:
    return escape(_NO_XML.sub("", text))
