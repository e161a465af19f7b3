# SPDX-License-Identifier: Apache-2.0
"""Import of built-in decorators and leaves of BehaviorTree.CPP as nodes of our language."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite

from bt_agents_core.field_types import FieldType
from bt_agents_groot.document import node_id
from bt_agents_groot.formulas import Untranslatable, negated
from bt_agents_groot.ports import pointed_at
from bt_agents_groot.tree_import import Translate, TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, check, decorated, selector, sequence
from bt_agents_language.nodes.node_type import FOREVER
from bt_agents_language.nodes.when import WHEN


def _plain(key: str) -> Translate:
    return lambda tree, element: decorated(tree.node(element.children[0]), key, True)


def _loop(key: str, port: str, without: str = "") -> Translate:
    """Return the translator of a loop, which becomes a check of ``without`` if its count is 0."""

    def translate(tree: TreeImport, element: Element) -> YamlNode:
        times = _count(tree, element, port) if port else Raw(FOREVER)
        if times == 0:
            tree.note(element, f"'{port}' is 0, so that its child is never done")
            return check(Raw(without))
        return tree.decorate(element, tree.node(element.children[0]), key, times)

    return translate


def _timeout(tree: TreeImport, element: Element) -> YamlNode:
    limit = _duration(tree, element, "msec")
    child = tree.node(element.children[0])
    # There, no milliseconds mean no limit.
    return child if limit == Raw("0 s") else decorated(child, "timeout", limit)


def _delay(tree: TreeImport, element: Element) -> YamlNode:
    wait = YamlNode(key="wait", value=_duration(tree, element, "delay_msec"))
    return sequence(wait, tree.branch(element.children[0]))


def _run_once(tree: TreeImport, element: Element) -> YamlNode:
    if element.get("then_skip", "true").lower() not in ("true", "1"):
        tree.note(element, "the second time it ends as it did the first; ours is left out")
    return decorated(tree.node(element.children[0]), "once", True)


def _precondition(tree: TreeImport, element: Element) -> YamlNode:
    status = tree.constant(element, "else", "FAILURE")
    try:
        condition = tree.condition(element.attributes["if"])
        text, opposite = tree.text(condition), tree.text(negated(condition))
    except Untranslatable as error:
        tree.lost(element.attributes["if"], f"the condition is left out: {error}")
        return tree.node(element.children[0])
    if status == "SKIPPED":
        return tree.decorate(element, tree.node(element.children[0]), WHEN.key, text)
    ended = "failed" if status == "SUCCESS" else "succeeded"
    child = tree.branch(element.children[0], ended)
    match status:
        case "SUCCESS":
            return selector(check(opposite), child)
        case "RUNNING":
            wait = YamlNode(key="wait_for", value=text)
            return wait if child == check(Raw("true")) else sequence(wait, child)
    return sequence(check(text), child)


def unknown_parent(tree: TreeImport, element: Element) -> YamlNode:
    """Return the children of an element without equivalent after a leaf that fails."""
    fate = "child comes" if len(element.children) == 1 else "children come"
    failing = _untranslated(tree, element, f"; its {fate} after a node that fails")
    return sequence(failing, *map(tree.node, element.children))


def _queue(tree: TreeImport, element: Element) -> YamlNode:
    """Return the child repeated with one value after another; the queue must be constant."""
    values = _values(element)
    status = element.get("if_empty", "SUCCESS").strip()
    if values is None or status not in ("SUCCESS", "FAILURE"):
        return unknown_parent(tree, element)
    end = () if status == "SUCCESS" else (check(Raw("false")),)
    child = tree.node(element.children[0])
    steps = [child]
    turn = tree.names.fresh("turn")
    entry = pointed_at(element.get("value"))
    if entry is not None:
        name = tree.names.rename(entry)
        cases = [
            YamlNode(
                key="set",
                value={name: value},
                name=f"case_{number}",
                decorators={WHEN.key: Raw(f"{turn} == {number}")},
            )
            for number, value in enumerate(values, start=1)
        ]
        tree.names.write(name)
        steps = [YamlNode(key="choose", children=tuple(cases)), child]
    counted = YamlNode(key="set", value={turn: Raw(f"${{{turn} + 1}}")})
    again = decorated(sequence(counted, *steps), "repeat", len(values))
    return sequence(YamlNode(key="set", value={turn: 0}), again, *end)


def _values(element: Element) -> list[Data] | None:
    """Return the values of a queue; None if it is not a list of such values."""
    text = element.get("queue")
    if not text or pointed_at(text) is not None or text.startswith("json:"):
        return None
    convert = _QUEUES[node_id(element)]
    try:
        return [convert(part) for part in text.split(";")]
    except (ValueError, KeyError):
        return None


def _finite(part: str) -> float:
    number = float(part)
    if not isfinite(number):
        raise ValueError
    return number


_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}
_QUEUES: Mapping[str, Callable[[str], Data]] = {
    "LoopInt": int,
    "LoopDouble": _finite,
    "LoopBool": lambda part: _BOOLEANS[part.strip().lower()],
    "LoopString": lambda part: part.replace("${", "$${"),
}


def _count(tree: TreeImport, element: Element, port: str) -> Data:
    text = element.get(port).strip()
    name = tree.entry(text, FieldType.INTEGER)
    if name is not None:
        return Raw(f"${{{name}}}")
    return Raw(FOREVER) if int(text) < 0 else int(text)


def _duration(tree: TreeImport, element: Element, port: str) -> Raw:
    """Return the time in a port, which has milliseconds."""
    text = element.get(port).strip()
    name = tree.entry(text, FieldType.NUMBER)
    if name is not None:
        return Raw(f"${{{name} / 1000}}")
    return time_of(int(text))


def time_of(milliseconds: float) -> Raw:
    """Return a time in the form that people write."""
    if milliseconds % 60_000 == 0 and milliseconds > 0:
        return Raw(f"{milliseconds / 60_000:.0f} min")
    if milliseconds % 1000 == 0:
        return Raw(f"{milliseconds / 1000:.0f} s")
    large = milliseconds > 1000
    return Raw(f"{milliseconds / 1000:.10g} s" if large else f"{milliseconds:.10g} ms")


def _sleep(tree: TreeImport, element: Element) -> YamlNode:
    return YamlNode(key="wait", value=_duration(tree, element, "msec"))


def _script(tree: TreeImport, element: Element) -> YamlNode:
    try:
        return tree.script(element.attributes["code"])
    except Untranslatable as error:
        return _untranslated(tree, element, f": {error}")


def _constant(result: str) -> Translate:
    return lambda tree, element: check(Raw(result))


def _set_blackboard(tree: TreeImport, element: Element) -> YamlNode:
    key = element.get("output_key")
    value = tree.port(element, element.get("value"), FieldType.ANY)
    name = tree.names.rename(pointed_at(key) or key)
    tree.names.write(name)
    return YamlNode(key="set", value={name: value})


def _untranslated(tree: TreeImport, element: Element, because: str = "") -> YamlNode:
    """Return a leaf in place of an untranslatable one; it logs that fact and fails."""
    tree.lost(element, f"{_element_text(element)} has no equivalent{because}")
    message = f"not translated: {_element_text(element)}".replace("${", "$ {")
    node = YamlNode(key="log", value={"message": message, "level": "error"})
    return replace(node, decorators={"fail": True})


def _element_text(element: Element) -> str:
    """Return an element in one line, for messages."""
    ports = [f'{one.name}="{one.value[:60]}"' for one in element.attributes.values()]
    shown = " ".join((node_id(element), *(port for port in ports if port[:3] != "ID=")))
    return f"<{' '.join(shown.split())[:160]}>"


SIMPLE_NODES: Mapping[str, Translate] = {
    "Inverter": _plain("invert"),
    "ForceSuccess": _plain("succeed"),
    "ForceFailure": _plain("fail"),
    "Repeat": _loop("repeat", "num_cycles", "true"),
    "RetryUntilSuccessful": _loop("retry", "num_attempts", "false"),
    "KeepRunningUntilFailure": _loop("repeat", ""),
    "Timeout": _timeout,
    "Delay": _delay,
    "RunOnce": _run_once,
    "Precondition": _precondition,
    "SkipUnlessUpdated": unknown_parent,
    "WaitValueUpdate": unknown_parent,
    **dict.fromkeys(_QUEUES, _queue),
    "Sleep": _sleep,
    "Script": _script,
    "ScriptCondition": _script,
    "SetBlackboard": _set_blackboard,
    "AlwaysSuccess": _constant("true"),
    "AlwaysFailure": _constant("false"),
    "UnsetBlackboard": _untranslated,
    "WasEntryUpdated": _untranslated,
}  # fmt: skip
"""Translator of each built-in decorator and leaf."""
