# SPDX-License-Identifier: Apache-2.0
"""Decorators that guard or skip a node, or fix its outcome, tick by tick."""

from __future__ import annotations

import importlib
import itertools
import pkgutil
import re

import pytest

from bt_agents.engine import nodes as behaviours
from bt_agents.engine.run import BEHAVIOURS
from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents_core.field_types import Plain
from bt_agents_language.nodes import catalogue
from tree_harness import FAILS, LONG, TreeHarness, failure, scene, started

SECOND = [ScriptedReply(after_s=1.0)]
TUNABLE = "tunables: {t: {default: 0 s, min: 0 s, max: 60 s, description: d}}"
COOLING = "repeat: forever\nsequence: [{say: x, cooldown: '${t}'}]"


def test_behaviours_match_node_types_exactly() -> None:
    # The children of ``choose`` and ``random`` are decorators that no file names.
    assert set(BEHAVIOURS) == {*catalogue.NODE_TYPES, *catalogue.DECORATORS, *catalogue.BRANCHES}


def test_no_two_node_modules_share_a_key() -> None:
    named = [
        key
        for module in pkgutil.iter_modules(behaviours.__path__)
        for key in importlib.import_module(f"{behaviours.__name__}.{module.name}").BEHAVIOURS
    ]
    assert sorted(named) == sorted(BEHAVIOURS)


WRITTEN = {
    "when": "true",
    "once": "true",
    "cooldown": "5 s",
    "succeed": "true",
    "fail": "true",
    "on_failure": "{say: sorry}",
    "while": "true",
    "retry": "2",
    "repeat": "2",
    "timeout": "5 s",
    "invert": "true",
}


PAIRS = [
    pair
    for pair in itertools.combinations(WRITTEN, 2)
    # Both together are a contradiction.
    if pair != ("succeed", "fail")
]


def test_pairs_cover_every_modifier() -> None:
    assert list(WRITTEN) == list(catalogue.DECORATORS)


@pytest.mark.parametrize(("outer", "inner"), PAIRS)
def test_modifiers_nest_in_documented_order(outer: str, inner: str) -> None:
    harness = TreeHarness(f"{inner}: {WRITTEN[inner]}\nsay: x\n{outer}: {WRITTEN[outer]}")
    node, kinds = harness.root, [harness.root.spec.kind]
    while node.children:
        node = node.children[0]
        kinds.append(node.spec.kind)
    assert kinds == [outer, inner, "say"]
    for _ in range(9):
        harness.after(10.0)
    assert harness.outcome in ("succeeded", "failed")


def test_while_halts_node_when_its_condition_turns_false() -> None:
    #  t | mood | say       | while
    #  0 |  3   | R         |   R
    #  1 |  3   | R         |   R
    #  2 |  1   | cancelled |   F
    harness = TreeHarness("say: x\nwhile: live.mood >= 2", answers={"say": LONG})
    assert harness.outcomes(0, 1) == "RR"
    harness.set_mood(1.0)
    assert harness.after(1.0) == "failed"
    assert harness.environment.running() == []
    assert harness.message.startswith(
        "not so any more: live.mood >= 2 (live.mood is 1) (tree@while, a.yaml:"
    )


@pytest.mark.parametrize(
    ("condition", "words"),
    [("scene.mood > 4", "not so: scene.mood > 4 ("), ("live.age > 1", "'live.age' has no value")],
)
def test_while_without_true_condition_starts_nothing(condition: str, words: str) -> None:
    harness = started(f"say: x\nwhile: {condition}", awarded=scene(mood=3))
    assert (harness.outcome, harness.said) == ("failed", [])
    assert harness.message.startswith(words)


def test_while_fails_when_its_condition_cannot_be_evaluated() -> None:
    harness = started("say: x\nwhile: 1 / live.mood > 0", answers={"say": LONG})
    harness.set_mood(0.0)
    assert harness.tick() == "failed"
    assert "by zero" in harness.message
    assert harness.environment.running() == []


def test_while_ends_in_same_tick_as_its_node() -> None:
    harness = started("say: x\nwhile: live.mood >= 2", answers={"say": SECOND})
    assert harness.after(1.0) == "succeeded"


