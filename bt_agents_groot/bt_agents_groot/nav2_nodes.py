# SPDX-License-Identifier: Apache-2.0
"""Import of the control nodes and decorators of Nav2 as nodes of our language."""

from __future__ import annotations

import re
from collections.abc import Mapping

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import CONDITIONS
from bt_agents_groot.controls import CONTROLS, choose, noted
from bt_agents_groot.document import node_id
from bt_agents_groot.reactive_nodes import Repeated, while_repeated
from bt_agents_groot.simple_nodes import time_of, unknown_parent
from bt_agents_groot.tree_import import Translate, TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, check, decorated, selector, sequence
from bt_agents_language.nodes.node_type import FOREVER
from bt_agents_language.nodes.on_failure import ON_FAILURE

_POSITIVE = re.compile(r"(?=.*[1-9])[0-9]{1,9}(\.[0-9]{1,9})?")
_USUAL_HZ = "10.0"
_NO_LIMIT = 10**9
"""Number of recoveries that no run reaches."""


def _recovery_node(tree: TreeImport, element: Element) -> YamlNode:
    """Return attempts of the first child, with the second after each failure but the last.

    A failed recovery ends the attempts: the count of recoveries is then above their limit.
    """
    first, second = element.children
    tried = tree.node(first)
    if element.get("number_of_retries", "1").strip() == "0":
        tree.note(element, "it is tried once, so that its second child is never done")
        return tried
    done = tree.names.fresh("recoveries")
    limit, attempts = _retries(tree, element)
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
    """Return the number of recoveries, as an expression, and the number of attempts."""
    text = element.get("number_of_retries", "1").strip()
    name = tree.entry(text, FieldType.INTEGER)
    if name is not None:
        return name, Raw(f"${{{name} + 1}}")
    if int(text) < 0:
        return str(_NO_LIMIT), Raw(FOREVER)
    return text, int(text) + 1


def _round_robin(tree: TreeImport, element: Element) -> YamlNode:
    """Return one child after another until one succeeds, beginning after the last one that ran."""
    turn = tree.names.fresh("turn")
    if tree.constant(element, "wrap_around", "true").lower() not in ("true", "1"):
        return _single_round(tree, element, turn)
    count = len(element.children)
    following = Raw(f"${{(({turn} else {count - 1}) + 1) % {count}}}")
    conditions = (Raw(f"{turn} == {number}") for number in range(count))
    choice = choose(tree, list(zip(element.children, conditions, strict=True)))
    one = sequence(YamlNode(key="set", value={turn: following}), choice)
    return decorated(one, "retry", count)


def _single_round(tree: TreeImport, element: Element, turn: str) -> YamlNode:
    """Return the children that have not had their turn; after the last one, the node fails."""
    *others, last = (tree.node(child, below_fallback=True) for child in element.children)
    tries = [
        decorated(
            sequence(YamlNode(key="set", value={turn: number}), child),
            "when",
            Raw(f"{turn} else 0 < {number}"),
        )
        for number, child in enumerate(others, start=1)
    ]
    ended = sequence(YamlNode(key="set", value={turn: 0}), last)
    return selector(*tries, decorated(ended, "fail", True))


def _pipeline(tree: TreeImport, element: Element) -> YamlNode:
    *before, last = element.children
    repeated = [_repeated(tree, child) for child in before]
    return while_repeated(tree, repeated, tree.node(last)) if repeated else tree.node(last)


def _repeated(tree: TreeImport, element: Element) -> Repeated:
    """Return a child of a pipeline, with the limit on its repetitions."""
    # A controller with a condition is read as a whole.
    controller = "" if CONDITIONS.keys() & element.attributes.keys() else node_id(element)
    if controller == "RateController":
        return Repeated(node=tree.node(element.children[0]), pause=_period(tree, element))
    if controller in _CONTROLLERS:
        return Repeated(due=tree.skill(element), node=tree.node(element.children[0]))
    return Repeated(node=tree.node(element))


def _unlimited(tree: TreeImport, element: Element) -> YamlNode:
    return tree.node(element.children[0])


def _goal_updater(tree: TreeImport, element: Element) -> YamlNode:
    return sequence(tree.skill(element), tree.node(element.children[0]))


def _path_longer(tree: TreeImport, element: Element) -> YamlNode:
    longer = tree.skill(element)
    return selector(decorated(longer, "invert", True), tree.node(element.children[0]))


def _persistent(tree: TreeImport, element: Element) -> YamlNode:
    """Return a sequence that resumes after the child whose number an entry holds."""
    index = tree.entry(element.get("current_child_idx"), FieldType.INTEGER)
    if index is None:
        return unknown_parent(tree, element)
    steps = [
        decorated(
            sequence(child, YamlNode(key="set", value={index: number})),
            "when",
            Raw(f"{index} < {number}"),
        )
        for number, child in enumerate(map(tree.node, element.children), start=1)
    ]
    tree.names.write(index)
    again = YamlNode(key="set", value={index: 0})
    handler = decorated(again, "fail", True)
    return decorated(sequence(*steps, again), ON_FAILURE.key, handler)


def _period(tree: TreeImport, element: Element) -> Raw:
    text = element.get("hz", _USUAL_HZ).strip()
    name = tree.entry(text, FieldType.NUMBER)
    if name is not None:
        return Raw(f"${{1 / {name}}}")
    if not _POSITIVE.fullmatch(text):
        tree.lost(element, f"'hz' is {text[:40]}; {_USUAL_HZ} is assumed")
        text = _USUAL_HZ
    return time_of(round(1000 / float(text), 3))


_CONTROLLERS = ("DistanceController", "SpeedController", "GoalUpdatedController")
"""Decorators that decide when their child is due again."""

NAV2_NODES: Mapping[str, Translate] = {
    "RecoveryNode": _recovery_node,
    "RoundRobin": noted(_round_robin),
    "PipelineSequence": _pipeline,
    "NonblockingSequence": CONTROLS["ParallelAll"],
    "PersistentSequence": _persistent,
    **dict.fromkeys(("RateController", *_CONTROLLERS), noted(_unlimited)),
    "GoalUpdater": noted(_goal_updater),
    "PathLongerOnApproach": _path_longer,
    "SingleTrigger": unknown_parent,
    "PauseResumeController": unknown_parent,
}
"""Translator of each node of Nav2."""
