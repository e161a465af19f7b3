# SPDX-License-Identifier: Apache-2.0
"""An agent's tree as indented text, with the line of each node in the file."""

from __future__ import annotations

from collections.abc import Iterator

from bt_agents.language.drawing.boxes import Box, BoxKind, box_of
from bt_agents.language.drawing.shown_values import shown_profile, shown_tunable
from bt_agents.language.specs import AgentSpec
from bt_agents.scene import SceneSpace

SIGNS = {
    BoxKind.COMPOSITE: "▼",
    BoxKind.MODIFIER: "◇",
    BoxKind.LEAF: "○",
    BoxKind.SKILL: "●",
    BoxKind.SUBTREE: "▶",
}
"""Sign before each kind of node."""


def outline(agent: AgentSpec, space: SceneSpace) -> str:
    """Return the agent's head and trees as text, ended by a line feed.

    Example:
        ::

            guide: Attentive guide
              profile   age 4, familiarity 1.5, mood 3
              tunables  patience 8 s (2 s to 30 s)

            tree
              12  ▼ sequence
              13  ├─ ● say "Hello."
              15  └─ ◇ timeout ${patience}
              16     └─ ● ask "Where to?" → answer
    """
    lines = [f"{agent.name}: {agent.title}", *head_lines(agent, space)]
    trees = {"tree": box_of(agent.tree)}
    if agent.on_cancel is not None:
        trees["on_cancel"] = box_of(agent.on_cancel)
    width = max(len(str(box.position.line)) for tree in trees.values() for box in tree.walk())
    for title, tree in trees.items():
        lines += ["", title, *_lines(tree, agent.file, width, "", "")]
    return "\n".join(lines) + "\n"


def head_lines(agent: AgentSpec, space: SceneSpace) -> list[str]:
    """Return what an agent is, one line each, the words lined up."""
    entries = {
        "profile": shown_profile(agent.profile, space),
        "requires": agent.requires.text if agent.requires is not None else "",
        "tunables": ", ".join(map(shown_tunable, agent.tunables)),
        "missing": "; ".join(agent.unoffered),
    }
    return [f"  {word:<9} {text}" for word, text in entries.items() if text]


def sentence(box: Box) -> str:
    """Return a node in one line: ``explain: timeout 90 s``."""
    name = f"{box.name}: " if box.name else ""
    return f"{name}{box.word} {box.detail}".rstrip()


def _lines(box: Box, file: str, width: int, before: str, below: str) -> Iterator[str]:
    role = f"{box.role}: " if box.role else ""
    other = f"  ({box.position.file})" if box.position.file != file else ""
    line = f"  {box.position.line:>{width}}  {before}{role}{SIGNS[box.kind]} {sentence(box)}"
    yield line + other
    for number, child in enumerate(box.children, start=1):
        last = number == len(box.children)
        branch, under = ("└─ ", "   ") if last else ("├─ ", "│  ")
        yield from _lines(child, box.position.file, width, below + branch, below + under)
