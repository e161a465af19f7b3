# SPDX-License-Identifier: Apache-2.0
"""Mermaid flowchart of an agent's trees, which wikis and code hosts draw."""

from __future__ import annotations

import json
import re

from bt_agents_language.model.specs import AgentSpec, iter_nodes
from bt_agents_language.tools.drawing.boxes import COLOURS, Box, BoxKind, box_of
from bt_agents_language.tools.drawing.layout import LONGEST_TEXT, detail_lines

_SHAPES = {
    BoxKind.COMPOSITE: '["{}"]',
    BoxKind.DECORATOR: '{{{{"{}"}}}}',
    BoxKind.LEAF: '("{}")',
    BoxKind.SKILL: '(["{}"])',
    BoxKind.SUBTREE: '[["{}"]]',
}
_UNSAFE = re.compile(r"[^\w\s.,!?+*/()=…→−–-]")


def mermaid(agent: AgentSpec) -> str:
    """Return the agent's trees as one flowchart, ended by a line feed."""
    lines = ["---", f"title: {json.dumps(agent.title, ensure_ascii=False)}", "---", "flowchart TD"]
    boxes: list[Box] = []
    for title, spec in (("tree", agent.tree), ("on_cancel", agent.on_cancel)):
        if spec is None:
            continue
        tree = box_of(spec, LONGEST_TEXT)
        number = len(boxes)
        boxes += iter_nodes(tree)
        lines.append(f"  {title}_start([{title}]) --> n{number}")
        lines += _tree(tree, number)
    for kind, colours in COLOURS.items():
        style = f"fill:{colours.fill},stroke:{colours.stroke},color:{colours.text}"
        lines.append(f"  classDef {kind.value} {style}")
    return "\n".join(lines) + "\n"


def _tree(box: Box, number: int) -> list[str]:
    """Return the lines of a box and all below it, which are numbered in the order of a walk."""
    details = detail_lines(box)
    texts = [box.word, *details] if len(details) > 1 else [" ".join((box.word, *details))]
    label = "<br/>".join(map(_escaped, filter(None, (box.name, *texts))))
    lines = [f"  n{number}{_SHAPES[box.kind].format(label)}:::{box.kind.value}"]
    below = number + 1
    for child in box.children:
        role = f'|"{_escaped(child.role)}"|' if child.role else ""
        lines.append(f"  n{number} -->{role} n{below}")
        lines += _tree(child, below)
        below += sum(1 for _ in iter_nodes(child))
    return lines


def _escaped(text: str) -> str:
    """Return a text with everything that Mermaid or a browser could misread as its number."""
    return _UNSAFE.sub(lambda match: f"#{ord(match[0])};", text)
