# SPDX-License-Identifier: Apache-2.0
"""Mermaid flowchart of an agent's trees, which wikis and code hosts draw."""

from __future__ import annotations

import json
import re

from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.model.specs import AgentSpec, iter_nodes
from bt_agents_language.tools.drawing.boxes import Box, BoxKind, box_of
from bt_agents_language.tools.drawing.outline import packed

_SHAPES = {
    BoxKind.COMPOSITE: '["{}"]',
    BoxKind.DECORATOR: '{{{{"{}"}}}}',
    BoxKind.LEAF: '("{}")',
    BoxKind.SKILL: '(["{}"])',
    BoxKind.SUBTREE: '[["{}"]]',
}
# The text contrasts with the fill by at least 7 : 1.
_STYLES = {
    BoxKind.COMPOSITE: "fill:#dbe9ff,stroke:#2f6fd0,color:#0b2a5b",
    BoxKind.DECORATOR: "fill:#fff1cc,stroke:#c98a00,color:#4a3200",
    BoxKind.LEAF: "fill:#eef0f3,stroke:#6b7480,color:#222a33",
    BoxKind.SKILL: "fill:#daf3df,stroke:#2e8b47,color:#0d3b1a",
    BoxKind.SUBTREE: "fill:#eee0fb,stroke:#8247b8,color:#3a125e",
}
_LONGEST_TEXT = 30
_LONGEST_LINE = 40
_UNSAFE = re.compile(r"[^\w\s.,!?+*/()=…→−–-]")


def mermaid(agent: AgentSpec) -> str:
    """Return the agent's trees as one flowchart that ends with a line feed."""
    lines = ["---", f"title: {json.dumps(agent.title, ensure_ascii=False)}", "---", "flowchart TD"]
    boxes: list[Box] = []
    for title, spec in (("tree", agent.tree), ("on_cancel", agent.on_cancel)):
        if spec is None:
            continue
        tree = box_of(spec, _LONGEST_TEXT)
        number = len(boxes)
        boxes += iter_nodes(tree)
        lines.append(f"  {title}_start([{title}]) --> n{number}")
        lines += _tree(tree, number)
    lines += (f"  classDef {kind.value} {style}" for kind, style in _STYLES.items())
    return "\n".join(lines) + "\n"


def _tree(box: Box, number: int) -> list[str]:
    """Return the lines of a box and all below it, numbered in depth-first order."""
    details = _detail_lines(box)
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


def _detail_lines(box: Box) -> list[str]:
    """Return the details of a node, all in one line or one per line."""
    whole = " ".join(box.details)
    if columns(whole) <= _LONGEST_LINE:
        return [whole] if whole else []
    return [line for detail in box.details for line in packed([detail], _LONGEST_LINE)]


def _escaped(text: str) -> str:
    """Return a text with character codes for all that Mermaid or a browser could misread."""
    return _UNSAFE.sub(lambda match: f"#{ord(match[0])};", text)
