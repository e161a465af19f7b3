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


def test_breakpoint_holds_node_until_next_tick() -> None:
    stage = stopped("sequence: [{say: one}, {say: two}]", "tree/1.say")
    stage.tick()
    assert stage.run.held == ("tree/1.say",)
    assert (stage.said, stage.status("1.say"), stage.run.tip) == (["one"], "RUNNING", "tree/1.say")
    assert stage.tick() == "succeeded"
    assert (stage.said, stage.run.held) == (["one", "two"], ())


def test_breakpoint_holds_the_root() -> None:
    stage = stopped("say: hello", "tree")
    stage.tick()
    assert (stage.run.held, stage.said) == (("tree",), [])
    assert stage.tick() == "succeeded"


def test_held_node_reports_running_once() -> None:
    stage = stopped("say: hello", "tree", answers=LONG)
    stage.tick(3)
    assert stage.reports("tree") == [("RUNNING", "")]


def test_siblings_in_parallel_tick_beside_held_node() -> None:
    stage = stopped("parallel: [{say: one}, {show: two}]", "tree/0.say")
    stage.tick()
    assert stage.asked == ["show"]
    assert stage.tick() == "succeeded"


def test_node_halted_in_same_tick_is_not_held() -> None:
    tree = "selector: [{parallel: [{say: one}, {check: scene.age > 4}]}, {say: two}]"
    stage = stopped(tree, "tree/0.parallel/0.say", answers=LONG)
    stage.tick()
    assert stage.run.held == ()
    assert stage.said == ["two"]


def test_breakpoint_holds_every_repeat_round() -> None:
    stage = stopped("repeat: {times: 2}\nsay: hello", "tree")
    held = []
    while stage.outcome == "running":
        stage.tick()
        held.append(stage.run.held)
    assert held == [("tree",), (), ("tree",), ()]


def test_breakpoint_ignores_node_whose_when_is_false() -> None:
    stage = stopped("sequence: [{say: one, when: mood.change > 3}, {say: two}]", "tree/0.say")
    assert stage.tick() == "succeeded"
    assert stage.said == ["two"]


def test_interrupted_held_node_is_held_again() -> None:
    stage = stopped("say: hello", "tree")
    stage.tick()
    stage.interrupt()
    assert stage.status("tree") == "INVALID"
    stage.tick()
    assert (stage.run.held, stage.said) == (("tree",), [])


def test_interrupted_node_without_breakpoint_starts_once() -> None:
    stage = stopped("say: hello", "tree", answers=LONG)
    stage.tick()
    stage.run.set_breakpoints(())
    stage.interrupt()
    stage.tick(5)
    assert stage.said == ["hello"]


def test_removing_breakpoint_releases_held_node() -> None:
    stage = stopped("sequence: [{say: one}, {say: two}]", "tree/0.say", "tree/1.say")
    stage.tick()
    stage.run.set_breakpoints(())
    assert stage.tick() == "succeeded"


def test_breakpoint_set_during_run_takes_effect() -> None:
    stage = Stage("sequence: [{say: one}, {say: two}]", answers=LONG)
    stage.tick()
    stage.run.set_breakpoints(("tree/1.say",))
    stage.after(100.0)
    assert (stage.run.held, stage.said) == (("tree/1.say",), ["one"])


def test_cancel_of_held_node_only_cleans_up() -> None:
    stage = stopped("say: hello", "tree", head="on_cancel: {say: good-bye}")
    stage.tick()
    stage.run.cancel("enough")
    while stage.outcome == "running":
        stage.tick()
    assert (stage.outcome, stage.said) == ("cancelled", ["good-bye"])


def test_cleanup_tick_holds_no_node() -> None:
    stage = stopped("say: hello", "tree", head="on_cancel: {wait: 1 s}")
    stage.tick()
    stage.run.cancel("enough")
    stage.tick()
    assert (stage.outcome, stage.run.held) == ("running", ())


def test_breakpoint_does_not_hold_cleanup() -> None:
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
def test_breakpoints_on_every_node_keep_the_outcome(tree: str) -> None:
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


def test_tip_name_shows_current_values() -> None:
    tunable = "tunables:\n  words: {default: hello, description: d}"
    stage = Stage('say: "${words}!"', head=tunable, answers=LONG)
    stage.run.set_breakpoints(("tree",))
    stage.tick()
    assert stage.run.tip_name == 'say "${words}!"'
    stage.tick()
    assert stage.run.tip_name == 'say "hello!"'
