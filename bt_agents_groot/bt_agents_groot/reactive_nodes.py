# SPDX-License-Identifier: Apache-2.0
"""Import of nodes whose first children are repeated while the next ones run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bt_agents_groot.document import has_skill
from bt_agents_groot.tree_import import TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, decorated, selector, sequence
from bt_agents_language.nodes.node_type import FOREVER


@dataclass(frozen=True, kw_only=True)
class Repeated:
    """Node that is repeated.

    Attributes:
        due: Node that runs before each repetition; it succeeds when the repetition is due.
        pause: Time before each repetition.
    """

    node: YamlNode
    due: YamlNode | None = None
    pause: Raw | None = None


def asks_again(element: Element) -> bool:
    """Return whether skills, which take time in our language, come before the last child.

    If restarted at each tick, as with our own ``memory: false``, they would never end.
    """
    return any(map(has_skill, element.children[:-1]))


def while_repeated(tree: TreeImport, before: Sequence[Repeated], last: YamlNode) -> YamlNode:
    """Return nodes that begin one after the other; each is repeated while later ones run.

    The result ends like the last node, and fails as soon as another one fails.
    """
    done = [tree.names.fresh("done") for _ in before]
    name_of_last = f"after_{done[-1].removeprefix('done_')}"
    last = replace(_after(done[-1], last), name=name_of_last)
    children: list[YamlNode] = []
    for number, (name, one) in enumerate(zip(done, before, strict=True)):
        steps = [one.node, YamlNode(key="set", value={name: True})]
        steps += [one.due] if one.due is not None else []
        times: Data = Raw(FOREVER)
        if one.pause is not None:
            times = {"times": Raw(FOREVER), "pause": one.pause}
        again = decorated(sequence(*steps), "repeat", times)
        children.append(_after(done[number - 1], again) if number else again)
    together = YamlNode(
        key="parallel", value={"succeed_on": [name_of_last]}, children=(*children, last)
    )
    return sequence(YamlNode(key="set", value=dict.fromkeys(done, False)), together)


def _after(name: str, node: YamlNode) -> YamlNode:
    return sequence(YamlNode(key="wait_for", value=Raw(name)), node)


def reactive_sequence(tree: TreeImport, element: Element) -> YamlNode:
    """Return children that are repeated, except the last, while the next ones run."""
    *before, last = map(tree.node, element.children)
    return while_repeated(tree, [Repeated(node=one) for one in before], last)


def reactive_fallback(tree: TreeImport, element: Element) -> YamlNode:
    """Return the same as :func:`reactive_sequence` with success and failure exchanged."""
    *before, last = (
        decorated(tree.node(child, below_fallback=True), "invert", True)
        for child in element.children
    )
    whole = while_repeated(tree, [Repeated(node=one) for one in before], last)
    return decorated(whole, "invert", True)


def asked(condition: YamlNode, name: str) -> Repeated:
    """Return a node that sets a name to whether another node succeeds."""
    fits = sequence(condition, YamlNode(key="set", value={name: True}))
    return Repeated(node=selector(fits, YamlNode(key="set", value={name: False})))
