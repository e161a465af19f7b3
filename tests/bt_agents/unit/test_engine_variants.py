# SPDX-License-Identifier: Apache-2.0
"""Variants of a skill's text: a different one each time."""

from __future__ import annotations

import itertools
from random import Random

import pytest

from tree_harness import TreeHarness

GREETING = "say: {one_of: [Hello., Hi., Good day.]}"


def said(tree: str, seed: int) -> list[object]:
    harness = TreeHarness(tree, random=Random(seed))
    for _ in range(20):
        harness.tick()
    return harness.said


def test_variants_never_repeat_consecutively_and_all_occur() -> None:
    texts = said(f"{GREETING}\nrepeat: 20", 1)
    assert set(texts) == {"Hello.", "Hi.", "Good day."}
    assert all(one != other for one, other in itertools.pairwise(texts))


def test_run_seed_determines_variants() -> None:
    tree = f"{GREETING}\nrepeat: 20"
    assert said(tree, 7) == said(tree, 7)
    assert len({tuple(said(tree, seed)) for seed in range(5)}) == 5


def test_variant_names_are_resolved_when_spoken() -> None:
    tree = """
sequence:
  - set: {guest: Ann}
  - say: {one_of: ["Hello ${guest}.", "${guest}"], rate: 0.5}
"""
    assert {text for seed in range(8) for text in said(tree, seed)} == {"Hello Ann.", "Ann"}


def test_retry_uses_another_variant() -> None:
    texts = said("{invert: true, retry: 4, say: {one_of: [Well?, Shall we?]}}", 0)
    assert len(texts) == 4
    assert texts[0] == texts[2] != texts[1] == texts[3]


@pytest.mark.parametrize("count", [2, 5])
def test_pick_excludes_the_last_variant(count: int) -> None:
    context = TreeHarness("wait: 1 s", random=Random(2)).run._context
    assert {context.pick("tree", count, 1) for _ in range(99)} == {*range(count)} - {1}
