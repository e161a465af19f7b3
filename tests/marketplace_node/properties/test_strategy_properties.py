# SPDX-License-Identifier: Apache-2.0
"""Laws of all strategies, for any bids and scenes."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from field_values import field, scored
from market_harness import SPACE, scene
from marketplace_node.round.ranking import decide
from marketplace_node.strategies import STRATEGIES, RoundBids
from ranked_rounds import added_up, bids, terms

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


def changed(of: RoundBids, **changes: Any) -> RoundBids:
    """Return a round with every bid changed in the same way."""
    return replace(of, bids=[bid._replace(**changes) for bid in of.bids])


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


@given(fields())
def test_distance_equals_plain_sum_bit_for_bit(of: RoundBids) -> None:
    assert scores_of("manhattan", of) == [added_up(bid.profile, of.scene) for bid in of.bids]


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
def test_weights_of_one_change_nothing(of: RoundBids) -> None:
    alike = changed(of, weights=(1.0,) * len(of.scene))

    assert scores_of("weighted_manhattan", alike) == scores_of("manhattan", of)


@given(fields())
def test_expected_distance_of_certain_values_equals_distance(of: RoundBids) -> None:
    certain = replace(of, std=(0.0,) * len(of.scene))

    assert scores_of("expected_manhattan", certain) == scores_of("manhattan", of)


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
    name: str, data: st.DataObject, vectors_of: dict[str, Any], wanted: tuple[float, ...]
) -> None:
    runs = {agent: data.draw(st.integers(0, 3)) for agent in vectors_of}
    of = terms(scene("s", *wanted), strategy=name, runs=runs, last_run=runs, rounds_run=9)
    first = decide(SPACE, of, bids(vectors_of))
    shuffled = data.draw(st.permutations(bids(vectors_of)))

    assert decide(SPACE, of, shuffled) == first


@named
@few
@given(vectors_of=agents, wanted=unsure)
def test_a_shadow_never_changes_the_order(
    name: str, vectors_of: dict[str, Any], wanted: tuple[float, ...]
) -> None:
    of = terms(scene("s", *wanted), strategy="softmax")
    alone, watched = (
        decide(SPACE, one, bids(vectors_of)) for one in (of, replace(of, shadow=name))
    )

    assert watched.bids == alone.bids
    assert watched.shadow_winner in vectors_of
    itself = decide(SPACE, replace(of, strategy=name, seed="epoch/4/shadow"), bids(vectors_of))
    assert watched.shadow_winner == itself.bids[0].agent
