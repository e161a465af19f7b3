# SPDX-License-Identifier: Apache-2.0
"""Decorators of BehaviorTree.CPP as decorators of our language."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_groot.formulas import Untranslatable, negated
from bt_agents_groot.leaves import count, duration, element_text
from bt_agents_groot.tree_import import Translate, TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import (
    Raw,
    YamlNode,
    can_be_skipped,
    check,
    decorated,
    selector,
    sequence,
)
from bt_agents_language.nodes.node_type import FOREVER


def _plain(key: str) -> Translate:
    return lambda tree, element: decorated(tree.node(element.children[0]), key, True)


def _loop(key: str, port: str) -> Translate:
    def translate(tree: TreeImport, element: Element) -> YamlNode:
        times = count(tree, element, port) if port else Raw(FOREVER)
        return tree.decorate(element, tree.node(element.children[0]), key, times)

    return translate


def _timeout(tree: TreeImport, element: Element) -> YamlNode:
    limit = duration(tree, element, "msec")
    child = tree.node(element.children[0])
    # No milliseconds mean no limit there.
    return child if limit == Raw("0 s") else decorated(child, "timeout", limit)


def _delay(tree: TreeImport, element: Element) -> YamlNode:
    wait = YamlNode(key="wait", value=duration(tree, element, "delay_msec"))
    return sequence(wait, tree.node(element.children[0]))


def _run_once(tree: TreeImport, element: Element) -> YamlNode:
    if element.get("then_skip", "true").lower() not in ("true", "1"):
        tree.note(element, "the second time it ends as it did the first; ours is left out")
    return decorated(tree.node(element.children[0]), "once", True)


def _precondition(tree: TreeImport, element: Element) -> YamlNode:
    status = element.get("else", "FAILURE").strip()
    if status.startswith("{"):
        tree.lost(element, f"'else' is {status}; FAILURE is assumed")
        status = "FAILURE"
    try:
        condition = tree.condition(element.attributes["if"])
        text, opposite = tree.text(condition), tree.text(negated(condition))
    except Untranslatable as error:
        tree.lost(element.attributes["if"], f"the condition is left out: {error}")
        return tree.node(element.children[0])
    child = tree.node(element.children[0])
    match status:
        case "SKIPPED":
            return decorated(child, "when", text)
        case "SUCCESS":
            if can_be_skipped(child):
                tree.note(element, "when its child is left out, ours has failed")
            return selector(check(opposite), child)
        case "RUNNING":
            wait = YamlNode(key="wait_for", value=text)
            return wait if child == check(Raw("true")) else sequence(wait, child)
    return sequence(check(text), child)


def unknown_parent(tree: TreeImport, element: Element) -> YamlNode:
    """Return the children of an element without equivalent, in a sequence if several."""
    one = len(element.children) == 1
    fate = "its child stands alone" if one else "its children stand in a sequence"
    tree.lost(element, f"{element_text(element)} has no equivalent; {fate}")
    children = [tree.node(child) for child in element.children]
    return children[0] if one else sequence(*children)


DECORATORS: Mapping[str, Translate] = {
    "Inverter": _plain("invert"),
    "ForceSuccess": _plain("succeed"),
    "ForceFailure": _plain("fail"),
    "Repeat": _loop("repeat", "num_cycles"),
    "RetryUntilSuccessful": _loop("retry", "num_attempts"),
    "KeepRunningUntilFailure": _loop("repeat", ""),
    "Timeout": _timeout,
    "Delay": _delay,
    "RunOnce": _run_once,
    "Precondition": _precondition,
    **dict.fromkeys(
        (
            "LoopInt", "LoopBool", "LoopDouble", "LoopString",
            "SkipUnlessUpdated", "WaitValueUpdate",
        ),
        unknown_parent,
    ),
}  # fmt: skip
"""Translator of each built-in decorator."""
