# SPDX-License-Identifier: Apache-2.0
"""Markdown page of all nodes, skills and decorators."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.reference.node_pages import FieldEntry, Group, NodePage, node_pages

_HEADINGS = {
    Group.COMPOSITE: "Composites",
    Group.LEAF: "Leaves",
    Group.SKILL: "Skills",
    Group.PLUGIN: "Nodes of plug-ins",
    Group.DECORATOR: "Decorators",
    Group.SIBLING: "Other keys beside a node",
}
_WORDS = {
    Group.COMPOSITE: "A composite has children and says which of them are done, and when.",
    Group.LEAF: "A leaf does something itself.",
    Group.SKILL: "Skills are declared in the files of `skills/`; these are the ones of this "
    "repository. Another robot can have others.",
    Group.PLUGIN: "Installed packages bring these.",
    Group.DECORATOR: "A decorator stands beside a node and changes when it is done or what its "
    "end counts as. However they are written, they act in the order of this page: the first is "
    "the outermost.",
    Group.SIBLING: "",
}
_TOP = """\
# Reference of nodes

Made by `scripts/generate` from the tables that files are checked against; `bt-agents explain
NODE` shows the same in the terminal.

A node is a mapping with exactly one node key, and decorators beside it. `<…>` stands for a value;
`${…}` may stand wherever a text, number, time, length, angle or `true` and `false` is expected,
unless the table says that the value is fixed. Each example is part of an agent file.
"""


def reference_page(vocabulary: SymbolTable) -> str:
    """Return the page."""
    pages = node_pages(vocabulary)
    parts = [_TOP, _contents(pages)]
    for group in Group:
        of_group = [page for page in pages if page.group is group]
        if of_group:
            parts.append("\n\n".join(filter(None, [f"## {_HEADINGS[group]}", _WORDS[group]])))
            parts += [_section(page) for page in of_group]
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def _contents(pages: Iterable[NodePage]) -> str:
    listed = list(pages)
    lines = ["| | |", "|---|---|"]
    for group in Group:
        keys = [f"[`{page.key}`](#{page.key})" for page in listed if page.group is group]
        if keys:
            lines.append(f"| {_HEADINGS[group]} | {' '.join(keys)} |")
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
