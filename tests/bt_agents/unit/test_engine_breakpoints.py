# SPDX-License-Identifier: Apache-2.0
"""Breakpoints stop a node before its start and change nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import TreeHarness, started

LONG = {"say": [ScriptedReply(after_s=100.0)]}


def stopped(tree: str, *paths: str, **how: Any) -> TreeHarness:
    harness = TreeHarness(tree, **how)
    harness.run.set_breakpoints(paths)
    return harness


def held(tree: str, *paths: str, **how: Any) -> TreeHarness:
    """Return a run after its first tick, with breakpoints."""
    harness = stopped(tree, *paths, **how)
    harness.tick()
    return harness


def test_breakpoint_holds_node_until_next_tick() -> None:
    harness = held("sequence: [{say: one}, {say: two}]", "tree/1.say")
    assert (harness.run.held, harness.run.tip) == (("tree/1.say",), "tree/1.say")
    assert (harness.said, harness.status("1.say")) == (["one"], "RUNNING")
    assert harness.tick() == "succeeded"
    assert (harness.said, harness.run.held) == (["one", "two"], ())


def test_held_node_reports_running_once() -> None:
    harness = stopped("say: hello", "tree", answers=LONG)
    harness.tick(3)
    assert harness.reports("tree") == [("RUNNING", "")]


def test_siblings_in_parallel_tick_beside_held_node() -> None:
    harness = held("parallel: [{say: one}, {show: two}]", "tree/0.say")
    assert harness.asked == ["show"]
    assert harness.tick() == "succeeded"


def test_node_halted_in_same_tick_is_not_held() -> None:
    tree = "selector: [{parallel: [{say: one}, {check: scene.age > 4}]}, {say: two}]"
    harness = held(tree, "tree/0.parallel/0.say", answers=LONG)
    assert harness.run.held == ()
    assert harness.said == ["two"]


def test_breakpoint_holds_every_repeat_round() -> None:
    harness = stopped("repeat: {times: 2}\nsay: hello", "tree")
    held = []
    while harness.outcome == "running":
        harness.tick()
        held.append(harness.run.held)
    assert held == [("tree",), (), ("tree",), ()]


def test_breakpoint_ignores_node_whose_when_is_false() -> None:
    harness = stopped("sequence: [{say: one, when: mood.change > 3}, {say: two}]", "tree/0.say")
    assert harness.tick() == "succeeded"
    assert harness.said == ["two"]


def test_interrupted_held_node_is_held_again() -> None:
    harness = held("say: hello", "tree")
    harness.interrupt()
    assert harness.status("tree") == "INVALID"
    harness.tick()
    assert (harness.run.held, harness.said) == (("tree",), [])


def test_interrupted_node_without_breakpoint_starts_once() -> None:
    harness = held("say: hello", "tree", answers=LONG)
    harness.run.set_breakpoints(())
    harness.interrupt()
    harness.tick(5)
    assert harness.said == ["hello"]


def test_removing_breakpoint_releases_held_node() -> None:
    harness = held("sequence: [{say: one}, {say: two}]", "tree/0.say", "tree/1.say")
    harness.run.set_breakpoints(())
    assert (harness.tick(), harness.said) == ("succeeded", ["one", "two"])


def test_breakpoint_set_during_run_takes_effect() -> None:
    harness = started("sequence: [{say: one}, {say: two}]", answers=LONG)
    harness.run.set_breakpoints(("tree/1.say",))
    harness.after(100.0)
    assert (harness.run.held, harness.said) == (("tree/1.say",), ["one"])


def test_cancel_of_held_node_only_cleans_up() -> None:
    harness = held("say: hello", "tree", head="on_cancel: {say: good-bye}", answers=LONG)
    harness.run.cancel("enough")
    harness.tick()
    assert (harness.outcome, harness.run.held) == ("running", ())
    assert harness.after(3.0) == "cancelled"
    assert harness.said == ["good-bye"]


def test_breakpoint_does_not_hold_cleanup() -> None:
    harness = held("say: hello", "on_cancel", head="on_cancel: {say: good-bye}", answers=LONG)
    harness.run.cancel("enough")
    harness.tick()
    assert harness.said == ["hello", "good-bye"]


@pytest.mark.parametrize(
    "tree",
    [
        "sequence: [{say: one}, {say: two}]",
        "parallel: [{say: one}, {say: two}]",
        "selector: [{say: one, invert: true}, {say: two}]",
        "repeat: {times: 3}\nsay: one",
        "retry: {attempts: 3}\nsequence: [{say: one}, {check: scene.age > 4}]",
        "random: [{say: one}, {say: two}]",
    ],
)
def test_breakpoints_on_every_node_keep_the_outcome(tree: str) -> None:
    plain, harness = TreeHarness(tree), TreeHarness(tree)
    every = [node.spec.path for node in harness.root.iterate()]
    harness.run.set_breakpoints(every)
    for one in (plain, harness):
        ticks = 0
        while one.outcome == "running":
            one.tick()
            ticks += 1
            assert ticks < 100
    assert (harness.outcome, len(harness.said)) == (plain.outcome, len(plain.said))
    assert harness.run.ticks > plain.run.ticks


def test_tip_name_shows_current_values() -> None:
    tunable = "tunables:\n  words: {default: hello, description: d}"
    harness = held('say: "${words}!"', "tree", head=tunable, answers=LONG)
    assert harness.run.tip_name == 'say "${words}!"'
    harness.tick()
    assert harness.run.tip_name == 'say "hello!"'
