# SPDX-License-Identifier: Apache-2.0
"""Outline of an agent's trees: indented text, with the line of each node in the file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from bt_agents_core.scene import SceneSpace
from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.model.specs import AgentSpec, iter_nodes
from bt_agents_language.tools.drawing.boxes import Box, BoxKind, box_of
from bt_agents_language.tools.drawing.value_format import format_profile, format_tunable

SIGNS = {
    BoxKind.COMPOSITE: "▼",
    BoxKind.DECORATOR: "◇",
    BoxKind.LEAF: "○",
    BoxKind.SKILL: "●",
    BoxKind.SUBTREE: "▶",
}
"""Sign before each kind of node."""

_HEAD_INDENT = 12
_NARROWEST = 24


def outline(agent: AgentSpec, space: SceneSpace, width: int = 80) -> str:
    """Return the agent's head and trees as text with a maximum width and a final line feed.

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
    lines = [f"{agent.name}: {agent.title}", *_head_lines(agent, space, width)]
    trees = {"tree": box_of(agent.tree)}
    if agent.on_cancel is not None:
        trees["on_cancel"] = box_of(agent.on_cancel)
    digits = max(
        len(str(box.position.line)) for tree in trees.values() for box in iter_nodes(tree)
    )
    for title, tree in trees.items():
        lines += ["", title, *_lines(tree, agent.file, digits, width, "", "")]
    return "\n".join(lines) + "\n"


def _head_lines(agent: AgentSpec, space: SceneSpace, width: int) -> list[str]:
    """Return the description of an agent in aligned lines of a maximum width."""
    entries: dict[str, Sequence[str]] = {
        "profile": [format_profile(agent.profile, space)],
        "requires": [agent.requires.text] if agent.requires is not None else [],
        "tunables": _joined([format_tunable(one) for one in agent.tunables], ","),
        "missing": _joined(agent.unoffered, ";"),
    }
    return [
        f"  {'' if row else word:<9} {text}"
        for word, pieces in entries.items()
        for row, text in enumerate(packed(pieces, width - _HEAD_INDENT))
    ]


def _head(box: Box) -> str:
    """Return the key of a node with its name, if it has one: ``explain: timeout``."""
    return f"{box.name}: {box.word}" if box.name else box.word


def _joined(words: Sequence[str], comma: str) -> list[str]:
    return [*(f"{word}{comma}" for word in words[:-1]), *words[-1:]]


def _lines(box: Box, file: str, digits: int, width: int, before: str, below: str) -> Iterator[str]:
    role = f"{box.role}: " if box.role else ""
    other = [f" ({box.position.file})"] if box.position.file != file else []
    start = f"  {box.position.line:>{digits}}  {before}{role}{SIGNS[box.kind]} "
    more = f"  {'':>{digits}}  {below}{'│' if box.children else ' '}     "
    room = max(width - columns(start if len(start) > len(more) else more), _NARROWEST)
    first, *others = packed([_head(box), *box.details, *other], room)
    yield start + first
    yield from (more + line for line in others)
    for number, child in enumerate(box.children, start=1):
        last = number == len(box.children)
        branch, under = ("└─ ", "   ") if last else ("├─ ", "│  ")
        yield from _lines(child, box.position.file, digits, width, below + branch, below + under)


def packed(pieces: Iterable[str], width: int) -> list[str]:
    """Return lines of a maximum width that hold the pieces one after another.

    Each piece stays in one line if it fits; a longer one is broken between words. Only a single
    word may be wider than a line.
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
