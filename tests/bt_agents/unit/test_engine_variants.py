# SPDX-License-Identifier: Apache-2.0
"""Several texts of a skill, of which it takes another one each time."""

from __future__ import annotations

import itertools
from random import Random

import pytest

from tree_harness import Stage

GREETING = "say: {one_of: [Hello., Hi., Good day.]}"


def said(tree: str, seed: int) -> list[object]:
    stage = Stage(tree, random=Random(seed))
    for _ in range(20):
        stage.tick()
    return stage.said


def test_the_same_text_never_comes_twice_running_and_all_come() -> None:
    texts = said(f"{GREETING}\nrepeat: 20", 1)
    assert set(texts) == {"Hello.", "Hi.", "Good day."}
    assert all(one != other for one, other in itertools.pairwise(texts))


def test_the_seed_of_the_run_decides_which_texts_come() -> None:
    tree = f"{GREETING}\nrepeat: 20"
    assert said(tree, 7) == said(tree, 7)
    assert len({tuple(said(tree, seed)) for seed in range(5)}) == 5


def test_names_in_a_variant_have_their_value_when_it_is_said() -> None:
    tree = """
sequence:
  - set: {guest: Ann}
  - say: {one_of: ["Hello ${guest}.", "${guest}"], rate: 0.5}
"""
    assert {text for seed in range(8) for text in said(tree, seed)} == {"Hello Ann.", "Ann"}


def test_a_retry_asks_in_other_words() -> None:
    texts = said("{invert: true, retry: 4, say: {one_of: [Well?, Shall we?]}}", 0)
    assert len(texts) == 4
    assert texts[0] == texts[2] != texts[1] == texts[3]


@pytest.mark.parametrize("count", [2, 5])
def test_the_last_one_is_left_out_of_every_pick(count: int) -> None:
    context = Stage("wait: 1 s", random=Random(2)).run._context
    assert {context.pick("tree", count, 1) for _ in range(99)} == {*range(count)} - {1}
