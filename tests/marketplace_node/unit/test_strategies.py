# SPDX-License-Identifier: Apache-2.0
"""The strategies on small numbers, their frequencies over many draws, and their table."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from bt_agents_core.errors import Refused
from field_values import field, scored
from marketplace_node import strategies
from marketplace_node.round import ranking
from marketplace_node.settings import Settings
from marketplace_node.strategies import STRATEGIES, Bid, order, round_rng
from marketplace_node.strategies.catalogue import folded_mean
from marketplace_node.strategies.strategy import FloatArray

NAN = math.nan
GUIDE, EXPRESS, CHILD = (4.0, 1.5, 3.0), (3.0, 5.0, 3.5), (1.0, 2.0, 4.0)


def test_weight_multiplies_contribution_of_parameter() -> None:
    seen = field((5.0, 1.0, 3.0), [GUIDE], weights=[(2.0, 0.0, 1.0)])
    [found] = scored("weighted_manhattan", seen)

    assert (found.contributions, found.score) == ((2.0, 0.0, 0.0), 2.0)


def test_euclidean_distance_is_split_among_parameters() -> None:
    scores = scored("euclidean", field((1.0, 1.0, NAN), [(4.0, 5.0, 3.0), (1.0, 1.0, 5.0)]))

    assert [one.distance for one in scores] == [5.0, 0.0]
    assert [one.contributions for one in scores] == [(9 / 5, 16 / 5, 0.0), (0.0, 0.0, 0.0)]


@pytest.mark.parametrize("gap", [0.0, 0.3, -1.0, 2.5, -8.0, 60.0])
@pytest.mark.parametrize("std", [1e-3, 0.4, 1.0, 7.0])
def test_folded_mean_matches_its_integral(gap: float, std: float) -> None:
    points, step = np.linspace(-12.0, 12.0, 200_001, retstep=True)
    density = np.exp(-0.5 * points**2) / math.sqrt(2 * math.pi)
    integral = np.sum(np.abs(gap + std * points) * density) * step

    assert folded_mean(gap, std) == pytest.approx(float(integral), rel=1e-7)


def test_undeclared_draw_fails_strategy() -> None:
    secretive = replace(STRATEGIES["softmax"], draws=False)
    with pytest.raises(Refused, match=r"'random\.random' needs draws=True"):
        ranking.strategy_scores(secretive, field((3.0,), [(4.0,)]), {}, "seed")


def winners(
    strategy: str, rounds: int, bids: Sequence[tuple[float, ...]], **options: float
) -> list[int]:
    """Return how often each bid comes first in independent random rounds."""
    seen, random = field((3.0, 3.0, 3.0), bids), round_rng("many")
    counts = Counter(
        order([one.score for one in scored(strategy, seen, random, **options)], seen.bids)[0]
        for _ in range(rounds)
    )
    return [counts[index] for index in range(len(bids))]


def test_softmax_draws_match_its_formula() -> None:
    bids = [(3.0, 3.0, 3.0), (3.0, 3.5, 3.0), (2.0, 3.5, 3.0)]
    expected = np.exp(-np.array([0.0, 0.5, 1.5]) / 0.5)
    expected *= 20_000 / expected.sum()

    found = np.array(winners("softmax", 20_000, bids, temperature=0.5))
    chi_square = ((found - expected) ** 2 / expected).sum()
    assert chi_square < 13.8, "with two degrees of freedom p is above 0.001"


@pytest.mark.parametrize("epsilon", [0.0, 0.1, 1.0])
def test_epsilon_greedy_randomizes_configured_share_of_rounds(epsilon: float) -> None:
    rounds = 20_000
    nearest, *others = winners(
        "epsilon_greedy", rounds, [(3.0, 3.0, 3.0), GUIDE, EXPRESS], epsilon=epsilon
    )

    share = epsilon / 3
    allowed = 4 * math.sqrt(rounds * share * (1 - share))
    assert all(abs(count - rounds * share) <= allowed for count in others)
    assert nearest == rounds - sum(others)


def test_bid_whose_difference_is_nan_loses() -> None:
    def difference(profile: FloatArray, scene: FloatArray, _: FloatArray) -> FloatArray:
        found: FloatArray = np.where(profile > 4.0, NAN, np.abs(profile - scene))
        return found

    bids = [Bid("a", (5.0,), (1.0,)), Bid("b", (1.0,), (1.0,))]
    assert strategies.winners(difference, np.array([[5.0], [1.0]]), bids, [0, 0], "name") == [1, 1]


def bonus(name: str, runs: int, rounds: int, *scene: float, **options: float) -> float:
    seen = field(scene or (3.0, 3.0, 3.0), [GUIDE], runs=[runs], rounds=rounds)
    return scored(name, seen, **options)[0].bonus


def test_ucb_bonus_falls_with_runs_of_its_agent() -> None:
    ucb = partial(bonus, "ucb", c=2.0)

    assert ucb(0, 0) == 0.0
    assert ucb(3, 7) == pytest.approx(2.0 * math.sqrt(math.log(8) / 4))
    assert ucb(0, 10) > ucb(1, 10) > ucb(10, 10)
    assert ucb(1, 100) > ucb(1, 10)


def test_bounded_ucb_caps_ucb_bonus_at_margin() -> None:
    bounded = partial(bonus, "bounded_ucb", c=0.5, margin=0.4)

    assert bounded(0, 0) == 0.0
    assert bounded(3, 7) == pytest.approx(6.0 * math.sqrt(math.log(8) / 4))
    assert bounded(0, 7) == pytest.approx(4.8)
    assert bounded(0, 7, 3.0, NAN, 3.0) == pytest.approx(3.2), "shares of what is known"
    assert bounded(0, 7, NAN, NAN, NAN) == 0.0


def test_bounded_ucb_explores_only_within_margin() -> None:
    bids, runs = [(1.0, 1.0), (2.5, 2.0), (3.0, 2.3)], [0, 0, 0]
    for number in range(2_000):
        seen = field((1.0, 1.0), bids, runs=runs, rounds=number)
        scores = [one.score for one in scored("bounded_ucb", seen, c=0.5, margin=0.4)]
        runs[scores.index(min(scores))] += 1

    nearest, within, beyond = runs
    assert nearest > 1_900
    assert (within > 0, beyond) == (True, 0)


def test_thompson_converges_to_manhattan_with_more_runs() -> None:
    def spread(runs: int) -> float:
        many = field((3.0, 3.0, 3.0), [GUIDE] * 2_000, runs=[runs] * 2_000)
        scores = scored("thompson", many, round_rng("thompson"), sigma=0.1)
        return float(np.mean([abs(one.bonus) for one in scores]))

    assert spread(0) > 1.9 * spread(3) > 1.9**2 * spread(15)
    assert spread(10**12) < 1e-5
    still = scored("thompson", field((3.0, 3.0, 3.0), [GUIDE, EXPRESS]), sigma=0.0)
    assert [one.score for one in still] == [one.distance for one in still]


def test_seeded_randomness_is_portable() -> None:
    assert round_rng("epoch/4").random() == 0.2232831641075249


def test_strategies_describe_themselves_and_their_options() -> None:
    assert next(iter(STRATEGIES)) == "manhattan"
    for name, spec in STRATEGIES.items():
        assert (spec.name, spec.description[-1]) == (name, ".")
        for option in spec.options:
            assert option.minimum <= option.default <= option.maximum
            assert option.description
        assert spec.values({}) == {option.name: option.default for option in spec.options}


def test_default_exploration_is_bounded() -> None:
    file = Path(__file__).parents[3] / "bt_agents_bringup" / "params" / "system.yaml"
    launched = yaml.safe_load(file.read_text())["/**/marketplace"]["ros__parameters"]

    assert launched["strategy"] == Settings().strategy == "bounded_ucb"
