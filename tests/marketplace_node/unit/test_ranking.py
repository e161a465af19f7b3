# SPDX-License-Identifier: Apache-2.0
"""Bids are ranked by strategy and weights."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from market_harness import EXPRESS, GUIDE, SPACE, scene
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, terms


def test_scene_weights_apply_to_agents_without_weights() -> None:
    weights = {"age": 0.0, "familiarity": 2.0, "mood": 1.0}
    parameters = tuple(replace(one, weight=weights[one.name]) for one in SPACE.parameters)
    space = replace(SPACE, parameters=parameters)
    vectors = {GUIDE: (5.0, 2.0, 3.0), EXPRESS: (1.0, 1.5, 4.0)}
    accepted = bids(vectors, **{EXPRESS: (1.0, 1.0, 1.0)})
    wanted = scene("s1", 5.0, 1.0, 3.0)
    ranked = decide(space, terms(wanted, strategy="weighted_manhattan"), accepted)
    assert [(one.agent, one.distance) for one in ranked.bids] == [(GUIDE, 2.0), (EXPRESS, 5.5)]


def test_empty_bids_give_empty_ranking() -> None:
    assert decide(SPACE, terms(strategy="thompson", shadow="ucb"), bids({})).bids == ()


def test_uninstalled_strategy_is_refused_by_name() -> None:
    for changes in ({"strategy": "theirs"}, {"shadow": "theirs"}):
        with pytest.raises(Refused, match="no strategy 'theirs' is installed"):
            decide(SPACE, terms(**changes), bids({GUIDE: (4.0, 1.5, 3.0)}))
