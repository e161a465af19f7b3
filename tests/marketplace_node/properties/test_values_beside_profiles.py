# SPDX-License-Identifier: Apache-2.0
"""Scene parameters outside profiles affect no decision of any strategy."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from market_harness import SPACE, scene
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import calculation
from marketplace_node.strategies import STRATEGIES
from ranked_rounds import bids, decided, terms

PAIN = SceneParameter(name="pain", minimum=0.0, maximum=10.0, default=0.0, profiled=False)
WITH_PAIN = SceneSpace(parameters=(PAIN, *SPACE.parameters), mood="mood")
values = st.floats(1.0, 5.0)
vectors = st.tuples(values, values, values)
agents = st.dictionaries(st.sampled_from("abcdefgh"), vectors, min_size=1)


def hurting(of: Scene, pain: float) -> Scene:
    value = SceneValue(name="pain", value=pain, origin=Origin.TOLD, std=1.0)
    return replace(of, values=WITH_PAIN.scene((*of.values, value)))


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
@settings(max_examples=15)
@given(profiles=agents, wanted=vectors, pain=st.floats(0.0, 10.0))
def test_value_outside_profiles_changes_no_decision(strategy, profiles, wanted, pain):
    plain = scene("s1", *wanted)
    accepted = bids(profiles)
    of = {"strategy": strategy, "shadow": "expected_manhattan"}
    was = decided(terms(plain, **of), accepted)
    now = decided(terms(hurting(plain, pain), **of), accepted, space=WITH_PAIN.profiles)
    assert tuple(now.ranked.bids) == tuple(was.ranked.bids)
    assert now.ranked.shadow_winner == was.ranked.shadow_winner
    assert now.ranked.change == was.ranked.change


def test_value_outside_profiles_appears_only_in_scene():
    of = hurting(scene("s1", 5.0, 1.0, 3.0), 8.0)
    decision = decided(terms(of), bids({"guide": (4.0, 1.0, 3.0)}), space=WITH_PAIN.profiles)
    (winner,) = decision.ranked.bids
    assert calculation(winner, of, "manhattan") == "1.0 = |4−5| + |1−1| + |3−3|"
    told = explanation(decision, WITH_PAIN)
    assert "pain 8 ± 1" in told
    assert "pain adds" not in told


def test_missing_value_outside_profiles_is_not_reported():
    of = scene("s1", 5.0, 1.0, 3.0)
    of = replace(of, values=WITH_PAIN.scene((*of.values, SceneValue.missing("pain"))))
    decision = decided(terms(of), bids({"guide": (4.0, 1.0, 3.0)}), space=WITH_PAIN.profiles)
    assert "left out" not in explanation(decision, WITH_PAIN)
