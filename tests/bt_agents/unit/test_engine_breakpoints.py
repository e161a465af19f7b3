# SPDX-License-Identifier: Apache-2.0
"""Breakpoints: a node is stopped before it starts, and everything else is as without them."""

from __future__ import annotations

from typing import Any

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import Stage

LONG = {"say": [ScriptedReply(after_s=100.0)]}


def stopped(tree: str, *paths: str, **how: Any) -> Stage:
    stage = Stage(tree, **how)
    stage.run.set_breakpoints(paths)
    return stage


def test_a_node_is_stopped_before_it_does_anything_and_starts_at_the_next_tick() -> None:
    stage = stopped("sequence: [{say: one}, {say: two}]", "tree/1.say")
    stage.tick()
    assert stage.run.held == ("tree/1.say",)
    assert (stage.said, stage.status("1.say"), stage.run.tip) == (["one"], "RUNNING", "tree/1.say")
    assert stage.tick() == "succeeded"
    assert (stage.said, stage.run.held) == (["one", "two"], ())


def test_the_root_can_be_stopped_before() -> None:
    stage = stopped("say: hello", "tree")
    stage.tick()
    assert (stage.run.held, stage.said) == (("tree",), [])
    assert stage.tick() == "succeeded"


def test_a_node_that_was_stopped_before_is_running_once_in_what_is_told() -> None:
    stage = stopped("say: hello", "tree", answers=LONG)
    stage.tick(3)
    assert stage.reports("tree") == [("RUNNING", "")]


def test_children_of_a_parallel_beside_it_are_ticked_in_the_same_tick() -> None:
    stage = stopped("parallel: [{say: one}, {show: two}]", "tree/0.say")
    stage.tick()
    assert stage.asked == ["show"]
    assert stage.tick() == "succeeded"


def test_a_node_that_is_stopped_in_the_same_tick_does_not_wait() -> None:
    tree = "selector: [{parallel: [{say: one}, {check: scene.age > 4}]}, {say: two}]"
    stage = stopped(tree, "tree/0.parallel/0.say", answers=LONG)
    stage.tick()
    assert stage.run.held == ()
    assert stage.said == ["two"]


def test_each_round_of_a_repeat_stops() -> None:
    stage = stopped("repeat: {times: 2}\nsay: hello", "tree")
    held = []
    while stage.outcome == "running":
        stage.tick()
        held.append(stage.run.held)
    assert held == [("tree",), (), ("tree",), ()]


def test_a_node_whose_condition_is_not_true_is_not_stopped_before() -> None:
    stage = stopped("sequence: [{say: one, when: mood.change > 3}, {say: two}]", "tree/0.say")
    assert stage.tick() == "succeeded"
    assert stage.said == ["two"]


def test_one_that_is_interrupted_while_it_waits_has_done_nothing_and_is_stopped_again() -> None:
    stage = stopped("say: hello", "tree")
    stage.tick()
    stage.interrupt()
    assert stage.status("tree") == "INVALID"
    stage.tick()
    assert (stage.run.held, stage.said) == (("tree",), [])


def test_one_that_is_interrupted_and_has_no_breakpoint_any_more_starts_once() -> None:
    stage = stopped("say: hello", "tree", answers=LONG)
    stage.tick()
    stage.run.set_breakpoints(())
    stage.interrupt()
    stage.tick(5)
    assert stage.said == ["hello"]


def test_a_breakpoint_that_is_removed_while_a_node_waits_lets_it_start() -> None:
    stage = stopped("sequence: [{say: one}, {say: two}]", "tree/0.say", "tree/1.say")
    stage.tick()
    stage.run.set_breakpoints(())
    assert stage.tick() == "succeeded"


def test_breakpoints_are_set_while_the_tree_runs() -> None:
    stage = Stage("sequence: [{say: one}, {say: two}]", answers=LONG)
    stage.tick()
    stage.run.set_breakpoints(("tree/1.say",))
    stage.after(100.0)
    assert (stage.run.held, stage.said) == (("tree/1.say",), ["one"])


def test_a_cancel_while_a_node_waits_cleans_up_and_starts_nothing() -> None:
    stage = stopped("say: hello", "tree", head="on_cancel: {say: good-bye}")
    stage.tick()
    stage.run.cancel("enough")
    while stage.outcome == "running":
        stage.tick()
    assert (stage.outcome, stage.said) == ("cancelled", ["good-bye"])


def test_a_tick_of_the_clean_up_keeps_nothing_from_starting() -> None:
    stage = stopped("say: hello", "tree", head="on_cancel: {wait: 1 s}")
    stage.tick()
    stage.run.cancel("enough")
    stage.tick()
    assert (stage.outcome, stage.run.held) == ("running", ())


def test_the_clean_up_is_not_stopped() -> None:
    stage = stopped("say: hello", "on_cancel", head="on_cancel: {say: good-bye}", answers=LONG)
    stage.tick()
    stage.run.cancel("enough")
    stage.tick()
    assert stage.said == ["hello", "good-bye"]


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
def test_a_tree_that_is_stopped_everywhere_ends_as_without_and_says_the_same(tree: str) -> None:
    plain, stage = Stage(tree), Stage(tree)
    every = [node.spec.path for node in stage.root.iterate()]
    stage.run.set_breakpoints(every)
    for one in (plain, stage):
        ticks = 0
        while one.outcome == "running":
            one.tick()
            ticks += 1
            assert ticks < 100
    assert (stage.outcome, len(stage.said)) == (plain.outcome, len(plain.said))
    assert stage.run.ticks > plain.run.ticks


def test_the_name_of_the_tip_has_the_values_it_runs_with() -> None:
    tunable = "tunables:\n  words: {default: hello, description: d}"
    stage = Stage('say: "${words}!"', head=tunable, answers=LONG)
    stage.run.set_breakpoints(("tree",))
    stage.tick()
    assert stage.run.tip_name == 'say "${words}!"'
    stage.tick()
    assert stage.run.tip_name == 'say "hello!"'
