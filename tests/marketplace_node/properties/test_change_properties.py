# SPDX-License-Identifier: Apache-2.0
"""Laws of counterfactuals: the change works, and no smaller one does."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from market_harness import SPACE, scene
from marketplace_node.round import ranking
from marketplace_node.round.counterfactual import FINEST
from marketplace_node.round.decision import AcceptedBid, Decision, Terms
from marketplace_node.round.ranking import decide
from marketplace_node.strategies import STRATEGIES
from ranked_rounds import bids, decided, terms, with_values

QUARTERS = st.integers(4, 20).map(lambda number: number / 4)
VECTORS = st.tuples(QUARTERS, QUARTERS, QUARTERS)
WEIGHTS = st.sampled_from([0.0, 0.5, 1.0, 2.0])
NAMES = sorted(STRATEGIES)
few = settings(max_examples=25, deadline=None)
some = settings(max_examples=40, deadline=None)


@st.composite
def rounds(draw: st.DrawFn, strategies: Any) -> tuple[Terms, list[AcceptedBid]]:
    """Return terms and bids with numbers that computers add exactly."""
    vectors = draw(st.dictionaries(st.sampled_from("abcdef"), VECTORS, min_size=2))
    runs = {agent: draw(st.integers(0, 3)) for agent in vectors}
    of = terms(
        scene("s", *draw(st.tuples(*[st.one_of(QUARTERS, st.just(math.nan))] * 3))),
        strategy=draw(strategies),
        runs=runs,
        last_run=runs,
        rounds_run=sum(runs.values()),
        seed=str(draw(st.integers(0, 99))),
        tie_break=draw(st.sampled_from(["least_recently_run", "name"])),
    )
    weights = {agent: draw(st.tuples(WEIGHTS, WEIGHTS, WEIGHTS)) for agent in vectors}
    return of, bids(vectors, **weights)


def wins_with(decision: Decision, accepted: list[AcceptedBid], values: dict[str, float]) -> bool:
    changed = with_values(decision.terms.scene, values)
    ranked = decide(SPACE, replace(decision.terms, scene=changed), accepted)
    return ranked.bids[0].agent == decision.ranking[1].agent


def found_change(of: Terms, accepted: list[AcceptedBid]) -> Decision:
    decision = decided(of, accepted)
    assert decision.ranked.change is not None
    assert not (decision.ranked.change.names and decision.ranked.change.obstacle)
    return decision


@pytest.mark.parametrize("strategy", NAMES)
@few
@given(data=st.data())
def test_runner_up_wins_with_found_change(strategy: str, data: st.DataObject) -> None:
    of, accepted = data.draw(rounds(st.just(strategy)))
    decision = found_change(of, accepted)
    change = decision.ranked.change
    assert change is not None
    assume(change.names)

    (name,), (value,) = change.names, change.values
    assert 1.0 <= value <= 5.0
    assert wins_with(decision, accepted, {name: value})


@some
@given(rounds(st.sampled_from(NAMES)))
def test_no_smaller_single_parameter_change_suffices(
    of_and_bids: tuple[Terms, list[AcceptedBid]],
) -> None:
    of, accepted = of_and_bids
    decision = found_change(of, accepted)
    change = decision.ranked.change
    assert change is not None
    size = math.inf
    if change.names:
        size = abs(change.values[0] - of.scene.get(change.names[0]))

    for parameter in SPACE.parameters:
        now = of.scene.get(parameter.name)
        if not math.isnan(now):
            for value in np.linspace(1.0, 5.0, FINEST + 1)[::5]:
                smaller = abs(value - now) < size - 1e-9
                there = {parameter.name: float(value)}
                assert not (smaller and wins_with(decision, accepted, there))


@pytest.mark.parametrize("strategy", [name for name in NAMES if STRATEGIES[name].difference])
@few
@given(data=st.data())
def test_search_by_differences_matches_ranking_each_scene(
    strategy: str, data: st.DataObject
) -> None:
    uneven = st.tuples(*[st.floats(1.0, 5.0)] * 3)
    vectors = data.draw(st.dictionaries(st.sampled_from("abcdef"), uneven, min_size=2))
    weights = {agent: data.draw(st.tuples(WEIGHTS, WEIGHTS, WEIGHTS)) for agent in vectors}
    of, _ = data.draw(rounds(st.just(strategy)))
    accepted = bids(vectors, **weights)
    ranked_anew = {strategy: replace(STRATEGIES[strategy], difference=None)}

    found = decide(SPACE, of, accepted).change
    with mock.patch.object(ranking, "STRATEGIES", ranked_anew):
        expected = decide(SPACE, of, accepted).change

    assert found == expected


def test_only_value_winning_by_tie_is_found() -> None:
    of = terms(
        scene("s", 1.0, math.nan, 1.0), strategy="weighted_manhattan", runs={}, tie_break="name"
    )
    weights = {"a": (0.5, 0.0, 0.0), "b": (0.0, 0.0, 0.5), "c": (0.0, 0.0, 0.0)}
    vectors = {"a": (1.25, 1.0, 1.0), "b": (1.0, 1.0, 1.25), "c": (1.0, 1.0, 1.0)}
    change = found_change(of, bids(vectors, **weights)).ranked.change
    assert change is not None
    assert (change.names, change.values) == (("age",), (1.25,))
