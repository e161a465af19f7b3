# SPDX-License-Identifier: Apache-2.0
"""Which children of a composite count: those that must succeed, and those with a chance."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents_language.model.specs import Literal, NodeSpec, Plain
from bt_agents_language.tree.raw_nodes import RawNode
from bt_agents_language.yaml.diagnostics import did_you_mean, shown
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Scalar, Sequence


def read_succeed_on(reading: TypedReader, draft: RawNode, node: Node) -> Plain:
    """Return ``all``, ``one``, a number, or the places of the named children."""
    what = "'succeed_on'"
    if isinstance(node, Sequence):
        places = [_place(reading, draft, item) for item in node.items]
        if not places:
            reading.error("missing-value", node, f"{what} names no child", "name one")
        return tuple(place for place in places if place is not None)
    if not isinstance(node, Scalar) or node.text in ("all", "one") or node.empty:
        return reading.text(node, what) or "all"
    if not node.text.lstrip("+-").isdigit():
        reading.error(
            "bad-choice",
            node,
            f"{what} is {shown(node.text)}, expected all, one, a number, or a list of names "
            "of children",
            did_you_mean(node.text, ("all", "one")) if node.text.isalpha() else "",
        )
        return "all"
    count = reading.integer(node, what, 1, max(1, len(draft.children)))
    return count if count is not None else "all"


def _place(reading: TypedReader, draft: RawNode, item: Node) -> int | None:
    name = reading.text(item, "the name of a child")
    if name is None:
        return None
    names = [child.name for child in draft.children]
    if names.count(name) == 1:
        return names.index(name)
    known = [one for one in names if one]
    hint = "name the children with 'name: …' beside them"
    if name in names:
        message = f"there are several children called {shown(name)}"
        hint = "give each its own name"
    else:
        message = f"no child is called {shown(name)}"
        hint = did_you_mean(name, known) or hint
    reading.error("unknown-name", item, message, hint)
    return None


def refuse_no_chance(
    reading: TypedReader, draft: RawNode, children: Iterable[NodeSpec | None]
) -> None:
    """Report a ``random`` none of whose children can ever be chosen."""
    weights = [child.fields.get("weight") for child in children if child is not None]
    if weights and all(isinstance(w, Literal) and w.value == 0 for w in weights):
        reading.error(
            "out-of-range",
            draft.key,
            "every weight is 0, so no child can ever be chosen",
            "give one of them a weight above 0",
        )
