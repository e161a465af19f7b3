# SPDX-License-Identifier: Apache-2.0
"""Product modules never base a decision on text for people."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from product_modules import product_modules

PROSE = {
    "additional_constraints",
    "calculation",
    "description",
    "expected",
    "explanation",
    "failure",
    "fallback",
    "feedback_message",
    "hint",
    "intervention",
    "message",
    "obstacle",
    "precedence",
    "problem",
    "reason",
    "refusal",
    "why",
    "words",
}
"""Names of texts for people."""

LOOKS = {
    "endswith",
    "find",
    "index",
    "partition",
    "removeprefix",
    "removesuffix",
    "rfind",
    "rpartition",
    "split",
    "startswith",
}
MATCHES = {"findall", "finditer", "fullmatch", "match", "search"}
DRESSED = {"casefold", "lower", "lstrip", "rstrip", "strip", "upper"}

FORMATTED = {
    ("bt_agents_tools.rehearsal.assertions", "expected != _NOTHING"),
    ("bt_agents_tools.rehearsal.assertions", "expected == _NOTHING"),
}
"""Code that only formats a text, or reads a person's input."""


def name_of(node: ast.expr) -> str:
    """Return the name of a value: ``reason`` for ``str(answer.reason).strip()[2:]``."""
    match node:
        case ast.Name():
            return node.id
        case ast.Attribute():
            return node.attr
        case ast.Subscript():
            return name_of(node.value)
        case ast.BoolOp():
            return name_of(node.values[0])
        case ast.Call(func=ast.Attribute(attr=attr, value=value)) if attr in DRESSED:
            return name_of(value)
        case ast.Call(func=ast.Name(id="str"), args=[value]):
            return name_of(value)
    return ""


def is_text(node: ast.expr) -> bool:
    """Return whether a value is certainly a part of a text."""
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str) and bool(node.value)
    )


def is_sentence(node: ast.expr) -> bool:
    """Return whether a value is certainly several words, or a constant that may be."""
    if isinstance(node, ast.Name):
        return node.id.isupper()
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value


def decisions(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield code that reads a text for people."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(attr=attr, value=value)) if attr in LOOKS:
                # Without an argument, ``split`` looks only for white space.
                if name_of(value) in PROSE and node.args:
                    yield node
            case ast.Call(func=ast.Attribute(attr=attr)) if attr in MATCHES:
                if any(name_of(argument) in PROSE for argument in node.args):
                    yield node
            case ast.Compare(left=left, ops=[ast.In() | ast.NotIn()], comparators=[text]):
                if is_text(left) and name_of(text) in PROSE:
                    yield node
            case ast.Compare(left=left, ops=[ast.Eq() | ast.NotEq()], comparators=[right]):
                for one, other in ((left, right), (right, left)):
                    if name_of(one) in PROSE and is_sentence(other):
                        yield node


@pytest.mark.parametrize(
    "source",
    [
        "answer.reason.startswith('needs ')",
        "str(message.message).lower().endswith(CUT_OFF)",
        "_UNIT.fullmatch(descriptor.description)",
        "re.search('late', result.message)",
        "'late' in found.reason",
        "f'{name}: ' not in self.words[0]",
        "end.message == 'the market stopped it'",
        "end.message == AS_TOLD",
        "reason.partition(': ')[0]",
    ],
)
def test_decision_based_on_prose_is_found(source: str) -> None:
    assert list(decisions(ast.parse(source)))


def test_sources_decide_nothing_based_on_prose() -> None:
    found = {
        (name, ast.unparse(node))
        for name, path in product_modules().items()
        for node in decisions(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found == FORMATTED
