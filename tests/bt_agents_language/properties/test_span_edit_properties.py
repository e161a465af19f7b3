# SPDX-License-Identifier: Apache-2.0
"""Laws of edits: the new value is in the file, and all other text is unchanged."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.scalars import value_type
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.span_edit import replace_value
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence, read_yaml

TREES = Path(__file__).parents[3] / "trees"
SEEDS = [
    "a: 1  # one\n\nb: {c: 'x', d: [5 s, \"y\"]}\ne:\nf: |  # sign\n  text\n# end\ng:   z # z\n",
    "- 1\n-\n- [a, b: c]\n- 'it''s'\n- two\n  lines\n- \"a\n  b\"\n",
    "windows: 1\r\n# c\r\nlines: x\r\n",
    *(path.read_text(encoding="utf-8") for path in sorted(TREES.rglob("*.yaml"))),
]
TEXTS = [
    "0.95", "8 s", "true", "yes", "", " x ", "a: b", "a #b", "it's", 'say "hi"', "- x", "[1]",
    "Where to?", "${x}", "~", "null", "two\nlines", "{a", "}", ", ", "\\", "#", "?",
]  # fmt: skip
LETTERS = st.characters(codec="utf-8", categories=["L", "N", "P", "S", "Zs"])
NEW = st.one_of(st.sampled_from(TEXTS), st.text(LETTERS))


def read(text: str) -> Node:
    problems = Diagnostics(None)
    root = read_yaml(Source("a.yaml", text), problems)
    problems.raise_if_any()
    assert root is not None
    return root


def values(node: Node, path: str = "") -> Iterator[tuple[str, Scalar]]:
    match node:
        case Scalar():
            yield path, node
        case Sequence():
            for number, item in enumerate(node.items):
                yield from values(item, f"{path}/{number}")
        case Mapping():
            for entry in node.entries:
                yield from values(entry.value, f"{path}/{entry.key.text}")


@settings(deadline=None, max_examples=300)
@given(st.sampled_from(SEEDS), st.integers(0), NEW)
def test_edit_changes_exactly_one_value(text, at, new):
    source = Source("a.yaml", text)
    before = list(values(read(text)))
    path, node = before[at % len(before)]
    changed = replace_value(source, node, new)
    after = dict(values(read(changed)))
    assert after[path].text == new
    assert value_type(node) is not str or value_type(after[path]) is str
    assert {p: n.text for p, n in before if p != path} == {
        p: n.text for p, n in after.items() if p != path
    }
    start, end = node.span
    assert changed.startswith(text[:start])
    assert changed.endswith(text[end:])
    assume("\n" not in text[start:end])
    diff = difflib.ndiff(text.splitlines(), changed.splitlines())
    assert sum(line.startswith("+ ") for line in diff) <= 1


@given(st.sampled_from(SEEDS), st.integers(0))
def test_replacing_value_with_itself_changes_no_values(text, at):
    before = list(values(read(text)))
    path, node = before[at % len(before)]
    again = dict(values(read(replace_value(Source("a.yaml", text), node, node.text))))
    assert again[path].text == node.text
    assert value_type(again[path]) is value_type(node)


def test_edit_keeps_plain_and_quoted_style():
    source = Source("a.yaml", "a: 0.9  # rate\nb: 'x'\nc: hello\n")
    nodes = dict(values(read(source.text)))
    assert replace_value(source, nodes["/a"], "1.05") == "a: 1.05  # rate\nb: 'x'\nc: hello\n"
    assert replace_value(source, nodes["/b"], "it's") == "a: 0.9  # rate\nb: 'it''s'\nc: hello\n"
    assert replace_value(source, nodes["/c"], "5") == "a: 0.9  # rate\nb: 'x'\nc: \"5\"\n"


def test_comment_after_block_sign_is_kept():
    source = Source("a.yaml", "a: |  # sign\n  text\nb: 1\n")
    node = dict(values(read(source.text)))["/a"]
    assert replace_value(source, node, "new") == 'a: "new"  # sign\nb: 1\n'


def test_value_of_another_text_is_rejected():
    source = Source("a.yaml", "a: 1\n")
    other = dict(values(read("a:    1\n")))["/a"]
    with pytest.raises(ValueError, match=r"a\.yaml:1:7: '1' is not a value of this file"):
        replace_value(source, other, "2")


def test_characters_invalid_in_yaml_are_rejected():
    source = Source("a.yaml", "a: 1\n")
    with pytest.raises(ValueError, match="cannot be written into a file"):
        replace_value(source, dict(values(read(source.text)))["/a"], "\0")
