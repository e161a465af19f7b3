# SPDX-License-Identifier: Apache-2.0
"""Decorators of BehaviorTree.CPP as decorators of our language."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bt_agents_groot.document import node_id
from bt_agents_groot.formulas import Formula, Untranslatable, negated
from bt_agents_groot.leaves import check, count, duration, element_text
from bt_agents_groot.own_nodes import own_fields
from bt_agents_groot.translation import RemarkLevel, Translation
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import (
    Data,
    Raw,
    YamlNode,
    can_be_skipped,
    decorated,
    selector,
    sequence,
)
from bt_agents_language.nodes.catalogue import DECORATORS as OWN_DECORATORS
from bt_agents_language.nodes.node_type import FOREVER

Translate = Callable[[Translation, Element], YamlNode]


def _plain(key: str) -> Translate:
    def translate(tree: Translation, element: Element) -> YamlNode:
        return decorated(tree.node(element.children[0]), key, True)

    return translate


def _loop(key: str, port: str) -> Translate:
    def translate(tree: Translation, element: Element) -> YamlNode:
        times = count(tree, element, port) if port else Raw(FOREVER)
        child = tree.node(element.children[0])
        return tree.decorate(element, child, key, times)

    return translate


def _timeout(tree: Translation, element: Element) -> YamlNode:
    limit = duration(tree, element, "msec")
    child = tree.node(element.children[0])
    # No milliseconds mean no limit there.
    return child if limit == Raw("0 s") else decorated(child, "timeout", limit)


def _delay(tree: Translation, element: Element) -> YamlNode:
    wait = YamlNode(key="wait", value=duration(tree, element, "delay_msec"))
    return sequence(wait, tree.node(element.children[0]))


def _run_once(tree: Translation, element: Element) -> YamlNode:
    if element.get("then_skip", "true").lower() not in ("true", "1"):
        tree.remark(
            RemarkLevel.NOTE,
            element,
            "the second time it ends as it did the first; ours is left out",
        )
    return decorated(tree.node(element.children[0]), "once", True)


def _precondition(tree: Translation, element: Element) -> YamlNode:
    status = element.get("else", "FAILURE").strip()
    if status.startswith("{"):
        tree.remark(RemarkLevel.LOST, element, f"'else' is {status}; FAILURE is assumed")
        status = "FAILURE"
    try:
        condition: Formula = tree.condition(element.attributes["if"])
        text = tree.text(condition)
        opposite = tree.text(negated(condition))
    except Untranslatable as error:
        tree.remark(
            RemarkLevel.LOST, element.attributes["if"], f"the condition is left out: {error}"
        )
        return tree.node(element.children[0])
    child = tree.node(element.children[0])
    match status:
        case "SKIPPED":
            return decorated(child, "when", text)
        case "SUCCESS":
            if can_be_skipped(child):
                tree.remark(
                    RemarkLevel.NOTE, element, "when its child is left out, ours has failed"
                )
            return selector(check(opposite), child)
        case "RUNNING":
            wait = YamlNode(key="wait_for", value=text)
            return wait if child == check(Raw("true")) else sequence(wait, child)
    return sequence(check(text), child)


def _child_alone(tree: Translation, element: Element) -> YamlNode:
    tree.remark(
        RemarkLevel.LOST,
        element,
        f"{element_text(element)} has no equivalent; its child stands alone",
    )
    return tree.node(element.children[0])


def own_decorator(tree: Translation, element: Element) -> YamlNode | None:
    """Return the node for a decorator of our language; None when it is none."""
    own = OWN_DECORATORS.get(node_id(element))
    if own is None or own.main is None or len(element.children) != 1:
        return None
    fields = own_fields(element, own.fields, tree.names, tree.remark)
    if fields is None:
        return None
    value: Data = fields[own.main] if list(fields) == [own.main] else fields
    return decorated(tree.node(element.children[0]), own.key, value)


def unknown_parent(tree: Translation, element: Element) -> YamlNode:
    """Return the children of an unknown element with children, in a sequence if several."""
    if len(element.children) == 1:
        return _child_alone(tree, element)
    tree.remark(
        RemarkLevel.LOST,
        element,
        f"{element_text(element)} has no equivalent; its children stand in a sequence",
    )
    return sequence(*(tree.node(child) for child in element.children))


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
        _child_alone,
    ),
}  # fmt: skip
"""Translator of each built-in decorator."""
