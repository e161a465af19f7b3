# SPDX-License-Identifier: Apache-2.0
"""Decorators of BehaviorTree.CPP as decorators of our language."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bt_agents_groot.document import node_id
from bt_agents_groot.formulas import Formula, Untranslatable, negated
from bt_agents_groot.leaves import check, count, duration, shown_element
from bt_agents_groot.own_words import own_fields
from bt_agents_groot.remarks import RemarkLevel
from bt_agents_groot.translation import Translation
from bt_agents_groot.written import (
    Data,
    Raw,
    YamlNode,
    may_be_left_out,
    outside,
    selector,
    sequence,
)
from bt_agents_groot.xml_reader import Element
from bt_agents_language.nodes.catalogue import DECORATORS as OWN_DECORATORS
from bt_agents_language.nodes.node_type import FOREVER

Decorate = Callable[[Translation, Element], YamlNode]


def _switch(key: str) -> Decorate:
    def translate(tree: Translation, element: Element) -> YamlNode:
        return outside(tree.node(element.children[0]), key, True)

    return translate


def _again(key: str, port: str) -> Decorate:
    def translate(tree: Translation, element: Element) -> YamlNode:
        times = count(tree, element, port) if port else Raw(FOREVER)
        child = tree.node(element.children[0])
        return tree.around(element, child, key, times)

    return translate


def _timeout(tree: Translation, element: Element) -> YamlNode:
    limit = duration(tree, element, "msec")
    child = tree.node(element.children[0])
    # No milliseconds mean no limit there.
    return child if limit == Raw("0 s") else outside(child, "timeout", limit)


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
    return outside(tree.node(element.children[0]), "once", True)


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
            return outside(child, "when", text)
        case "SUCCESS":
            if may_be_left_out(child):
                tree.remark(
                    RemarkLevel.NOTE, element, "when its child is left out, ours has failed"
                )
            return selector(check(opposite), child)
        case "RUNNING":
            wait = YamlNode(key="wait_for", value=text)
            return wait if child == check(Raw("true")) else sequence(wait, child)
    return sequence(check(text), child)


def _kept_child(tree: Translation, element: Element) -> YamlNode:
    tree.remark(
        RemarkLevel.LOST,
        element,
        f"{shown_element(element)} has no equivalent; its child stands alone",
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
    return outside(tree.node(element.children[0]), own.key, value)


def unknown_parent(tree: Translation, element: Element) -> YamlNode:
    """Return what stands for a custom element with children: the children alone."""
    if len(element.children) == 1:
        return _kept_child(tree, element)
    tree.remark(
        RemarkLevel.LOST,
        element,
        f"{shown_element(element)} has no equivalent; its children stand in a sequence",
    )
    return sequence(*(tree.node(child) for child in element.children))


DECORATORS: Mapping[str, Decorate] = {
    "Inverter": _switch("invert"),
    "ForceSuccess": _switch("succeed"),
    "ForceFailure": _switch("fail"),
    "Repeat": _again("repeat", "num_cycles"),
    "RetryUntilSuccessful": _again("retry", "num_attempts"),
    "KeepRunningUntilFailure": _again("repeat", ""),
    "Timeout": _timeout,
    "Delay": _delay,
    "RunOnce": _run_once,
    "Precondition": _precondition,
    **dict.fromkeys(
        (
            "LoopInt", "LoopBool", "LoopDouble", "LoopString",
            "SkipUnlessUpdated", "WaitValueUpdate",
        ),
        _kept_child,
    ),
}  # fmt: skip
"""Translator of each built-in decorator."""
