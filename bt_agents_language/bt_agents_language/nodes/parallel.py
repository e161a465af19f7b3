# SPDX-License-Identifier: Apache-2.0
"""``parallel``: runs its children at the same time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bt_agents_core.field_types import Plain
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.endings import EITHER, SUCCESS, Outcome, Outcomes, any_of
from bt_agents_language.nodes.node_type import (
    Children,
    Content,
    NodeField,
    NodeReader,
    NodeType,
    RawNode,
    Role,
)
from bt_agents_language.yaml.typed_reader import TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Node, Scalar
from bt_agents_language.yaml.yaml_reader import Sequence as SequenceNode


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec:
    option = raw.options.get("succeed_on")
    if option is None:
        return reader.composite(raw, path, names)
    succeed_on = Literal(value=_read_succeed_on(reader.reading, raw, option.value))
    spec = reader.composite(raw, path, names)
    return replace(spec, fields={**spec.fields, "succeed_on": succeed_on})


def _read_succeed_on(reading: TypedReader, raw: RawNode, node: Node) -> Plain:
    """Return ``all``, ``one``, a number, or the places of the named children."""
    what = "'succeed_on'"
    if isinstance(node, SequenceNode):
        if not node.items:
            reading.error("missing-value", node, f"{what} names no child", "name one")
        return readable(_place(reading, raw, item) for item in node.items)
    if not isinstance(node, Scalar) or node.text in ("all", "one") or node.empty:
        return reading.text(node, what) or "all"
    if not node.text.lstrip("+-").isdigit():
        reading.error(
            "bad-choice",
            node,
            f"{what} is {quote(node.text)}, expected all, one, a number, or a list of names "
            "of children",
            did_you_mean(node.text, ("all", "one")) if node.text.isalpha() else "",
        )
        return "all"
    count = reading.integer(node, what, 1, max(1, len(raw.children)))
    return count if count is not None else "all"


def _place(reading: TypedReader, raw: RawNode, item: Node) -> int | None:
    name = reading.text(item, "the name of a child")
    if name is None:
        return None
    names = [child.name for child in raw.children]
    if names.count(name) == 1:
        return names.index(name)
    if name in names:
        message = f"there are several children called {quote(name)}"
        hint = "give each its own name"
    else:
        message = f"no child is called {quote(name)}"
        hint = did_you_mean(name, [one for one in names if one])
        hint = hint or "name the children with 'name: …' beside them"
    reading.error("unknown-name", item, message, hint)
    return None


def _needs_all(spec: NodeSpec) -> bool:
    return spec.fields.get("succeed_on") == Literal(value="all")


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    if not _needs_all(spec):
        return any_of(children) | EITHER
    found = any_of(children) - SUCCESS
    return found | SUCCESS if all(Outcome.SUCCESS in child for child in children) else found


PARALLEL = NodeType(
    key="parallel",
    order=30,
    role=Role.COMPOSITE,
    fields=(
        NodeField(
            name="succeed_on",
            content=Content.COUNT,
            required=False,
            default="all",
            words=("all", "one"),
            minimum=1,
            description="children that must succeed: all, one, a number of them, or the named "
            "ones",
        ),
    ),
    children=Children.LIST,
    description="Runs its children at the same time.",
    read=_read,
    outcomes=_outcomes,
    concurrent=True,
    stops_children=lambda spec: not _needs_all(spec),
    example="""\
tree:
  parallel:
    succeed_on: all
    children:
      - show: Follow me
      - drive: check-in desk
""",
)
