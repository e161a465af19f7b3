# SPDX-License-Identifier: Apache-2.0
"""Types of written values: declared by subtrees, and the same wherever a name is written."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import ReadError
from tree_harness import agent


def report(tree: str, subtree: str = "") -> str:
    """Return the diagnostics of an agent and of the subtree that it calls."""
    with pytest.raises(ReadError) as error:
        agent(tree, f"subtrees: {{measure: {{{subtree}}}}}" if subtree else "")
    assert len(error.value.lines) == 1
    return error.value.report


def test_number_output_cannot_come_from_answer():
    text = report(
        "subtree: measure",
        "outputs: {level: {type: number}}, tree: {ask: x, outputs: {level: answer}}",
    )
    assert "output 'level': expected a number, but 'ask' gives it a text" in text
    assert "declare it as it is, {level: text}, or give it another value" in text


def test_number_output_cannot_come_from_subtree_text():
    inner = "inner: {outputs: {level: text}, tree: {set: {level: four}}}"
    with pytest.raises(ReadError, match="expected a number, but 'subtree' gives it a text"):
        agent(
            "subtree: measure",
            "subtrees: {measure: {outputs: {level: number}, tree: {subtree: inner}}, "
            f"{inner}}}",
        )


@pytest.mark.parametrize(
    ("output", "value", "found", "hint"),
    [
        ("number", "four", "'level': expected a number, found 'four'", ""),
        ("boolean", "flase", "'level': expected true or false, found 'flase'", "write false"),
        ("boolean", "'${1 + 1}'", "expected true or false, but '1 + 1' gives a number", ""),
        ("duration", "3 m", "'level'", ""),
    ],
)
def test_set_value_is_read_as_declared_output_type(output, value, found, hint):
    text = report(
        "subtree: measure", f"outputs: {{level: {output}}}, tree: {{set: {{level: {value}}}}}"
    )
    assert found in text
    assert hint in text


def test_number_set_into_text_output_becomes_text():
    spec = agent(
        "subtree: measure", "subtrees: {measure: {outputs: {a: text}, tree: {set: {a: 12}}}}"
    )
    assert spec.tree.children[0].fields["a"].value == "12"


def test_second_type_for_name_is_rejected():
    text = report("sequence: [set: {came: false}, set: {came: flase}]")
    assert "'came' gets a text here, but true or false from 'set' in line 8" in text
    assert "did you mean 'false'?" in text
    text = report("sequence:\n  - set: {answer: 1}\n  - ask: x\n")
    assert "'answer' gets a text here, but a number from 'set' in line 9" in text


def test_copy_of_answer_is_a_text():
    text = report("sequence: [ask: x, set: {level: '${answer}'}, check: level >= 4]")
    assert "'>=' needs a number on each side, found a text" in text


def test_skills_may_share_output_name_across_types():
    agent("sequence: [ask: x, {drive: x, outputs: {answer: remaining}}]")
