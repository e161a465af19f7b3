# SPDX-License-Identifier: Apache-2.0
"""Import of the control nodes and the decorator of Nav2 as nodes of our language."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import BUILTINS
from bt_agents_groot.controls import numbered_case
from bt_agents_groot.document import node_id
from bt_agents_groot.ports import pointed_at
from bt_agents_groot.tree_import import Translate, TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, check, decorated, selector, sequence
from bt_agents_language.nodes.node_type import FOREVER

_RATE = "RateController"
_POSITIVE = re.compile(r"(?=.*[1-9])[0-9]{1,9}(\.[0-9]{1,9})?")
_USUAL_HZ = "10.0"
_NO_LIMIT = 10**9
"""More recoveries than any run has."""


def _recovery_node(tree: TreeImport, element: Element) -> YamlNode:
    """Return tries of the first child, with the second behind each failure but the last.

    A recovery that fails ends the tries: the count of recoveries is then above their limit.
    """
    done = tree.names.fresh("recoveries")
    limit, attempts = _retries(tree, element)
    first, second = element.children
    tried = tree.node(first)
    recovered = selector(
        tree.node(second), YamlNode(key="set", value={done: Raw(f"${{{limit} + 1}}")})
    )
    again = sequence(
        check(Raw(f"{done} < {limit}")),
        YamlNode(key="set", value={done: Raw(f"${{{done} + 1}}")}),
        recovered,
        check(Raw("false")),
    )
    attempt = sequence(check(Raw(f"{done} <= {limit}")), selector(tried, again))
    return sequence(YamlNode(key="set", value={done: 0}), decorated(attempt, "retry", attempts))


def _retries(tree: TreeImport, element: Element) -> tuple[str, Data]:
    """Return how many recoveries there may be, as an expression, and how many attempts."""
    text = element.get("number_of_retries", "1").strip()
    entry = pointed_at(text)
    if entry is not None:
        name = tree.names.rename(entry)
        tree.names.read([name], FieldType.INTEGER)
        return name, Raw(f"${{{name} + 1}}")
    if int(text) < 0:
        return str(_NO_LIMIT), Raw(FOREVER)
    return text, int(text) + 1


def _round_robin(tree: TreeImport, element: Element) -> YamlNode:
    """Return one child after the other until one succeeds, beginning behind the last one done."""
    tree.note(element, BUILTINS[node_id(element)].note)
    count = len(element.children)
    turn = tree.names.fresh("turn")
    following = Raw(f"${{(({turn} else {count - 1}) + 1) % {count}}}")
    cases = [
        numbered_case(tree, child, Raw(f"{turn} == {number}"), number + 1)
        for number, child in enumerate(element.children)
    ]
    one = sequence(
        YamlNode(key="set", value={turn: following}), YamlNode(key="choose", children=tuple(cases))
    )
    return decorated(one, "retry", count)


def _pipeline(tree: TreeImport, element: Element) -> YamlNode:
    return _pipelined(tree, element.children)


def _pipelined(tree: TreeImport, elements: tuple[Element, ...]) -> YamlNode:
    """Return children that are begun one after the other, each repeated while the next runs."""
    first, *rest = elements
    if not rest:
        return tree.node(first)
    is_limited = node_id(first) == _RATE
    step = first.children[0] if is_limited else first
    once = tree.node(step)
    again = tree.node(step)
    if is_limited:
        again = sequence(YamlNode(key="wait", value=_period(tree, first)), again)
    following = _pipelined(tree, tuple(rest))
    following = replace(following, name=following.name or f"behind_{len(rest)}")
    together = YamlNode(
        key="parallel",
        value={"succeed_on": [following.name]},
        children=(decorated(again, "repeat", Raw(FOREVER)), following),
    )
    return sequence(once, together)


def _rate_controller(tree: TreeImport, element: Element) -> YamlNode:
    tree.note(element, BUILTINS[node_id(element)].note)
    return tree.node(element.children[0])


def _period(tree: TreeImport, element: Element) -> Raw:
    text = element.get("hz", _USUAL_HZ).strip()
    entry = pointed_at(text)
    if entry is not None:
        name = tree.names.rename(entry)
        tree.names.read([name], FieldType.NUMBER)
        return Raw(f"${{1 / {name}}}")
    if not _POSITIVE.fullmatch(text):
        tree.lost(element, f"'hz' is {text[:40]}; {_USUAL_HZ} is assumed")
        text = _USUAL_HZ
    return Raw(f"{1 / float(text):g} s")


NAV2_NODES: Mapping[str, Translate] = {
    "RecoveryNode": _recovery_node,
    "RoundRobin": _round_robin,
    "PipelineSequence": _pipeline,
    _RATE: _rate_controller,
}
"""Translator of each node of Nav2."""
