# SPDX-License-Identifier: Apache-2.0
"""Formula (1) of the paper, to the last digit."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from marketplace_node.strategies import STRATEGIES, manhattan

NAN = math.nan
numbers = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("bid", "scene", "distance"),
    [
        ((4.0, 1.5, 3.0), (5.0, 1.0, 3.0), 1.5),
        ((2.5, 2.5, 2.5), (5.0, 4.0, 1.0), 5.5),
        ((1.0,), (1.0,), 0.0),
        ((4.0, 1.5, 3.0), (5.0, NAN, 3.0), 1.0),
        ((4.0, 1.5, 3.0), (NAN, NAN, NAN), 0.0),
        ((0.1, 0.2, 0.3), (0.0, 0.0, 0.0), 0.1 + 0.2 + 0.3),
    ],
)
def test_the_manhattan_distance_of_some_bids(
    bid: tuple[float, ...], scene: tuple[float, ...], distance: float
) -> None:
    assert manhattan(bid, scene) == distance


@given(st.lists(st.tuples(numbers, st.one_of(numbers, st.just(NAN))), max_size=12))
def test_the_distance_equals_exact_terms_rounded_once_an_addition(
    pairs: list[tuple[float, float]],
) -> None:
    expected = 0.0
    for bid, scene in pairs:
        if not math.isnan(scene):
            term = float(abs(Fraction(bid) - Fraction(scene)))
            expected = float(Fraction(expected) + Fraction(term))

    assert manhattan(tuple(b for b, _ in pairs), tuple(s for _, s in pairs)) == expected


def test_vectors_of_different_length_are_never_cut_to_the_shorter() -> None:
    with pytest.raises(ValueError, match="longer"):
        manhattan((), (1.0,))


def test_manhattan_is_found_by_its_name() -> None:
    assert STRATEGIES["manhattan"] is manhattan
