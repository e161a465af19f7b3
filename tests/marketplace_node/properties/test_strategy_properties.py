# SPDX-License-Identifier: Apache-2.0
"""Laws of all strategies and of counterfactuals, for any bids and scenes."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue, Vector
from field_values import field, scored
from market_harness import SPACE, scene
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import calculation
from marketplace_node.round import ranking
from marketplace_node.round.decision import AcceptedBid, Decision, Terms
from marketplace_node.round.ranking import FINEST, decide
from marketplace_node.strategies import STRATEGIES, RoundBids
from ranked_rounds import bids, decided, terms

NAN = math.nan
NAMES = sorted(STRATEGIES)
numbers = st.floats(-1e6, 1e6)
values = st.floats(1.0, 5.0)
vectors = st.tuples(values, values, values)
unsure = st.tuples(*[st.one_of(values, st.just(NAN))] * 3)
agents = st.dictionaries(st.sampled_from("abcdefgh"), vectors, min_size=1)
named = pytest.mark.parametrize("name", NAMES)
few = settings(max_examples=15)  # for each strategy


@st.composite
def fields(draw: st.DrawFn) -> RoundBids:
    """Return bids with a scene, weights and counts of runs; some values are missing."""
    count, width = draw(st.integers(1, 5)), draw(st.integers(1, 4))

    def row(elements: st.SearchStrategy[float]) -> list[float]:
        return draw(st.lists(elements, min_size=width, max_size=width))

    runs = draw(st.lists(st.integers(0, 9), min_size=count, max_size=count))
    return field(
        row(st.one_of(values, st.just(NAN))),
        [row(values) for _ in range(count)],
        std=row(st.floats(0.0, 2.0)),
        weights=[row(st.floats(0.0, 4.0)) for _ in range(count)],
        runs=runs,
        rounds=sum(runs),
    )


def scores_of(name: str, of: RoundBids) -> list[float]:
    return [one.score for one in scored(name, of)]


@given(st.lists(st.tuples(numbers, st.one_of(numbers, st.just(NAN))), min_size=1, max_size=12))
def test_distance_equals_exact_terms_rounded_once_per_addition(
    pairs: list[tuple[float, float]],
) -> None:
    expected = 0.0
    for bid, wanted in pairs:
        if not math.isnan(wanted):
            term = float(abs(Fraction(bid) - Fraction(wanted)))
            expected = float(Fraction(expected) + Fraction(term))

    bid, wanted_all = [bid for bid, _ in pairs], [wanted for _, wanted in pairs]
    assert scored("manhattan", field(wanted_all, [bid]))[0].distance == expected


@named
@few
@given(of=fields())
def test_scores_are_finite_and_contributions_sum_to_distance(name: str, of: RoundBids) -> None:
    scores = scored(name, of)

    assert len(scores) == len(of.bids)
    for one in scores:
        assert all(map(math.isfinite, (*one[:3], *one.contributions)))
        assert math.fsum(one.contributions) == pytest.approx(one.distance)
        assert one.score == pytest.approx(one.distance - one.bonus, abs=1e-9)


@named
@few
@given(of=fields())
def test_a_missing_value_never_counts(name: str, of: RoundBids) -> None:
    missing = [math.isnan(x) for x in of.scene]
    assume(any(missing))
    profiles = [
        tuple(3.0 if gone else p for p, gone in zip(bid.profile, missing, strict=True))
        for bid in of.bids
    ]
    bids = [bid._replace(profile=p) for bid, p in zip(of.bids, profiles, strict=True)]

    for one in scored(name, of):
        parts = zip(one.contributions, missing, strict=True)
        assert all(part == 0.0 for part, gone in parts if gone)
    assert scores_of(name, of) == scores_of(name, replace(of, bids=bids))


@given(fields())
def test_weights_of_one_and_certain_values_change_nothing(of: RoundBids) -> None:
    ones, zeros = (1.0,) * len(of.scene), (0.0,) * len(of.scene)
    alike = replace(of, std=zeros, bids=[bid._replace(weights=ones) for bid in of.bids])

    plain = scores_of("manhattan", of)
    assert scores_of("weighted_manhattan", alike) == plain
    assert scores_of("expected_manhattan", alike) == plain


@given(fields())
def test_uncertainty_never_reduces_distance(of: RoundBids) -> None:
    pairs = zip(scores_of("expected_manhattan", of), scores_of("manhattan", of), strict=True)

    assert all(unsure >= sure - 1e-12 for unsure, sure in pairs)


@given(of=fields(), margin=st.floats(0.0, 1.0), c=st.floats(0.0, 10.0))
def test_winner_is_within_margin_of_nearest_bid(of: RoundBids, margin: float, c: float) -> None:
    scores = scored("bounded_ucb", of, margin=margin, c=c)
    known = [width for width, x in zip(of.widths, of.scene, strict=True) if not math.isnan(x)]

    winner = min(scores, key=lambda one: one.score)
    further = winner.distance - min(one.distance for one in scores)
    assert further <= margin * sum(known) + 1e-9


@named
@few
@given(data=st.data(), vectors_of=agents, wanted=unsure)
def test_decision_is_independent_of_bid_arrival_order(
    name: str, data: st.DataObject, vectors_of: dict[str, Any], wanted: Vector
) -> None:
    runs = {agent: data.draw(st.integers(0, 3)) for agent in vectors_of}
    of = terms(scene("s", *wanted), strategy=name, runs=runs, last_run=runs, rounds_run=9)
    first = decide(SPACE, of, bids(vectors_of))

    assert decide(SPACE, of, data.draw(st.permutations(bids(vectors_of)))) == first


@named
@few
@given(vectors_of=agents, wanted=unsure)
def test_a_shadow_never_changes_the_order(
    name: str, vectors_of: dict[str, Any], wanted: Vector
) -> None:
    of = terms(scene("s", *wanted), strategy="softmax")
    alone, watched = (
        decide(SPACE, one, bids(vectors_of)) for one in (of, replace(of, shadow=name))
    )

    assert watched.bids == alone.bids
    assert watched.shadow_winner in vectors_of
    itself = decide(SPACE, replace(of, strategy=name, seed="epoch/4/shadow"), bids(vectors_of))
    assert watched.shadow_winner == itself.bids[0].agent


# Scene parameters outside profiles affect no decision.

PAIN = SceneParameter(name="pain", minimum=0.0, maximum=10.0, default=0.0, profiled=False)
WITH_PAIN = SceneSpace(parameters=(PAIN, *SPACE.parameters), mood="mood")


def hurting(pain: float) -> SceneValue:
    return SceneValue(name="pain", value=pain, origin=Origin.TOLD, std=1.0)


def with_pain(of: Scene, pain: SceneValue) -> Scene:
    return replace(of, values=WITH_PAIN.scene((*of.values, pain)))


@named
@few
@given(profiles=agents, wanted=vectors, pain=st.floats(0.0, 10.0))
def test_value_outside_profiles_changes_no_decision(name, profiles, wanted, pain):
    plain = scene("s1", *wanted)
    accepted = bids(profiles)
    of = {"strategy": name, "shadow": "expected_manhattan"}
    was = decided(terms(plain, **of), accepted)
    now = decided(terms(with_pain(plain, hurting(pain)), **of), accepted, space=WITH_PAIN.profiles)
    assert tuple(now.ranked.bids) == tuple(was.ranked.bids)
    assert now.ranked.shadow_winner == was.ranked.shadow_winner
    assert now.ranked.change == was.ranked.change


@pytest.mark.parametrize(
    ("pain", "told"), [(hurting(8.0), True), (SceneValue.missing("pain"), False)]
)
def test_value_outside_profiles_appears_only_in_scene(pain, told):
    of = with_pain(scene("s1", 5.0, 1.0, 3.0), pain)
    decision = decided(terms(of), bids({"guide": (4.0, 1.0, 3.0)}), space=WITH_PAIN.profiles)
    (winner,) = decision.ranked.bids
    assert calculation(winner, of, "manhattan") == "1.0 = |4−5| + |1−1| + |3−3|"
    words = explanation(decision, WITH_PAIN)
    assert ("pain 8 ± 1" in words) == told
    assert "pain adds" not in words
    assert "left out" not in words


# Counterfactuals: the change works, and no smaller one does.
QUARTERS = st.integers(4, 20).map(lambda number: number / 4)
VECTORS = st.tuples(QUARTERS, QUARTERS, QUARTERS)
WEIGHTS = st.sampled_from([0.0, 0.5, 1.0, 2.0])
several = settings(max_examples=25, deadline=None)
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


def wins_with(decision: Decision, accepted: list[AcceptedBid], name: str, value: float) -> bool:
    values = [
        replace(one, value=value) if one.name == name else one
        for one in decision.terms.scene.values
    ]
    changed = replace(decision.terms.scene, values=tuple(values))
    ranked = decide(SPACE, replace(decision.terms, scene=changed), accepted)
    return ranked.bids[0].agent == decision.ranking[1].agent


def found_change(of: Terms, accepted: list[AcceptedBid]) -> Decision:
    decision = decided(of, accepted)
    assert decision.ranked.change is not None
    assert not (decision.ranked.change.names and decision.ranked.change.obstacle)
    return decision


@pytest.mark.parametrize("strategy", NAMES)
@several
@given(data=st.data())
def test_runner_up_wins_with_found_change(strategy: str, data: st.DataObject) -> None:
    of, accepted = data.draw(rounds(st.just(strategy)))
    decision = found_change(of, accepted)
    change = decision.ranked.change
    assert change is not None
    assume(change.names)

    (name,), (value,) = change.names, change.values
    assert 1.0 <= value <= 5.0
    assert wins_with(decision, accepted, name, value)


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
                changes = smaller and wins_with(decision, accepted, parameter.name, float(value))
                assert not changes


@pytest.mark.parametrize("strategy", [name for name in NAMES if STRATEGIES[name].difference])
@several
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
