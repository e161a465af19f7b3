# SPDX-License-Identifier: Apache-2.0
"""Laws of export and import: a tree comes back from BehaviorTree.CPP unchanged."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_groot.document import read_document
from bt_agents_groot.expressions import parse_formula
from bt_agents_groot.formulas import (
    Binary,
    Constant,
    Formula,
    Name,
    Unary,
    as_expression,
    as_script,
)
from bt_agents_groot.scripts import parse_script
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Raw, YamlNode, yaml_lines
from bt_agents_language.yaml.source import Source
from file_texts import read_agent_text
from tree_harness import SYMBOLS
from tree_shape import shape

START = YamlNode(key="set", value={"x": 1, "t": "hello", "b": True})
CONDITIONS = ["x > 2", "b", "not b", "t == 'a'", "scene.age >= 4 and (b or x < 3)", "live.person"]
ELSEWHERE = ["max(x, 2) > 1", "x % 2 == 0"]
TIMES = ["250 ms", "2 s", "2.5 s", "90 s", "3 min", "${x}"]
conditions = st.sampled_from([*CONDITIONS, *ELSEWHERE]).map(Raw)
times = st.sampled_from(TIMES).map(Raw)
counts = st.sampled_from(["2", "forever", "${x}"]).map(Raw)
texts = st.sampled_from(["Hello.", "a: b # c", "'x'", "3", "true", "{x}", "${t}", "So ${t}!"])
switches = st.just(True)
labels = st.sampled_from(["", "greet", "on the way"])


def node(key: str, value: Any, **more: Any) -> st.SearchStrategy[YamlNode]:
    """Return nodes of a key; the other arguments are strategies."""
    return st.builds(YamlNode, key=st.just(key), value=value, **more)


numbers = st.integers(-9, 9) | st.floats(-9, 9)
leaves = st.one_of(
    node("check", conditions | st.booleans()),
    node("wait", times),
    node("wait_for", conditions),
    node("say", texts),
    node("set", st.dictionaries(st.sampled_from(["x", "y"]), numbers, min_size=1)),
    st.just(YamlNode(key="set", value={"u": "${t}!", "v": ["a", Raw("${x}")]})),
    st.just(YamlNode(key="ask", value="Well?", siblings={"outputs": {"reply": "answer"}})),
    st.just(YamlNode(key="log", value={"message": "x is ${x}", "level": "warning"})),
    st.just(YamlNode(key="show", value={"text": "3", "duration": Raw("2 s")})),
)


def _composites(children: st.SearchStrategy[YamlNode]) -> st.SearchStrategy[YamlNode]:
    listed = st.lists(children, min_size=1, max_size=3).map(tuple)
    pairs = st.lists(children, min_size=2, max_size=3).map(tuple)
    cases = st.lists(children, min_size=1, max_size=3).flatmap(_cases)
    memory = st.sampled_from([{}, {"memory": False}])
    succeed_on = st.sampled_from([{}, {"succeed_on": Raw("one")}])
    otherwise = st.sampled_from([{}, {"otherwise": YamlNode(key="check", value=True)}])
    return st.one_of(
        node("sequence", memory, children=listed, name=labels),
        node("selector", memory, children=listed, name=labels),
        node("parallel", succeed_on, children=pairs, name=labels),
        node("choose", otherwise, children=cases),
        st.builds(YamlNode, key=st.just("random"), children=listed),
    )


def _cases(nodes: list[YamlNode]) -> st.SearchStrategy[tuple[YamlNode, ...]]:
    return st.lists(conditions, min_size=len(nodes), max_size=len(nodes)).map(
        lambda whens: tuple(
            replace(node, name=f"case {at}", decorators={**node.decorators, "when": when})
            for at, (node, when) in enumerate(zip(nodes, whens, strict=True))
        )
    )


def _modified(nodes: st.SearchStrategy[YamlNode]) -> st.SearchStrategy[YamlNode]:
    decorators = st.fixed_dictionaries(
        {},
        optional={
            "when": conditions,
            "once": switches,
            "cooldown": times,
            "succeed": switches,
            "fail": switches,
            "while": conditions,
            "on_failure": leaves,
            "retry": counts | st.just({"attempts": 2, "pause": Raw("1 s")}),
            "repeat": counts | st.just({"until": Raw("b"), "pause": Raw("1 s")}),
            "timeout": times,
            "invert": switches,
        },
    ).filter(lambda found: not {"succeed", "fail"} <= found.keys())
    return st.builds(
        lambda node, more: replace(node, decorators={**more, **node.decorators}), nodes, decorators
    )


trees = st.recursive(
    _modified(leaves), lambda inner: _modified(_composites(inner)) | inner, max_leaves=8
)


def elements(element: Element) -> object:
    attributes = {name: one.value for name, one in element.attributes.items()}
    return element.tag, attributes, [elements(child) for child in element.children]


@given(trees)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_tree_survives_round_trip(tree):
    head = {"format": 1, "agent": "a", "profile": {"age": 3, "familiarity": 3, "mood": 3}}
    whole = YamlNode(key="sequence", children=(START, tree))
    text = "\n".join(yaml_lines({**head, "tree": whole})) + "\n"
    there = export_agent(Source("a.yaml", text), SYMBOLS)
    back = import_agent(Source("t.xml", there.text), "a", SYMBOLS)
    before = read_agent_text(text, "a.yaml", SYMBOLS)
    assert shape(read_agent_text(back.text, "b.yaml", SYMBOLS).tree) == shape(before.tree)
    again = export_agent(Source("b.yaml", back.text), SYMBOLS)
    first, second = (
        read_document(Source("t.xml", text)).trees["A"] for text in (there.text, again.text)
    )
    assert elements(first) == elements(second)


names = st.sampled_from(["a", "b", "scene.age", "live.person"])
constants = st.one_of(
    st.integers(0, 99), st.sampled_from([0.5, 2.25]), st.booleans(), st.sampled_from(["", "x y"])
)
formulas: st.SearchStrategy[Formula] = st.recursive(
    names.map(Name) | constants.map(Constant),
    lambda inner: st.one_of(
        st.builds(
            Binary,
            st.sampled_from(["and", "or", "==", "!=", "<", "<=", ">", ">=", "+", "-", "*", "/"]),
            inner,
            inner,
        ),
        st.builds(Unary, st.just("not"), inner),
        st.builds(Unary, st.just("-"), names.map(Name)),
    ),
    max_leaves=12,
)


@given(formulas)
@settings(max_examples=300, deadline=None, derandomize=True)
def test_formula_is_the_same_in_both_languages(formula):
    dotted = {"scene__age": "scene.age", "live__person": "live.person"}
    [read] = parse_script(as_script(formula), lambda name: dotted.get(name, name))
    if not _joins(formula):
        assert read == formula
    assert parse_formula(as_expression(formula)) == formula


def _joins(formula: Formula) -> bool:
    """Return whether a '+' has a text next to it, which scripts treat as joining."""
    match formula:
        case Binary("+", left, right):
            texts = (isinstance(o, Constant) and isinstance(o.value, str) for o in (left, right))
            return any(texts) or _joins(left) or _joins(right)
        case Binary(_, left, right):
            return _joins(left) or _joins(right)
        case Unary(_, operand):
            return _joins(operand)
    return False
