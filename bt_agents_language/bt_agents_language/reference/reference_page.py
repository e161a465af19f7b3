# SPDX-License-Identifier: Apache-2.0
"""Markdown pages: of all nodes, skills and decorators, and of all diagnostic codes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.resources import files

from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.reference.codes import code_groups
from bt_agents_language.reference.node_pages import FieldEntry, Group, NodePage, node_pages

_GROUPS = {
    Group.COMPOSITE: (
        "Composites",
        "A composite has children and decides which of them run, and when.",
    ),
    Group.LEAF: ("Leaves", "A leaf has no children; it does the work itself."),
    Group.SKILL: (
        "Skills",
        "The files in `skills/` declare the skills. These are the skills of this repository; "
        "another robot can have different ones.",
    ),
    Group.PLUGIN: ("Nodes of plug-ins", "Installed packages provide these."),
    Group.DECORATOR: (
        "Decorators",
        "A decorator stands beside a node and changes when the node runs or how its end counts. "
        "Whatever their order in the file, decorators act in the order of this page: the first is "
        "the outermost.",
    ),
    Group.SIBLING: ("Other keys beside a node", ""),
}
"""Heading and introduction of each group of words."""


def reference_page(symbols: SymbolTable) -> str:
    """Return the page of all nodes, skills and decorators."""
    pages = node_pages(symbols)
    parts = [_contents(pages)]
    for group, (heading, about) in _GROUPS.items():
        of_group = [page for page in pages if page.group is group]
        if of_group:
            parts += [f"## {heading}", about, *map(_section, of_group)]
    return _page("nodes", parts)


def codes_page() -> str:
    """Return the page of all codes."""
    parts = []
    for heading, group in code_groups().items():
        parts.append(f"## {heading}")
        for code in group:
            parts.append(f"### {code.code}")
            if not code.wrong:
                parts.append(code.meaning)
                continue
            fence = f"~~~{code.kind.language}\n"
            parts += [
                f"{code.meaning} Shown as {code.kind.value}:",
                f"{fence}{code.wrong}~~~",
                "Right:",
                f"{fence}{code.right}~~~",
            ]
    return _page("codes", parts)


def _page(name: str, parts: Iterable[str]) -> str:
    """Return a page below its head, which is in a separate file."""
    head = files("bt_agents_language").joinpath(f"reference/{name}_head.md")
    every = [head.read_text(encoding="utf-8"), *parts]
    return "\n\n".join(part.rstrip() for part in every if part) + "\n"


def _contents(pages: Sequence[NodePage]) -> str:
    lines = ["| | |", "|---|---|"]
    for group, (heading, _) in _GROUPS.items():
        keys = [f"[`{page.key}`](#{page.key})" for page in pages if page.group is group]
        if keys:
            lines.append(f"| {heading} | {' '.join(keys)} |")
    return "\n".join(lines)


def _section(page: NodePage) -> str:
    parts = [f"### {page.key}", page.description]
    parts.append("\n".join(f"- `{form}`" for form in page.forms))
    if page.fields:
        parts.append(_table(page.fields))
    if page.outputs:
        lines = (
            f"- `${{{one.name}}}` ({one.expected}): {one.description}" for one in page.outputs
        )
        parts.append("Later nodes can use:\n\n" + "\n".join(lines))
    parts += [page.note, f"```yaml\n{page.example}```"]
    return "\n\n".join(filter(None, parts))


def _table(fields: Iterable[FieldEntry]) -> str:
    lines = ["| field | value | left out | |", "|---|---|---|---|"]
    for field in fields:
        left_out = f"`{field.default}`" if field.default else ""
        name = f"`{field.name}`"
        cells = [name, field.expected, "needed" if field.required else left_out, field.description]
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(lines)
