# SPDX-License-Identifier: Apache-2.0
"""Conditions that are neither true nor false: the node fails, and a message says so."""

from __future__ import annotations

import pytest

from tree_harness import TreeHarness

HEAD = """
subtrees:
  level_of_pain:
    outputs: {level: any}
    tree: {set: {level: four}}
"""
WHY = "cannot be decided: level >= 4 ('>=' needs numbers, found the text 'four')"


def harness(node: str) -> TreeHarness:
    """Return a run in which the level of pain is a text where a number was meant."""
    lines = node.strip().splitlines()
    tree = "sequence:\n  - subtree: level_of_pain\n  - " + "\n    ".join(lines)
    return TreeHarness(tree, head=HEAD)


CHOOSE = """
choose:
  children: [{name: pain, when: level >= 4, say: I call a nurse.}]
  otherwise: {say: Rest well.}
"""


@pytest.mark.parametrize(
    ("node", "place"),
    [
        ("say: I call a nurse.\nwhen: level >= 4", "say@when"),
        (CHOOSE, "choose/0.pain@when"),
        ("wait: 0 s\nrepeat: {until: level >= 4}", "wait@repeat"),
        ("say: x\nwhile: level >= 4", "say@while"),
        ("check: level >= 4", "check"),
        ("wait_for: level >= 4", "wait_for"),
    ],
)
def test_undecidable_condition_fails_node_with_reason_and_position(node: str, place: str) -> None:
    played = harness(node)
    assert played.tick() == "failed"
    assert played.said == []
    assert played.message.startswith(f"{WHY} (tree/1.{place}, a.yaml:")
    assert played.environment.logged == [("error", played.message)]


@pytest.mark.parametrize("node", ["say: x\nwhen: level", "check: level", CHOOSE])
def test_text_condition_does_not_count_as_false(node: str) -> None:
    played = harness(node.replace("level >= 4", "level"))
    assert played.tick() == "failed"
    assert "cannot be decided: level (it is the text 'four', expected true or false)" in (
        played.message
    )


@pytest.mark.parametrize(
    "node",
    [
        "selector: [check: level >= 4, say: Rest well.]",
        "check: level >= 4\nsucceed: true",
        "check: level >= 4\ninvert: true",
        "check: level >= 4\non_failure: {say: Rest well.}",
    ],
)
def test_handled_failure_still_reports_undecidable_condition(node: str) -> None:
    played = harness(node)
    assert played.tick() == "succeeded"
    [(level, told)] = played.environment.logged
    assert level == "error"
    assert told.startswith("cannot be decided: level >= 4 (")
    assert played.message == f"the tree succeeded; {told}"


def test_undecidable_condition_is_reported_once() -> None:
    played = harness("check: level >= 4\nretry: 5")
    assert played.tick(5) == "failed"
    assert len(played.environment.logged) == 1
    assert played.message.count("cannot be decided") == 1
