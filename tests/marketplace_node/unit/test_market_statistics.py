# SPDX-License-Identifier: Apache-2.0
"""Statistics over rounds: starved agents, and a shadow strategy that disagrees."""

from __future__ import annotations

import pytest

from market_harness import EXPRESS, GUIDE, MarketHarness, with_host
from marketplace_node.effects import Alarm, Collect, PublishAuction
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.statistics import Starvation


def play(market: MarketHarness, scenes: int, **bids: tuple[float, ...]) -> None:
    for _ in range(scenes):
        market.scene(f"s{len(market.all(PublishAuction))}")
        market.bid(vectors=bids or None)
        market.perform()


@pytest.fixture
def market() -> MarketHarness:
    return with_host(starvation_rounds=3)


@pytest.fixture
def shadowed() -> MarketHarness:
    return with_host(shadow_strategy="euclidean")


def test_starvation_alarm_is_raised_once_until_win(market: MarketHarness) -> None:
    play(market, 2)
    assert market.status.starved == ()
    play(market, 1)
    assert market.status.starved == (EXPRESS,)
    play(market, 4)
    [alarm] = market.all(Alarm)
    assert alarm.message.startswith("professional_express is starved: it has bid in 3 awarded")

    play(market, 1, **{EXPRESS: (5.0, 1.0, 3.0), GUIDE: (1.0, 5.0, 5.0)})
    assert market.status.starved == ()
    play(market, 3)
    assert (market.status.starved, len(market.all(Alarm))) == ((EXPRESS,), 2)


def test_no_agent_is_starved_without_limit(market: MarketHarness) -> None:
    market.configure(starvation_rounds=0)
    play(market, 5)

    assert (market.status.starved, market.all(Alarm)) == ((), [])


def test_non_bidding_agent_is_not_starved() -> None:
    starvation = Starvation()
    for _ in range(10):
        starvation.ran("ann", ["ann"])
    starvation.ran("ann", ["ann", "bob"])

    assert (starvation.starved(2), starvation.in_vain) == ((), {"ann": 0, "bob": 1})


def test_previews_and_unawarded_rounds_starve_no_agent(market: MarketHarness) -> None:
    for _ in range(5):
        market.bid(round=market.preview())
        market.scene(f"stopped{market.status.round}")
        market.cancel()

    assert market.status.starved == ()


def test_shadow_counts_disagreements(shadowed: MarketHarness) -> None:
    # Distances to [5, 1, 3]: one big difference against several small ones.
    play(shadowed, 2, **{GUIDE: (5.0, 4.0, 3.0), EXPRESS: (3.0, 2.0, 4.0)})
    play(shadowed, 3, **{GUIDE: (5.0, 1.0, 3.0), EXPRESS: (3.0, 2.0, 4.0)})

    published = shadowed.all(PublishAuction)
    assert [p.decision.ranking[0].agent for p in published] == [GUIDE] * 5
    assert [p.decision.ranked.shadow_winner for p in published] == [EXPRESS] * 2 + [GUIDE] * 3
    assert [p.shadow_rounds for p in published] == [1, 2, 3, 4, 5]
    assert [p.shadow_disagreements for p in published] == [1, 2, 2, 2, 2]
    shadowed.configure(shadow_strategy="ucb")
    play(shadowed, 1)
    assert shadowed.auction.shadow_rounds == 1, "another pair is counted anew"


def test_refusing_winner_is_starved_but_running_substitute_not(market: MarketHarness) -> None:
    for number in range(4):
        market.award(f"s{number}")
        market.refuse()
        market.perform()

    assert {run.goal.agent for run in market.all(Collect)} == {EXPRESS}
    assert market.status.starved == (GUIDE,)


def test_preempting_scene_is_compared_with_shadow_once() -> None:
    market = MarketHarness(shadow_strategy="euclidean", on_new_scene="preempt")
    market.run()
    market.scene("s2", 3.0, 5.0, 3.5)
    market.bid(round=2)
    assert market.auction.decision.outcome is AuctionOutcome.PREEMPTS
    assert market.auction.shadow_rounds == 1
    market.end(outcome=3)
    market.bid()

    assert market.auction.shadow_rounds == 2


def test_shadow_is_not_compared_with_fallback_strategy() -> None:
    market = with_host(strategy="external", shadow_strategy="manhattan")
    market.award()
    market.ranked(failure="no")

    assert market.auction.decision.ranked.shadow_winner
    assert market.auction.shadow_rounds == 0