def test_blocked_while_does_not_report_an_earlier_reason() -> None:
    head = "subtrees: {go: {tree: {drive: x, while: live.mood >= 2}}}"
    harness = TreeHarness("subtree: go\nretry: 2", head=head, answers={"drive": FAILS})
    assert harness.tick() == "running"
    harness.set_mood(1.0)
    assert harness.tick() == "failed"
    assert "not so: live.mood >= 2" in harness.message


@pytest.mark.parametrize(
    ("tree", "asked", "left_out"),
    [
        ("sequence: [{say: x, once: true}, {show: y}]", ["say", *["show"] * 3], "SUCCESS"),
        ("selector: [{drive: x, once: true}, {say: y}]", ["drive", *["say"] * 3], "FAILURE"),
    ],
)
def test_once_skips_node_after_its_first_end(tree: str, asked: list[str], left_out: str) -> None:
    harness = TreeHarness(f"repeat: 3\n{tree}", answers={"drive": FAILS})
    assert (harness.tick(3), harness.asked) == ("succeeded", asked)
    told = harness.reports(f"tree/0.{asked[0]}@once")
    assert told[-1] == (left_out, "left out: done once already")


def test_cooldown_skips_node_for_its_duration() -> None:
    #  t | say | repeat
    #  0 |  R  |   R
    #  1 |  S  |   R      cooldown from here
    #  2 | out |   R
    #  5 | out |   R
    #  6 |  R  |   R
    harness = started(
        "repeat: forever\nsequence: [{say: x, cooldown: 5 s}]", answers={"say": SECOND}
    )
    harness.outcomes(1, 1)
    left_out = ("SUCCESS", "left out: done less than 5 s ago")
    assert left_out in harness.reports("tree/0.say@cooldown")
    harness.after(3.9)
    assert len(harness.said) == 1
    harness.after(0.1)
    assert len(harness.said) == 2


def test_zero_cooldown_skips_nothing_and_is_tunable() -> None:
    harness = TreeHarness(COOLING, head=TUNABLE)
    harness.tick(3)
    assert len(harness.said) == 3
    harness.tunables["t"] = 10.0
    harness.after(9.0)
    assert len(harness.said) == 3
    harness.tunables["t"] = 9.0
    harness.tick()
    assert len(harness.said) == 4


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), "soon", True, 10**400])
@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ("wait: ${t}", "expected a time such as '5 s'"),
        ("show: {text: x}\ntimeout: ${t}", "expected a time such as '5 s'"),
        ("wait_for: {condition: 1 > 0, for: '${t}'}", "expected a time such as '5 s'"),
        (COOLING.replace("forever", "2"), "expected a time such as '5 s'"),
        ("random: [{say: a, weight: '${t}'}, {say: b}]", "'weight' is .*a number from 0 on"),
    ],
)
def test_invalid_duration_or_weight_fails_with_message(
    tree: str, words: str, value: Plain
) -> None:
    harness = TreeHarness(tree, head=TUNABLE, answers={"show": LONG})
    harness.tunables["t"] = value
    assert harness.tick(2) == "failed"
    assert re.search(words, harness.message)
    assert "a.yaml:" in harness.message
    assert harness.environment.running() == []


def test_fail_keeps_reason_of_failed_child() -> None:
    tree = "drive: x\nfail: true"
    assert failure(tree, answers={"drive": FAILS}) == "drive aborted: motor off"
    assert failure(tree).startswith("succeeded, and counts as failed (tree@fail")


def test_timeout_is_tunable_and_restarts_after_interruption() -> None:
    harness = started(
        "say: x\ntimeout: ${t}", head=TUNABLE.replace("0 s", "9 s", 1), answers={"say": LONG}
    )
    assert harness.after(8.0) == "running"
    harness.interrupt()
    assert harness.outcomes(0, 8) == "RR"
    harness.tunables["t"] = 8.0
    assert harness.tick() == "failed"


def test_timeout_reports_why_last_message_did_not_match() -> None:
    harness = started(
        "wait_for: {topic: t, type: std_msgs/msg/Bool, until: msg.data}\ntimeout: 5 s"
    )
    harness.environment.arrive("t", {"data": False})
    harness.tick()
    assert harness.after(5.0) == "failed"
    assert "not done within 5 s: the last message is not so: msg.data (tree@" in harness.message
