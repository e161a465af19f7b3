# SPDX-License-Identifier: Apache-2.0
"""Whoever is found first, without the others, is who leads the whole ranking."""

from __future__ import annotations

import math
from random import Random

import numpy as np
import pytest

from bt_agents_core.scene import SceneSpace
from market_harness import SPACE, scene
from marketplace_node.round import ranking as ranking_module
from marketplace_node.round.bid_table import BidTable
from marketplace_node.round.decision import Ranked, Terms
from marketplace_node.round.ranking import decide, winning_row
from marketplace_node.round.round_model import RoundModel
from marketplace_node.strategies import STRATEGIES
from marketplace_node.strategies.arrays import Sum
from marketplace_node.strategies.nearest import BLOCK, nearest, weighted_distance
from ranked_rounds import bids, terms
from ranking import Case, case, equals_plain

SUMS = sorted(name for name, spec in STRATEGIES.items() if spec.sum is not None)
SIZES = (1, 2, 3, 4, 5, 9, 21, 40, 150)


def whole(space: SceneSpace, of: Terms, table: BidTable) -> list[tuple[str, float, float]]:
    """Return who is where, and how far, from the arrays that serve all strategies."""
    model = RoundModel(
        terms=of, table=table, field=table.field(space, of), spec=STRATEGIES[of.strategy],
        options={}, seed="",
    )  # fmt: skip
    scores = model.score().scores
    return [
        (table.agents[row], float(scores.distance[row]), float(scores.contributions[row].sum()))
        for row in model.order(scores.score)
    ]


def ranked(found: Ranked) -> list[tuple[str, float, float]]:
    return [(bid.agent, bid.distance, float(np.sum(bid.contributions))) for bid in found.bids]


@pytest.mark.parametrize("strategy", SUMS)
def test_the_first_and_all_others_are_those_of_the_arrays(strategy: str) -> None:
    chance = Random(strategy)
    for _ in range(300):
        count = chance.choice(SIZES)
        exact = chance.random() < 0.5  # values that often make equal sums

        def value(exact: bool = exact) -> float:
            return float(chance.randint(1, 5)) if exact else chance.uniform(1.0, 5.0)

        names = [f"a{number:03d}" for number in range(count)]
        weighted = [name for name in names if chance.random() < 0.3]
        accepted = bids(
            {name: (value(), value(), value()) for name in names},
            **{name: (value(), value(), 0.0) for name in weighted},
        )
        wanted = [math.nan if chance.random() < 0.1 else value() for _ in range(3)]
        of = terms(
            scene("s", *wanted),
            strategy=strategy,
            tie_break=chance.choice(["least_recently_run", "name"]),
            last_run={name: chance.randint(0, 3) for name in names},
            rounds_run=3,
        )
        table = BidTable.of(chance.sample(accepted, count), SPACE)
        found, expected = decide(SPACE, of, table), whole(SPACE, of, table)
        assert found.bids[0].agent == expected[0][0]
        assert ranked(found) == expected
        assert list(found.bidders) == names


@pytest.mark.parametrize("strategy", SUMS)
def test_the_record_of_a_few_bids_is_that_of_the_arrays(
    strategy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = Random(strategy)
    for _ in range(50):
        names = [f"a{number}" for number in range(chance.choice((1, 2, 5, 20)))]
        vectors = {name: tuple(float(chance.randint(1, 5)) for _ in range(3)) for name in names}
        weights = {name: chance.choice([(1.0, 1.0, 1.0), (2.0, 1.0, 0.0)]) for name in names}
        accepted = bids(vectors, **(weights if chance.random() < 0.7 else {}))
        of = terms(scene("s", 3.0, math.nan, 2.5), strategy=strategy, last_run={"a1": 2})
        found = decide(SPACE, of, accepted)
        record = tuple(found.bids)
        with monkeypatch.context() as few:
            few.setattr(ranking_module, "FEW", 0)
            assert record == tuple(decide(SPACE, of, accepted).bids)
        assert found.bids[0] == record[0]


@pytest.mark.parametrize("agents", [2, 3, 9, 30, 1_000])
@pytest.mark.parametrize("width", [1, 8, 17])
def test_sums_are_those_of_a_loop_whatever_the_size(agents: int, width: int) -> None:
    assert equals_plain(case(agents, width))


def test_equals_in_different_blocks_are_all_found() -> None:
    bids = np.full((2 * BLOCK + 5, 3), 5.0, order="F")
    equals = [7, BLOCK - 1, BLOCK, 2 * BLOCK + 4]
    bids[equals] = (2.0, 3.0, 1.0)
    assert nearest(bids, np.array([1.0, 3.0, 1.0])) == equals
    bids[BLOCK + 3, 0] = 0.5
    bids[BLOCK + 3, 1:] = (3.0, 1.0)
    assert nearest(bids, np.array([1.0, 3.0, 1.0])) == [BLOCK + 3]


@pytest.mark.parametrize("distance", [Sum(), Sum(weighted=True), Sum(squared=True)])
@pytest.mark.parametrize("digits", [0, 1, 9])
def test_of_many_none_is_left_out_that_is_as_near(distance: Sum, digits: int) -> None:
    chance = np.random.default_rng(digits)
    bids = np.asfortranarray(chance.uniform(0.0, 10.0, (40_000, 4)).round(digits))
    wanted = chance.uniform(0.0, 10.0, 4).round(digits)
    wanted[1] = math.nan
    weights = chance.uniform(0.0, 2.0, 4).round(digits) if distance.weighted else np.ones(4)
    rows = range(len(bids))
    measured = [weighted_distance(bid, wanted, distance, weights)[0] for bid in bids.tolist()]
    least = min(measured)
    assert nearest(bids, wanted, distance, weights) == [n for n in rows if measured[n] == least]


def test_of_many_equals_the_one_that_has_not_run_for_longest_wins() -> None:
    of: Case = case(40_000, 3)
    vectors = np.full_like(of.table.vectors, 5.0)
    table = BidTable(
        agents=of.table.agents,
        agent_ids=of.table.agent_ids,
        hosts=of.table.hosts,
        instances=of.table.instances,
        vectors=vectors,
    )
    assert winning_row(of.space, of.terms, table) == 0
    last_run = {**dict.fromkeys(table.agents, 9), table.agents[33_333]: 4}
    ran = terms(of.terms.scene, last_run=last_run, rounds_run=9)
    assert winning_row(of.space, ran, table) == 33_333


def test_looking_at_the_winner_puts_nobody_else_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    of = case(1_000, 3)
    found = decide(of.space, of.terms, of.table)
    monkeypatch.setattr(RoundModel, "score", lambda *_: pytest.fail("somebody else was looked at"))
    assert found.bids[0].agent
    assert len(found.bids) == len(found.bidders) == 1_000
