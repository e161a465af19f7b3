# SPDX-License-Identifier: Apache-2.0
"""Import of control nodes of BehaviorTree.CPP as composites of our language."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from bt_agents_groot.catalogue import BUILTINS
from bt_agents_groot.document import has_skill, node_id
from bt_agents_groot.formulas import Binary, Constant, Formula, Name, Untranslatable, negated
from bt_agents_groot.ports import names_of_expression, pointed_at
from bt_agents_groot.reactive_nodes import (
    asked,
    asks_again,
    reactive_fallback,
    reactive_sequence,
    while_repeated,
)
from bt_agents_groot.tree_import import Translate, TreeImport
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, can_be_skipped, decorated, sequence
from bt_agents_language.nodes.check import CHECK
from bt_agents_language.nodes.on_failure import ON_FAILURE
from bt_agents_language.nodes.selector import SELECTOR
from bt_agents_language.nodes.when import WHEN

_NUMBER = re.compile(r"-?[0-9]{1,15}(\.[0-9]{1,15})?")


def _composite(key: str, *, memory: bool = True) -> Translate:
    def translate(tree: TreeImport, element: Element) -> YamlNode:
        fallback = key == SELECTOR.key
        if not memory and asks_again(element):
            tree.note(element, BUILTINS[node_id(element)].note)
            return (reactive_fallback if fallback else reactive_sequence)(tree, element)
        children = tuple(tree.node(c, below_fallback=fallback) for c in element.children)
        if all(map(can_be_skipped, children)):
            ended = "failed" if fallback else "succeeded"
            tree.note_skip(element, "each of its children", ended)
        return YamlNode(key=key, value={} if memory else {"memory": False}, children=children)

    return translate


def _fallback(tree: TreeImport, element: Element) -> YamlNode:
    # An exported handler: a fallback with the name of our decorator.
    if element.get("name") == ON_FAILURE.key and len(element.children) == 2:
        node = tree.node(element.children[0])
        if WHEN.key not in node.decorators:
            return decorated(node, ON_FAILURE.key, tree.node(element.children[1]))
    return _composite("selector")(tree, element)


def noted(translate: Translate) -> Translate:
    """Return a translator that first remarks on the difference in the catalogue."""

    def remark(tree: TreeImport, element: Element) -> YamlNode:
        tree.note(element, BUILTINS[node_id(element)].note)
        return translate(tree, element)

    return remark


def _parallel(tree: TreeImport, element: Element) -> YamlNode:
    children = tuple(map(tree.node, element.children))
    total = len(children)
    success = _threshold(tree.constant(element, "success_count", "-1"), total)
    failure = _threshold(tree.constant(element, "failure_count", "1"), total)
    if success >= total:
        return YamlNode(key="parallel", children=children)
    if failure != total - success + 1:
        tree.note(
            element,
            f"it fails after {failure} failure{'s' * (failure > 1)}; ours fails when "
            f"{f'fewer than {success}' if success > 1 else 'none'} can still succeed",
        )
    wanted: Data = Raw("one") if success == 1 else success
    return YamlNode(key="parallel", value={"succeed_on": wanted}, children=children)


def _threshold(text: str, total: int) -> int:
    number = int(text)
    return max(number + total + 1, 1) if number < 0 else number


def _parallel_all(tree: TreeImport, element: Element) -> YamlNode:
    return YamlNode(key="parallel", children=tuple(map(tree.node, element.children)))


def _if_then_else(tree: TreeImport, element: Element) -> YamlNode:
    cases: list[tuple[Element, Raw]] = []
    rest = [element]
    # An exported 'choose' consists of such nodes inside each other.
    while rest and (
        element is rest[0] or (rest[0].tag == "IfThenElse" and not rest[0].attributes)
    ):
        condition_node, then, *otherwise = rest[0].children
        text = _condition_text(tree, condition_node)
        if text is None:
            break
        cases.append((then, text))
        rest = otherwise
    return choose(tree, cases, rest) if cases else _by_result(tree, element)


def choose(
    tree: TreeImport, cases: Sequence[tuple[Element, Raw]], otherwise: Sequence[Element] = ()
) -> YamlNode:
    """Return the choice between cases with their conditions and at most one other element."""
    translations = [
        partial(_numbered_case, tree, element, condition, number)
        for number, (element, condition) in enumerate(cases, start=1)
    ]
    nodes = tree.names.exclusive([*translations, *(partial(tree.branch, o) for o in otherwise)])
    options: dict[str, Data] = {"otherwise": nodes.pop()} if otherwise else {}
    return YamlNode(key="choose", value=options, children=tuple(nodes))


def _by_result(tree: TreeImport, element: Element) -> YamlNode:
    """Return nodes that choose by the result of a node instead of by a condition."""
    condition_node, first, *otherwise = element.children
    if not otherwise:
        return sequence(tree.node(condition_node), tree.branch(first))
    name, *steps = _result_of(tree, condition_node)
    return sequence(*steps, choose(tree, [(first, Raw(name))], otherwise))


def _numbered_case(tree: TreeImport, element: Element, condition: Raw, number: int) -> YamlNode:
    """Return a case of a ``choose``, named by its number if it has no name."""
    case = decorated(tree.branch(element), "when", condition)
    return replace(case, name=case.name or f"case_{number}")


def _condition_text(tree: TreeImport, element: Element) -> Raw | None:
    """Return the condition that an element checks, as text; None if it does more than that."""
    if node_id(element) == CHECK.key and set(element.attributes) <= {"ID", "condition"}:
        tree.names.mention(names_of_expression(element.get("condition")))
        return Raw(element.get("condition"))
    condition = _formula(tree, element)
    return None if condition is None else tree.text(condition)


def _formula(tree: TreeImport, element: Element) -> Formula | None:
    """Return the condition that an element checks; None if it does more than that."""
    if node_id(element) != "ScriptCondition" or set(element.attributes) - {"code", "ID"}:
        return None
    try:
        return tree.condition(element.attributes["code"])
    except Untranslatable:
        return None


def _while_do_else(tree: TreeImport, element: Element) -> YamlNode:
    condition_node, *branches = element.children
    condition = _formula(tree, condition_node)
    if condition is not None:
        return _while(tree, branches, tree.text(condition), tree.text(negated(condition)))
    if has_skill(condition_node):
        tree.note(element, BUILTINS[node_id(element)].note)
    if len(branches) == 1:
        if has_skill(condition_node):
            return reactive_sequence(tree, element)
        return _reactive("sequence", tree.node(condition_node), tree.branch(branches[0]))
    if has_skill(condition_node):
        name = tree.names.fresh("fits")
        condition_asked = asked(tree.node(condition_node), name)
        branch = _while(tree, branches, Raw(name), Raw(f"not {name}"))
        whole = while_repeated(tree, [condition_asked], branch)
        return sequence(YamlNode(key="set", value={name: False}), *whole.children)
    name, *steps = _result_of(tree, condition_node)
    return _reactive("sequence", *steps, _while(tree, branches, Raw(name), Raw(f"not {name}")))


def _while(tree: TreeImport, branches: list[Element], text: Raw, opposite: Raw) -> YamlNode:
    """Return nodes that run the first branch while a condition is true, else the second."""
    nodes = [
        tree.decorate(branch, tree.node(branch), "while", condition)
        for branch, condition in zip(branches, (text, opposite), strict=False)
    ]
    return nodes[0] if len(nodes) == 1 else _reactive("selector", *nodes)


def _result_of(tree: TreeImport, condition_node: Element) -> tuple[str, YamlNode, YamlNode]:
    """Return a name for the result of a node, and the nodes that set it."""
    name = tree.names.fresh("fits")
    fits = sequence(tree.node(condition_node), YamlNode(key="set", value={name: True}))
    return name, YamlNode(key="set", value={name: False}), decorated(fits, "succeed", True)


def _reactive(key: str, *children: YamlNode) -> YamlNode:
    return YamlNode(key=key, value={"memory": False}, children=children)


def _switch(tree: TreeImport, element: Element) -> YamlNode:
    variable = _operand(tree, element.attributes["variable"])
    *branches, default = element.children
    keys = _switch_keys(tree, element, len(branches))
    conditions = [tree.text(Binary("==", variable, key)) for key in keys]
    return choose(tree, list(zip(branches, conditions, strict=True)), [default])


def _switch_keys(tree: TreeImport, element: Element, cases: int) -> list[Formula]:
    """Return what each case is compared with; a variable has one kind, so mixed keys are text."""
    attributes = [element.attributes[f"case_{number}"] for number in range(1, cases + 1)]
    keys = [_operand(tree, attribute) for attribute in attributes]
    kinds = {type(key.value) for key in keys if isinstance(key, Constant)}
    mixed = len(kinds) > 1 and kinds != {int, float}
    return [
        Constant(attribute.value) if mixed and isinstance(key, Constant) else key
        for attribute, key in zip(attributes, keys, strict=True)
    ]


def _operand(tree: TreeImport, attribute: Attribute) -> Formula:
    text = attribute.value
    entry = pointed_at(text)
    if entry is not None:
        return Name(tree.names.rename(entry))
    if _NUMBER.fullmatch(text):
        return Constant(float(text) if "." in text else int(text))
    return Constant(text == "true" if text in ("true", "false") else text)


def _try_catch(tree: TreeImport, element: Element) -> YamlNode:
    if element.get("catch_on_halt", "false").lower() in ("true", "1"):
        tree.lost(
            element.attributes["catch_on_halt"],
            "what to do when the node is stopped; 'on_cancel' says it for the whole agent",
        )
    *tried, caught = element.children
    handler = decorated(tree.node(caught), "fail", True)
    return decorated(sequence(*map(tree.node, tried)), ON_FAILURE.key, handler)


CONTROLS: Mapping[str, Translate] = {
    "Sequence": _composite("sequence"),
    "AsyncSequence": _composite("sequence"),
    "ReactiveSequence": _composite("sequence", memory=False),
    "SequenceWithMemory": noted(_composite("sequence")),
    "Fallback": _fallback,
    "AsyncFallback": _composite("selector"),
    "ReactiveFallback": _composite("selector", memory=False),
    "Parallel": _parallel,
    "ParallelAll": noted(_parallel_all),
    "IfThenElse": _if_then_else,
    "WhileDoElse": _while_do_else,
    **{f"Switch{cases}": noted(_switch) for cases in range(2, 7)},
    "TryCatch": _try_catch,
}
"""Translator of each built-in control node."""
