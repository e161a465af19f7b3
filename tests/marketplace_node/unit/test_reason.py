# SPDX-License-Identifier: Apache-2.0
"""The decision as text and numbers, in the terminal's form."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from market_harness import EXPRESS, GUIDE, PLAIN, SPACE, MarketHarness, scene, with_host
from marketplace_node.explanation.reason import calculation
from marketplace_node.round.ranking import decide
from ranked_rounds import bids, terms

NAN = math.nan


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((5.0, 1.0, NAN), "1.5 = |4−5| + |1.5−1|; mood is missing and left out"),
        ((NAN, 1.0, NAN), "0.5 = |1.5−1|; age and mood are missing and left out"),
        ((NAN, NAN, NAN), "0.0, as every value of the scene is missing"),
        ((-1.0, 1.0, 3.0), "5.5 = |4−(−1)| + |1.5−1| + |3−3|"),
    ],
)
def test_missing_and_negative_values_are_shown(values: tuple[float, ...], text: str) -> None:
    awarded_for = scene("s", *values)
    bid = decide(SPACE, terms(awarded_for), bids({GUIDE: (4.0, 1.5, 3.0)})).bids[0]

    assert calculation(bid, awarded_for, "manhattan") == text


def tied(market: MarketHarness, scene_id: str) -> str:
    market.scene(scene_id)
    market.bid(vectors={GUIDE: (4.0, 2.0, 3.0), EXPRESS: (4.0, 2.0, 3.0)})
    reason = market.auction.reason
    market.perform()
    return reason.split("; ")[1]


def test_tie_reason_names_least_recently_run_agent(market: MarketHarness) -> None:
    assert [tied(market, f"s{number}") for number in range(3)] == [
        "tied with professional_express: attentive_guide is first by name among those that "
        "have not run yet",
        "tied with attentive_guide: professional_express has not run yet",
        "tied with professional_express: attentive_guide has not run for the longest time",
    ]


def test_tie_reason_names_alphabetical_order() -> None:
    market = with_host(tie_break="name")

    words = "tied with professional_express: attentive_guide is first by name"
    assert [tied(market, f"s{number}") for number in range(2)] == [words, words]


def test_reason_without_bids_groups_them_by_cause() -> None:
    market = MarketHarness()
    market.register("/agents", GUIDE, EXPRESS, PLAIN, "leo")
    market.register("/others", "bob")
    market.scene()
    market.bid(
        vectors={"leo": (9.0, 1.5, 3.0)},
        declined={GUIDE: "needs scene.person", EXPRESS: "needs scene.person", PLAIN: "is tired"},
        unmet=("scene.person", "scene.person", ""),
    )
    market.wait(0.6)

    assert market.auction.reason == (
        "nobody bids: attentive_guide and professional_express need scene.person; plain: is "
        "tired; refused: leo (OUT_OF_RANGE: bid of leo: age is 9, expected 1 to 5); no answer in "
        "time from /others"
    )


def test_a_follow_up_round_says_what_it_continues(market: MarketHarness) -> None:
    market.run()
    market.cancel("mood.change <= -1.0", again=True, scene=scene("s1", 5.0, 1.0, 1.0))
    market.finish(outcome=3)
    market.bid(vectors={EXPRESS: (3.0, 5.0, 3.5)})

    assert market.auction.reason == (
        "continues round 1, without attentive_guide (stopped: mood.change <= -1.0): "
        "professional_express 8.5 = |3−5| + |5−1| + |3.5−1|; no other bid"
    )


def test_a_market_without_agents_says_so() -> None:
    market = MarketHarness(host_wait_s=0)
    market.scene()

    assert (market.calls, market.ends) == ([], [("s1", "NO_BIDS")])
    assert market.auction.reason == "no agents are registered"
    assert market.status.message == "scene 's1' is over: no agents are registered"


def test_unavailable_hosts_are_named_with_reason(impatient: MarketHarness) -> None:
    impatient.lose(away_s=1.1)
    impatient.scene()

    reason = "nobody bids: /agents is not asked: it has no heartbeat"
    assert impatient.auction.reason == reason


def test_sum_shows_first_parameters_and_counts_rest() -> None:
    space = SceneSpace(
        parameters=tuple(
            SceneParameter(name=f"p{index}", minimum=0.0, maximum=5.0, default=0.0)
            for index in range(64)
        )
    )
    values = tuple(SceneValue(name=name, value=1.0, origin=Origin.GIVEN) for name in space.names)
    awarded_for = Scene(scene_id="s", label="", person=True, values=values)
    bid = decide(space, terms(awarded_for), bids({GUIDE: (2.0,) * 64})).bids[0]

    assert calculation(bid, awarded_for, "manhattan") == (
        f"64.0 = {' + '.join(['|2−1|'] * 12)} + 52 more"
    )
