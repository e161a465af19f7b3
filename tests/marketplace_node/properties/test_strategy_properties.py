# SPDX-License-Identifier: Apache-2.0
"""What holds for every strategy, whatever the bids and the scene."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from field_values import field, scored
from market_harness import SPACE, scene
from marketplace_node.round.ranking import decide
from marketplace_node.strategies import STRATEGIES, BatchRandomSource, RoundArrays, round_rng
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
def fields(draw: st.DrawFn, lead: tuple[int, ...] = ()) -> RoundArrays:
    """Return bids with scenes, weights and counts of runs; some values are missing."""
    count, width = draw(st.integers(1, 5)), draw(st.integers(1, 4))

    def array(shape: tuple[int, ...], elements: st.SearchStrategy[float]) -> Any:
        return draw(arrays.arrays(np.float64, shape, elements=elements))

    scenes = array((*lead, width), st.one_of(values, st.just(NAN)))
    std = np.where(np.isnan(scenes), NAN, array((*lead, width), st.floats(0.0, 2.0)))
    runs = array((*lead, count), st.integers(0, 9).map(float))
    return field(
        scenes,
        array((*lead, count, width), values),
        std=std,
        weights=array((*lead, count, width), st.floats(0.0, 4.0)),
        runs=runs,
        rounds=runs.sum(axis=-1),
        idle=array((*lead, count), st.integers(0, 9).map(float)),
    )


@given(st.lists(st.tuples(numbers, st.one_of(numbers, st.just(NAN))), min_size=1, max_size=12))
def test_the_distance_equals_exact_terms_rounded_once_an_addition(
    pairs: list[tuple[float, float]],
) -> None:
    expected = 0.0
    for bid, wanted in pairs:
        if not math.isnan(wanted):
            term = float(abs(Fraction(bid) - Fraction(wanted)))
            expected = float(Fraction(expected) + Fraction(term))

    bid, wanted_all = [bid for bid, _ in pairs], [wanted for _, wanted in pairs]
    assert scored("manhattan", field(wanted_all, [bid])).distance[0] == expected


@given(fields((3,)))
def test_the_distance_is_the_plain_sum_to_the_last_bit_in_every_round(of: RoundArrays) -> None:
    distances = scored("manhattan", of).distance

    for row in range(3):
        assert distances[row].tolist() == [
            added_up(tuple(bid), tuple(of.scene[row])) for bid in of.bids[row]
        ]


@named
@few
@given(of=fields())
def test_scores_are_finite_and_contributions_add_up_to_the_distance(
    name: str, of: RoundArrays
) -> None:
    scores = scored(name, of)

    assert scores.score.shape == scores.distance.shape == scores.bonus.shape == of.shape
    for part in (scores.score, scores.distance, scores.bonus, scores.contributions):
        assert np.isfinite(part).all()
    assert scores.contributions.sum(axis=-1) == pytest.approx(scores.distance)
    assert scores.score == pytest.approx(scores.distance - scores.bonus, abs=1e-9)


@named
@few
@given(of=fields())
def test_a_missing_value_never_counts(name: str, of: RoundArrays) -> None:
    missing = np.isnan(of.scene)
    assume(missing.any())
    other = of.bids.copy()
    other[:, missing] = 3.0

    assert (
        scored(name, of).contributions[:, missing].tolist()
        == np.zeros((len(of.bids), missing.sum())).tolist()
    )
    assert np.array_equal(scored(name, of).score, scored(name, replace(of, bids=other)).score)


@named
@few
@given(of=fields((4,)))
def test_many_rounds_at_once_are_each_as_alone(name: str, of: RoundArrays) -> None:
    seeds = [f"e/{number}" for number in range(4)]
    together = scored(name, of, BatchRandomSource([round_rng(seed) for seed in seeds]))

    for row, seed in enumerate(seeds):
        alone = RoundArrays(
            **{key: value if key == "widths" else value[row] for key, value in vars(of).items()}
        )
        expected = scored(name, alone, round_rng(seed))
        assert np.array_equal(together.score[row], expected.score)
        assert np.array_equal(together.contributions[row], expected.contributions)


@given(fields())
def test_weights_of_one_are_no_weights(of: RoundArrays) -> None:
    alike = replace(of, weights=np.ones(of.bids.shape[-1]))

    assert np.array_equal(scored("weighted_manhattan", alike).score, scored("manhattan", of).score)


@given(fields())
def test_certain_values_make_the_expected_distance_the_distance(of: RoundArrays) -> None:
    certain = replace(of, std=np.zeros(of.bids.shape[-1]))

    assert np.array_equal(
        scored("expected_manhattan", certain).score, scored("manhattan", of).score
    )


@given(fields())
def test_uncertainty_never_brings_a_bid_nearer(of: RoundArrays) -> None:
    found = scored("expected_manhattan", of)

    assert (found.score >= scored("manhattan", of).score - 1e-12).all()


@given(of=fields((3,)), margin=st.floats(0.0, 1.0), c=st.floats(0.0, 10.0))
def test_nobody_further_than_the_margin_from_the_nearest_ever_wins(
    of: RoundArrays, margin: float, c: float
) -> None:
    scores = scored("bounded_ucb", of, margin=margin, c=c)
    allowed = margin * (of.widths * ~np.isnan(of.scene)).sum(axis=-1)

    for row in range(3):
        further = scores.distance[row, scores.score[row].argmin()] - scores.distance[row].min()
        assert further <= allowed[row] + 1e-9


@pytest.mark.parametrize("name", [name for name in NAMES if STRATEGIES[name].lines])
@few
@given(of=fields(), shift=st.integers(0, 4))
def test_where_scores_are_straight_lines_the_lines_say_the_scores(
    name: str, of: RoundArrays, shift: int
) -> None:
    spec = STRATEGIES[name]
    assert spec.lines is not None
    moved = replace(of, scene=np.where(np.isnan(of.scene), NAN, 1.0 + (of.scene + shift) % 4.0))
    lines = spec.lines(of, spec.values({}), round_rng("seed"))
    parts = np.nan_to_num(np.abs(lines.profiles - moved.scene) * lines.weights)

    assert lines.offsets + parts.sum(axis=-1) == pytest.approx(scored(name, moved).score)


@named
@few
@given(data=st.data(), vectors_of=agents, wanted=unsure)
def test_the_order_of_arrival_and_another_start_change_nothing(
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
