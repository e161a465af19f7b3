# SPDX-License-Identifier: Apache-2.0
"""Previews: the winner, without any side effect."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import Refused
from market_harness import EXPRESS, GUIDE, MarketHarness
from marketplace_node.effects import PublishAuction, SendGoal, State
from marketplace_node.market_state import PREVIEWS
from marketplace_node.operator_overrides import OperatorAction
from marketplace_node.operators import MOST_PREVIEWS


def outcome(market: MarketHarness) -> PublishAuction:
    ended = market.previews[-1].outcome
    assert isinstance(ended, PublishAuction), ended
    return ended


def test_preview_ranks_real_bids_without_awarding(market: MarketHarness) -> None:
    number = market.preview()
    market.bid(round=number)

    assert number == PREVIEWS + 1
    assert [bid.agent for bid in outcome(market).decision.ranking] == [GUIDE, EXPRESS]
    assert outcome(market).decision.terms.preview
    assert market.all(SendGoal) == []
    assert market.all(PublishAuction) == []
    assert market.status.state is State.IDLE


def test_preview_changes_no_counters(market: MarketHarness) -> None:
    market.run()
    market.finish()
    for _ in range(3):
        market.bid(round=market.preview())
    market.run("s2")

    terms = market.auction.decision.terms
    assert (terms.round, terms.rounds_run, dict(terms.runs)) == (2, 1, {GUIDE: 1})


def test_preview_predicts_random_draws() -> None:
    market = MarketHarness(strategy="softmax", options={"softmax.temperature": 5.0})
    market.register()
    for number in range(12):
        market.bid(round=market.preview())
        foretold = [bid.agent for bid in outcome(market).decision.ranking]
        market.award(f"s{number}")
        assert [bid.agent for bid in market.auction.decision.ranking] == foretold
        market.perform()
    winners = {publish.decision.ranking[0].agent for publish in market.all(PublishAuction)}
    assert winners == {GUIDE, EXPRESS}, "chance has to have a say in this test"


def test_preview_does_not_disturb_run(market: MarketHarness) -> None:
    market.run()
    market.bid(round=market.preview(3.0, 5.0, 3.5))

    assert outcome(market).decision.ranking[0].agent == EXPRESS
    assert market.status.state is State.RUNNING
    assert market.events == ["1 attentive_guide STARTED"]


def test_preview_accepts_another_strategy(market: MarketHarness) -> None:
    market.bid(round=market.preview(strategy="euclidean"))

    assert outcome(market).decision.terms.strategy == "euclidean"
    assert market.status.strategy == "manhattan"


def test_preview_respects_pins_and_vetoes(market: MarketHarness) -> None:
    market.operate(OperatorAction.VETO, GUIDE)
    market.bid(round=market.preview())

    assert [bid.agent for bid in outcome(market).decision.ranking] == [EXPRESS]


def test_preview_can_use_last_scene(market: MarketHarness) -> None:
    market.run()
    market.bid(round=market.preview(last=True))

    assert outcome(market).decision.terms.scene.scene_id == "s1"


def test_preview_with_silent_host_ends_at_deadline(market: MarketHarness) -> None:
    market.preview()
    market.wait(0.6)

    assert outcome(market).decision.ranking == ()
    assert outcome(market).decision.silent_hosts == ("/agents",)


def test_preview_waits_for_external_ranking(market: MarketHarness) -> None:
    market.bid(round=market.preview(strategy="external"))
    assert market.previews == []
    market.ranked(EXPRESS)

    assert outcome(market).decision.ranking[0].agent == EXPRESS


def test_late_or_foreign_preview_bids_change_nothing(market: MarketHarness) -> None:
    number = market.preview()
    market.bid(round=number)
    before = list(market.previews)
    for other in (number, number + 1, PREVIEWS):
        market.bid(round=other)

    assert market.previews == before
    assert market.all(SendGoal) == []


def test_preview_bids_never_enter_round(market: MarketHarness) -> None:
    market.scene()
    number = market.preview()
    market.bid(round=number, vectors={EXPRESS: (5.0, 1.0, 3.0)}, declined={GUIDE: "tired"})
    market.bid(round=1)

    assert market.goal.agent == GUIDE


@pytest.mark.parametrize(
    ("strategy", "last", "code"), [("magic", False, "UNKNOWN_STRATEGY"), ("", True, "NO_SCENE")]
)
def test_invalid_preview_is_refused(
    market: MarketHarness, strategy: str, last: bool, code: str
) -> None:
    with pytest.raises(Refused, match=f"^{code}:"):
        market.preview(strategy=strategy, last=last)


def test_concurrent_previews_are_limited(market: MarketHarness) -> None:
    for _ in range(MOST_PREVIEWS):
        market.preview()
    with pytest.raises(Refused, match=r"^BUSY:"):
        market.preview()

    market.wait(0.6)
    assert len(market.previews) == MOST_PREVIEWS
    market.preview()


def test_market_shutdown_ends_every_preview(market: MarketHarness) -> None:
    market.preview()
    market.do(market.market.shut_down("the end", market.now))

    [ended] = market.previews
    assert isinstance(ended.outcome, Refused)
    assert ended.outcome.code == "SHUTTING_DOWN"
    with pytest.raises(Refused):
        market.preview()
