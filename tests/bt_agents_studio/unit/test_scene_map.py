# SPDX-License-Identifier: Apache-2.0
"""The scene map: at every point, the winner by the strategy."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bt_agents_interfaces.msg import RankedBid
from bt_agents_studio.records import ParameterRecord
from bt_agents_studio.scene_map import (
    COARSEST,
    FINEST,
    computed_map,
    is_computed,
    map_record,
    side_length,
)
from marketplace_node.strategies import STRATEGIES

RANGE: dict[str, Any] = {"minimum": 1.0, "maximum": 5.0, "default": 3.0}
AGE, MOOD = (
    ParameterRecord(name=name, description="", labels={}, is_mood=name == "mood", **RANGE)
    for name in ("age", "mood")
)
SCENE = {"age": 3.0, "familiarity": 2.0, "mood": 4.0}


def bid(agent: str, *vector: float, **fields: Any) -> RankedBid:
    return RankedBid(agent=agent, vector=vector, **fields)


YOUNG, OLD = bid("young", 1.0, 2.0, 3.0), bid("old", 5.0, 2.0, 3.0)


def winners(*bids: RankedBid, strategy: str = "manhattan", scene: dict[str, float] = SCENE):
    found = computed_map(strategy, bids, scene, AGE, MOOD, "name")
    side = len(found.xs)
    names = [found.agents[number] for number in found.winners]
    return found, [names[row * side : (row + 1) * side] for row in range(side)]


def test_nearest_profile_wins_at_each_point() -> None:
    found, rows = winners(YOUNG, OLD)
    assert (found.across, found.up, found.is_asked) == ("age", "mood", False)
    for row in rows:
        for age, name in zip(found.xs, row, strict=True):
            assert name == ("young" if age < 3.0 else "old")


def test_rows_go_up_and_columns_across() -> None:
    glad, sad = bid("glad", 3.0, 2.0, 5.0), bid("sad", 3.0, 2.0, 1.0)
    _, rows = winners(glad, sad)
    assert set(rows[0]) == {"sad"}
    assert set(rows[-1]) == {"glad"}


def test_weights_count_only_in_strategies_using_them() -> None:
    careless = bid("careless", 1.0, 2.0, 3.0, weights=(0.1, 1.0, 1.0))
    _, plain = winners(careless, OLD)
    _, weighted = winners(careless, OLD, strategy="weighted_manhattan")
    assert plain[0][-1] == "old"
    assert weighted[0].count("careless") > plain[0].count("careless")


def test_missing_value_counts_for_no_agent() -> None:
    near, far = bid("near", 3.0, 2.0, 3.0), bid("far", 3.0, 5.0, 3.0)
    _, rows = winners(near, far, scene={**SCENE, "familiarity": math.nan})
    assert {name for row in rows for name in row} == {"far"}  # equal, and first by name


def test_tie_break_decides_between_equal_bids() -> None:
    first, second = bid("a", 3.0, 2.0, 3.0, last_run=7), bid("b", 3.0, 2.0, 3.0, last_run=2)
    by_runs = computed_map("manhattan", (first, second), SCENE, AGE, MOOD, "least_recently_run")
    by_name = computed_map("manhattan", (first, second), SCENE, AGE, MOOD, "name")
    assert (by_runs.agents, by_name.agents) == (("b",), ("a",))


def test_profiles_may_omit_trailing_parameters() -> None:
    _, rows = winners(bid("young", 1.0, 2.0), bid("old", 5.0, 2.0))
    assert (rows[0][0], rows[0][-1]) == ("young", "old")


def test_bonus_is_subtracted_from_distance_everywhere() -> None:
    seldom = bid("young", 1.0, 2.0, 3.0, bonus=2.0)
    _, plain = winners(YOUNG, OLD, strategy="bounded_ucb")
    found, forgiven = winners(seldom, OLD, strategy="bounded_ucb")
    ahead = [age for age, name in zip(found.xs, forgiven[0], strict=True) if name == "young"]
    assert max(ahead) == pytest.approx(4.0, abs=0.11)
    assert plain[0].count("young") < forgiven[0].count("young")


def test_only_maps_of_summed_differences_are_computed() -> None:
    computed = {"manhattan", "weighted_manhattan", "ucb", "bounded_ucb"}
    assert {one for one in (*STRATEGIES, "of a plug-in") if is_computed(one)} == computed


@pytest.mark.parametrize(
    ("bids", "width", "side"), [(4, 3, FINEST), (10_000, 64, COARSEST), (300, 4, 15)]
)
def test_map_is_coarser_with_many_bids(bids: int, width: int, side: int) -> None:
    assert side_length(bids, width) == side


def test_map_keeps_points_without_winner() -> None:
    found = map_record(AGE, MOOD, (1.0, 5.0), (1.0,), [["", "old"]], is_asked=True)
    assert (found.agents, found.winners) == (("", "old"), (0, 1))
