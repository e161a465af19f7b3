# SPDX-License-Identifier: Apache-2.0
"""Choices: of one child by ``choose`` and ``random``, and of one variant of a text."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import pytest

from bt_agents.engine.scripted_environment import ScriptedReply
from tree_harness import FAILS, LONG, TreeHarness, failure, scene, started

CASES = """
    choose:
      children: [{name: young, when: live.age <= 2, say: Hi!},
        {name: old, when: live.age >= 4, say: Good day.}]
      otherwise: {say: Hello.}
    """


@pytest.mark.parametrize(
    ("age", "case", "words"),
    [(1.0, "young", "Hi!"), (5.0, "old", "Good day."), (3.0, "otherwise", "Hello.")],
)
def test_choose_runs_only_the_first_matching_case(age: float, case: str, words: str) -> None:
    harness = started(CASES, awarded=scene(age=age, mood=3))
    assert harness.reports("tree") == [("SUCCESS", f"case '{case}'")]
    assert harness.said == [words]


def test_choose_evaluates_cases_only_at_start() -> None:
    harness = started(
        CASES, awarded=scene(age=1, mood=3), answers={"say": [ScriptedReply(after_s=2.0)]}
    )
    harness.set_live("age", 5.0)
    assert harness.outcomes(1, 1) == "RS"
    assert harness.said == ["Hi!"]


def test_failed_case_fails_choose_without_trying_others() -> None:
    harness = started(
        "choose: [{name: go, when: scene.age == 3, drive: x}, "
        "{name: stay, when: scene.age > 0, say: I stay.}]",
        answers={"drive": FAILS},
    )
    assert (harness.outcome, harness.said) == ("failed", [])
    assert harness.message == "drive aborted: motor off"


def test_choose_without_matching_case_fails_with_reasons() -> None:
    tree = (
        "choose: [{name: young, when: scene.age <= 2, say: Hi!}, "
        "{name: happy, when: scene.mood > 3, say: Great!}]"
    )
    assert failure(tree, awarded=scene(mood=3)).startswith(
        "no case fits; young: 'scene.age' has no value; "
        "happy: not so: scene.mood > 3 (scene.mood is 3) (tree, a.yaml"
    )


def test_case_of_earlier_round_keeps_no_status() -> None:
    harness = started(f"{CASES}repeat: 2", awarded=scene(age=1, mood=3))
    assert harness.status("0.young") == "SUCCESS"
    harness.set_live("age", 5.0)
    assert harness.tick() == "succeeded"
    assert harness.status("0.young") == "INVALID"
    assert harness.said == ["Hi!", "Good day."]


def said(tree: str, seed: int) -> list[object]:
    """Return what a tree says in 20 ticks of a run with a seed."""
    harness = TreeHarness(tree, random=Random(seed))
    harness.tick(20)
    return harness.said


def test_seeded_random_picks_the_same_every_run() -> None:
    children = "[{say: a}, {say: b, weight: 2}, {say: never, weight: 0}]"
    tree = f"repeat: forever\nrandom: {{seed: 7, children: {children}}}"
    assert said(tree, 1) == said(tree, 2)
    assert set(said(tree, 1)) == {"a", "b"}


def test_unseeded_random_uses_the_run_seed() -> None:
    tree = "repeat: forever\nrandom:\n  - say: a\n  - say: b\n  - say: c"
    assert said(tree, 1) == said(tree, 1)
    assert said(tree, 1) != said(tree, 2)


@pytest.mark.parametrize("seed", range(5))
def test_random_without_repeats_picks_all_before_repeating(seed: int) -> None:
    tree = "repeat: 12\nrandom: {repeats: false, children: [say: a, say: b, say: c]}"
    texts = said(tree, seed)
    assert [set(texts[at : at + 3]) for at in (0, 3, 6, 9)] == [{"a", "b", "c"}] * 4
    assert all(one != other for one, other in pairwise(texts))


def test_random_without_repeats_may_repeat_its_only_choice() -> None:
    tree = "repeat: 3\nrandom: {repeats: false, children: [say: a, {say: b, weight: 0}]}"
    assert said(tree, 0) == ["a", "a", "a"]


def test_seeded_random_nodes_are_independent() -> None:
    one = "random: {seed: 7, children: [{say: a}, {say: b}]}"
    other = "random: {seed: 8, children: [{show: a}, {show: b}]}"
    alone, both = f"[{{{one}}}]", f"[{{{one}}}, {{{other}}}]"
    assert said(f"repeat: 9\nsequence: {alone}", 0) == said(f"repeat: 9\nsequence: {both}", 0)


def test_random_keeps_picked_child_and_takes_its_result() -> None:
    harness = TreeHarness("random: [say: a, show: b]", answers={"say": LONG, "show": LONG})
    assert harness.tick(20, step_s=1.0) == "running"
    assert len(harness.asked) == 1
    harness.interrupt()
    assert harness.environment.running() == []
    harness = started("random: [drive: a, drive: b]", answers={"drive": FAILS})
    assert (harness.outcome, len(harness.asked)) == ("failed", 1)


def test_tuned_weights_apply_at_next_start() -> None:
    harness = TreeHarness(
        "repeat: forever\nrandom:\n  - say: a\n    weight: ${w}\n  - say: b\n    weight: ${1 - w}",
        head="tunables: {w: {default: 1.0, min: 0, max: 1, description: d}}",
    )
    harness.tick(5)
    harness.tunables["w"] = 0.0
    harness.tick(5)
    assert harness.said == ["a"] * 5 + ["b"] * 5


def test_random_fails_when_all_weights_are_zero() -> None:
    tree = "random: [{say: a, weight: 0}, {say: b, weight: '${scene.mood}'}]"
    assert failure(tree, awarded=scene(mood=0)).startswith(
        "all weights are 0, expected at least one larger number (tree"
    )


def test_extreme_weights_do_not_overflow() -> None:
    children = "{say: a, weight: 1.0e308}, {say: b, weight: 1.0e308}, {say: c, weight: 1.0e-300}"
    assert set(said(f"repeat: forever\nrandom: [{children}]", 1)) == {"a", "b"}


GREETING = "say: {one_of: [Hello., Hi., Good day.]}"


def test_variants_never_repeat_consecutively_and_all_occur() -> None:
    texts = said(f"{GREETING}\nrepeat: 20", 1)
    assert set(texts) == {"Hello.", "Hi.", "Good day."}
    assert all(one != other for one, other in pairwise(texts))


def test_run_seed_determines_variants() -> None:
    tree = f"{GREETING}\nrepeat: 20"
    assert said(tree, 7) == said(tree, 7)
    assert len({tuple(said(tree, seed)) for seed in range(5)}) == 5


def test_variant_names_are_resolved_when_spoken() -> None:
    say = "{say: {one_of: ['Hello ${guest}.', '${guest}'], rate: 0.5}}"
    tree = f"sequence: [{{set: {{guest: Ann}}}}, {say}]"
    assert {text for seed in range(8) for text in said(tree, seed)} == {"Hello Ann.", "Ann"}


def test_retry_uses_another_variant() -> None:
    texts = said("{invert: true, retry: 4, say: {one_of: [Well?, Shall we?]}}", 0)
    assert len(texts) == 4
    assert texts[0] == texts[2] != texts[1] == texts[3]
