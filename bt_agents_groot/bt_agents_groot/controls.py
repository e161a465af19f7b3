# SPDX-License-Identifier: Apache-2.0
"""Import of control nodes of BehaviorTree.CPP as composites of our language."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import BUILTINS, CONDITIONS
from bt_agents_groot.document import node_id
from bt_agents_groot.formulas import Binary, Constant, Formula, Name, Untranslatable, negated
from bt_agents_groot.ports import from_port, names_in, names_of_expression, pointed_at
from bt_agents_groot.translation import RemarkLevel, Translation
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, can_be_skipped, decorated, sequence
from bt_agents_language.nodes.check import CHECK
from bt_agents_language.nodes.parallel import PARALLEL
from bt_agents_language.nodes.random import RANDOM
from bt_agents_language.nodes.selector import SELECTOR
from bt_agents_language.nodes.when import WHEN

ON_FAILURE = "on_failure"
"""Name of a ``Fallback`` that stands for our decorator ``on_failure``."""

_NUMBER = re.compile(r"-?[0-9]{1,15}(\.[0-9]{1,15})?")

Compose = Callable[[Translation, Element], YamlNode]


def _composite(key: str, *, memory: bool = True) -> Compose:
    def translate(tree: Translation, element: Element) -> YamlNode:
        fallback = key == SELECTOR.key
        children = tuple(tree.node(c, below_fallback=fallback) for c in element.children)
        if not memory:
            _remark_slow(tree, element.children[:-1])
        if all(map(can_be_skipped, children)):
            tree.remark(
                RemarkLevel.NOTE,
                element,
                "when all its children are left out, Groot's is left out too; ours has "
                f"{'failed' if fallback else 'succeeded'}",
            )
        return YamlNode(key=key, value={} if memory else {"memory": False}, children=children)

    return translate


def _remark_slow(tree: Translation, children: tuple[Element, ...]) -> None:
    """Remark on children that are evaluated at every tick, but take time in our language."""
    for child in children:
        if node_id(child) not in BUILTINS and child.tag != "SubTree" and not child.children:
            tree.remark(
                RemarkLevel.NOTE,
                child,
                f"<{node_id(child)}> is asked again and again; while a skill takes time, what "
                "stands behind it is stopped",
            )


def _fallback(tree: Translation, element: Element) -> YamlNode:
    plain = _composite("selector")
    if element.get("name") != ON_FAILURE or len(element.children) != 2:
        return plain(tree, element)
    node = tree.node(element.children[0])
    if WHEN.key in node.decorators:
        return plain(tree, element)
    return decorated(node, ON_FAILURE, tree.node(element.children[1]))


def is_handler(element: Element, node: YamlNode) -> bool:
    """Return whether an element has become our decorator, so that its name says no more."""
    return element.get("name") == ON_FAILURE and ON_FAILURE in node.decorators


def _with_memory(tree: Translation, element: Element) -> YamlNode:
    tree.remark(RemarkLevel.NOTE, element, BUILTINS["SequenceWithMemory"].note)
    return _composite("sequence")(tree, element)


def _parallel(tree: Translation, element: Element) -> YamlNode:
    children = tuple(tree.node(child) for child in element.children)
    total = len(children)
    success = _threshold(tree, element, "success_count", -1, total)
    failure = _threshold(tree, element, "failure_count", 1, total)
    if success >= total:
        return YamlNode(key="parallel", children=children)
    if failure != total - success + 1:
        tree.remark(
            RemarkLevel.NOTE,
            element,
            f"it fails after {failure} failure{'s' * (failure > 1)}; ours fails when "
            f"{f'fewer than {success}' if success > 1 else 'none'} can still succeed",
        )
    wanted: Data = Raw("one") if success == 1 else success
    return YamlNode(key="parallel", value={"succeed_on": wanted}, children=children)


def _threshold(tree: Translation, element: Element, port: str, default: int, total: int) -> int:
    text = element.get(port, str(default)).strip()
    if pointed_at(text) is not None:
        tree.remark(RemarkLevel.LOST, element, f"'{port}' is {text}; {default} is assumed")
        text = str(default)
    number = int(text)
    return max(number + total + 1, 1) if number < 0 else number


def _parallel_all(tree: Translation, element: Element) -> YamlNode:
    tree.remark(RemarkLevel.NOTE, element, BUILTINS["ParallelAll"].note)
    return YamlNode(key="parallel", children=tuple(map(tree.node, element.children)))


def _if_then_else(tree: Translation, element: Element) -> YamlNode:
    cases: list[YamlNode] = []
    options: dict[str, Data] = {}
    current: Element | None = element
    while current is not None:
        text = _condition_text(tree, current.children[0])
        if text is None:
            return _by_result(tree, element)
        cases.append(_case(tree, current.children[1], text, len(cases) + 1))
        rest = current.children[2] if len(current.children) == 3 else None
        current = None
        if rest is not None and rest.tag == "IfThenElse" and not rest.attributes:
            current = rest if _condition_text(tree, rest.children[0]) is not None else None
        if rest is not None and current is None:
            options["otherwise"] = _branch(tree, rest)
    return YamlNode(key="choose", value=options, children=tuple(cases))


def _by_result(tree: Translation, element: Element) -> YamlNode:
    """Return nodes that choose by the result of a node instead of a condition."""
    condition_node, *branches = element.children
    if len(branches) == 1:
        return sequence(tree.node(condition_node), tree.node(branches[0]))
    name, *steps = _result_of(tree, condition_node)
    first = _case(tree, branches[0], Raw(name), 1)
    choose = YamlNode(
        key="choose", value={"otherwise": _branch(tree, branches[1])}, children=(first,)
    )
    return sequence(*steps, choose)


def _branch(tree: Translation, element: Element) -> YamlNode:
    node = tree.node(element)
    if can_be_skipped(node):
        tree.remark(
            RemarkLevel.NOTE,
            element,
            "when it is left out, ours has succeeded; Groot's is left out",
        )
    return node


def _case(tree: Translation, element: Element, condition: Raw, number: int) -> YamlNode:
    case = decorated(_branch(tree, element), "when", condition)
    return replace(case, name=case.name or f"case_{number}")


def _condition_text(tree: Translation, element: Element) -> Raw | None:
    """Return the condition that an element checks, as text; None when it is more than that."""
    if node_id(element) == CHECK.key and set(element.attributes) <= {"ID", "condition"}:
        tree.names.read(names_of_expression(element.get("condition")))
        return Raw(element.get("condition"))
    condition = _formula(tree, element)
    return None if condition is None else tree.text(condition)


def _formula(tree: Translation, element: Element) -> Formula | None:
    """Return the condition that an element checks; None when it is more than that."""
    if node_id(element) != "ScriptCondition" or set(element.attributes) - {"code", "ID"}:
        return None
    try:
        condition = tree.condition(element.attributes["code"])
        tree.text(condition)
    except Untranslatable:
        return None
    return condition


def _while_do_else(tree: Translation, element: Element) -> YamlNode:
    condition_node, *branches = element.children
    condition = _formula(tree, condition_node)
    if condition is not None:
        text, opposite = tree.text(condition), tree.text(negated(condition))
        return _while(tree, branches, text, opposite)
    _remark_slow(tree, (condition_node,))
    if len(branches) == 1:
        return _reactive("sequence", tree.node(condition_node), tree.node(branches[0]))
    name, *steps = _result_of(tree, condition_node)
    return _reactive("sequence", *steps, _while(tree, branches, Raw(name), Raw(f"not {name}")))


def _while(tree: Translation, branches: list[Element], text: Raw, opposite: Raw) -> YamlNode:
    """Return nodes that run the first branch while a condition is true, else the second."""
    first = _with_while(tree, branches[0], text)
    if len(branches) == 1:
        return first
    return _reactive("selector", first, _with_while(tree, branches[1], opposite))


def _with_while(tree: Translation, element: Element, condition: Raw) -> YamlNode:
    return tree.decorate(element, tree.node(element), "while", condition)


def _result_of(tree: Translation, condition_node: Element) -> tuple[str, YamlNode, YamlNode]:
    """Return a name for the result of a node, and the nodes that set it."""
    name = tree.names.fresh("fits")
    fits = sequence(tree.node(condition_node), YamlNode(key="set", value={name: True}))
    return name, YamlNode(key="set", value={name: False}), decorated(fits, "succeed", True)


def _reactive(key: str, *children: YamlNode) -> YamlNode:
    return YamlNode(key=key, value={"memory": False}, children=children)


def _switch(tree: Translation, element: Element) -> YamlNode:
    tree.remark(RemarkLevel.NOTE, element, BUILTINS["Switch2"].note)
    variable = _operand(tree, element.attributes["variable"])
    *branches, default = element.children
    cases: list[YamlNode] = []
    for number, branch in enumerate(branches, start=1):
        key = _operand(tree, element.attributes[f"case_{number}"])
        text = tree.text(Binary("==", variable, key))
        cases.append(_case(tree, branch, text, number))
    return YamlNode(
        key="choose", value={"otherwise": _branch(tree, default)}, children=tuple(cases)
    )


def _operand(tree: Translation, attribute: Attribute) -> Formula:
    entry = pointed_at(attribute.value)
    if entry is not None:
        return Name(tree.names.rename(entry))
    text = attribute.value
    if _NUMBER.fullmatch(text):
        return Constant(float(text) if "." in text else int(text))
    return Constant(text == "true") if text in ("true", "false") else Constant(text)


def _try_catch(tree: Translation, element: Element) -> YamlNode:
    if element.get("catch_on_halt", "false").lower() in ("true", "1"):
        tree.remark(
            RemarkLevel.LOST,
            element.attributes["catch_on_halt"],
            "what is to be done when the node is stopped; of a whole agent, 'on_cancel' does it",
        )
    *tried, caught = element.children
    handler = decorated(tree.node(caught), "fail", True)
    return decorated(sequence(*map(tree.node, tried)), ON_FAILURE, handler)


def own_control(tree: Translation, element: Element) -> YamlNode | None:
    """Return the node for our ``random``, or ``parallel`` with names; None for anything else."""
    ports = set(element.attributes) - {"ID", "name", *CONDITIONS}
    if node_id(element) == PARALLEL.key and ports == {"succeed_on"}:
        wanted = from_port(element.get("succeed_on"), FieldType.ANY, tree.names.rename)
        children = tuple(map(tree.node, element.children))
        return YamlNode(key="parallel", value={"succeed_on": wanted}, children=children)
    if node_id(element) != RANDOM.key or not ports <= {"seed", "weights"}:
        return None
    weights = from_port(element.get("weights", "json:[]"), FieldType.ANY, tree.names.rename)
    if not isinstance(weights, list) or len(weights) not in (0, len(element.children)):
        return None
    tree.names.read(names_in(weights), FieldType.NUMBER)
    chosen = [tree.node(child) for child in element.children]
    for number, weight in enumerate(weights):
        if weight != 1:
            siblings = {**chosen[number].siblings, "weight": _weight(weight)}
            chosen[number] = replace(chosen[number], siblings=siblings)
    seed = element.get("seed")
    options: dict[str, Data] = {"seed": Raw(seed)} if seed else {}
    return YamlNode(key="random", value=options, children=tuple(chosen))


def _weight(weight: Data) -> Data:
    return Raw(weight) if isinstance(weight, str) else weight


CONTROLS: Mapping[str, Compose] = {
    "Sequence": _composite("sequence"),
    "AsyncSequence": _composite("sequence"),
    "ReactiveSequence": _composite("sequence", memory=False),
    "SequenceWithMemory": _with_memory,
    "Fallback": _fallback,
    "AsyncFallback": _composite("selector"),
    "ReactiveFallback": _composite("selector", memory=False),
    "Parallel": _parallel,
    "ParallelAll": _parallel_all,
    "IfThenElse": _if_then_else,
    "WhileDoElse": _while_do_else,
    **{f"Switch{cases}": _switch for cases in range(2, 7)},
    "TryCatch": _try_catch,
}
"""Translator of each built-in control node."""
