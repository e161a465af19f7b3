# SPDX-License-Identifier: Apache-2.0
"""Bids are checked, then ranked by strategy and weights."""

from __future__ import annotations

import math
from array import array
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bt_agents_core.errors import Refused
from market_harness import EXPRESS, GUIDE, SPACE, scene
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.round.auction import Auction
from marketplace_node.round.decision import Bids, ClosedBy
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, terms


def taken(**changes: Any) -> Auction:
    entry = HostEntry(
        host="/agents",
        instance="first",
        run_action="/agents/run",
        heartbeat="/agents/heartbeat",
        agents={GUIDE: 1, EXPRESS: 2},
    )
    auction = Auction(SPACE, terms(), [entry])
    values: dict[str, Any] = {
        "epoch": "epoch",
        "round": 4,
        "host": "/agents",
        "instance": "first",
        "agents": (GUIDE, EXPRESS),
        "agent_ids": (1, 2),
        "vectors": (4.0, 1.5, 3.0, 3.0, 5.0, 3.5),
    }
    auction.take(Bids(**(values | changes)))
    return auction


def test_scene_weights_apply_to_agents_without_weights() -> None:
    weights = {"age": 0.0, "familiarity": 2.0, "mood": 1.0}
    parameters = tuple(replace(one, weight=weights[one.name]) for one in SPACE.parameters)
    space = replace(SPACE, parameters=parameters)
    vectors = {GUIDE: (5.0, 2.0, 3.0), EXPRESS: (1.0, 1.5, 4.0)}
    accepted = bids(vectors, **{EXPRESS: (1.0, 1.0, 1.0)})
    wanted = scene("s1", 5.0, 1.0, 3.0)
    ranked = decide(space, terms(wanted, strategy="weighted_manhattan"), accepted)
    assert [(one.agent, one.distance) for one in ranked.bids] == [(GUIDE, 2.0), (EXPRESS, 5.5)]


@pytest.mark.parametrize("kind", [tuple, list, lambda v: array("d", v), np.array])
def test_vectors_and_weights_accept_any_sequence_type(kind: Any) -> None:
    vectors, weights = (4.0, 1.5, 3.0, 3.0, 5.0, 3.5), (1.0, 2.0, 1.0, 1.0, 1.0, 1.0)
    decision = taken(vectors=kind(vectors), weights=kind(weights)).close(
        ClosedBy.ALL_ANSWERED, 0.1
    )

    assert [bid.vector for bid in decision.ranking] == [vectors[:3], vectors[3:]]
    assert [bid.weights for bid in decision.ranking] == [weights[:3], ()]


@pytest.mark.parametrize(
    ("weights", "refused"),
    [
        ((1.0, math.nan, 1.0, 1.0, 1.0, 1.0), (GUIDE, "OUT_OF_RANGE")),
        ((1.0, 1.0, 1.0, 1.0, 1.0, -1.0), (EXPRESS, "OUT_OF_RANGE")),
        ((1.0, 1.0, 1.0, 1.0, 1.0, 1001.0), (EXPRESS, "OUT_OF_RANGE")),
        ((1.0, 1.0, 1.0), ("", "WRONG_LENGTH")),
    ],
)
def test_invalid_weights_are_refused(weights: tuple[float, ...], refused: tuple[str, str]) -> None:
    decision = taken(weights=weights).close(ClosedBy.ALL_ANSWERED, 0.1)

    assert [(bid.agent, bid.code) for bid in decision.refused] == [refused]


def test_non_numeric_values_are_refused_per_agent() -> None:
    decision = taken(vectors=("x", 1.5, 3.0, 3.0, 5.0, 3.5)).close(ClosedBy.ALL_ANSWERED, 0.1)

    assert [(bid.agent, bid.code) for bid in decision.refused] == [(GUIDE, "NOT_A_NUMBER")]
    assert [bid.vector for bid in decision.ranking] == [(3.0, 5.0, 3.5)]


def test_accepted_bids_are_ordered_by_distance() -> None:
    auction = taken()

    assert [(bid.agent, bid.distance) for bid in auction.accepted] == [
        (GUIDE, 1.5),
        (EXPRESS, 6.5),
    ]


def test_empty_bids_give_empty_ranking() -> None:
    assert decide(SPACE, terms(strategy="thompson", shadow="ucb"), bids({})).bids == ()


def test_uninstalled_strategy_is_refused_by_name() -> None:
    for changes in ({"strategy": "theirs"}, {"shadow": "theirs"}):
        with pytest.raises(Refused, match="no strategy 'theirs' is installed"):
            decide(SPACE, terms(**changes), bids({GUIDE: (4.0, 1.5, 3.0)}))
