# SPDX-License-Identifier: Apache-2.0
"""The wait for an external ranking: answers, silence, and other events meanwhile."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import Refused
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness
from marketplace_node.effects import OpenCall, PublishAuction, SendGoal, State
from marketplace_node.formatting import shown
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy
from marketplace_node.round.precedence import check_ranking
from marketplace_node.settings import Settings


@pytest.fixture
def market() -> MarketHarness:
    harness = MarketHarness(strategy="external")
    harness.register()
    return harness


def asked(market: MarketHarness) -> None:
    market.award()
    assert [question.round for question in market.questions] == [1]
    assert market.all(PublishAuction) == []


def test_question_contains_scene_bids_and_distances(market: MarketHarness) -> None:
    asked(market)
    [question] = market.questions

    assert dict(zip(question.agents, question.distances, strict=True)) == {
        GUIDE: 1.5,
        EXPRESS: 6.5,
    }
    assert set(question.vectors) == {(4.0, 1.5, 3.0), (3.0, 5.0, 3.5)}
    assert question.scene.scene_id == "s1"
    assert question.limit_s == 0.5
    assert market.status.state is State.BIDDING
    assert market.status.message == "asking outside for a ranking"


def test_answer_decides_ranking(market: MarketHarness) -> None:
    asked(market)
    market.ranked(EXPRESS, GUIDE)

    assert market.goal.agent == EXPRESS
    assert [bid.agent for bid in market.auction.decision.ranking] == [EXPRESS, GUIDE]
    assert market.auction.decision.closed_by is ClosedBy.ALL_ANSWERED


def test_unnamed_agents_follow_by_distance(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.award()
    market.bid("/others", {PLAIN: (5.0, 1.0, 3.0)})
    market.ranked(EXPRESS)

    assert [bid.agent for bid in market.auction.decision.ranking] == [EXPRESS, PLAIN, GUIDE]


@pytest.mark.parametrize("failure", ["nobody serves /select", "it ranks 'bob', which has not bid"])
def test_nearest_wins_without_ranking_and_reason_explains(
    market: MarketHarness, failure: str
) -> None:
    asked(market)
    market.ranked(failure=failure)

    assert market.goal.agent == GUIDE
    assert failure in market.auction.reason


def test_silence_ends_at_time_limit(market: MarketHarness) -> None:
    asked(market)
    market.wait(0.4)
    assert market.all(PublishAuction) == []

    market.wait(0.2)
    assert market.goal.agent == GUIDE
    assert "did not answer within 0.5 s" in market.auction.reason


def test_answer_after_time_limit_changes_nothing(market: MarketHarness) -> None:
    asked(market)
    market.wait(1.0)
    market.ranked(EXPRESS)

    assert market.goal.agent == GUIDE
    assert len(market.all(PublishAuction)) == 1
    assert "ranking from outside is late" in market.notes[-1]


def test_the_first_of_two_answers_counts(market: MarketHarness) -> None:
    asked(market)
    market.ranked(EXPRESS)
    market.ranked(GUIDE)

    assert market.goal.agent == EXPRESS
    assert len(market.all(SendGoal)) == 1


@pytest.mark.parametrize("bids", [{}, {GUIDE: (1.0, 1.0, 1.0)}])
def test_trivial_ranking_needs_no_question(
    market: MarketHarness, bids: dict[str, tuple[float, ...]]
) -> None:
    declined = {name: "tired" for name in (GUIDE, EXPRESS) if name not in bids}
    market.scene()
    market.bid(vectors=bids, declined=declined)

    assert market.questions == []
    assert len(market.all(PublishAuction)) == 1


def test_bids_during_wait_are_late(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.award()
    market.wait(0.6)
    market.bid("/others", {PLAIN: (5.0, 1.0, 3.0)})
    market.ranked(EXPRESS)

    assert market.notes == ["bids of /others are late: round 1 is closed"]
    assert {bid.agent for bid in market.auction.decision.ranking} == {GUIDE, EXPRESS}
    assert market.auction.decision.silent_hosts == ("/others",)


def test_a_stop_during_the_wait_ends_the_scene(market: MarketHarness) -> None:
    asked(market)
    assert market.cancel()[0]
    market.ranked(EXPRESS)

    assert market.ends == [("s1", "STOPPED")]
    assert market.auction.decision.closed_by is ClosedBy.STOPPED
    assert market.all(SendGoal) == []


def test_a_shutdown_during_the_wait_ends_the_scene(market: MarketHarness) -> None:
    asked(market)
    market.do(market.market.shut_down("the end", market.now))

    assert market.ends == [("s1", "SHUTTING_DOWN")]
    assert market.status.state is State.IDLE


def test_host_dying_during_wait_is_skipped(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.do(
        market.market.configure(
            Settings(strategy="external", options={"external.limit": 5.0}), market.now
        )
    )
    market.award()
    market.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})
    market.lose(away_s=1.5)
    market.ranked(EXPRESS, GUIDE, PLAIN)

    assert market.goal.agent == PLAIN
    assert market.events == ["1 professional_express REFUSED", "1 attentive_guide REFUSED"]


def test_scene_arriving_during_wait_is_queued(market: MarketHarness) -> None:
    asked(market)
    market.scene("s2")
    assert market.status.queued == 1

    market.ranked(EXPRESS)
    market.perform()
    assert [question.round for question in market.questions] == [1]
    assert market.calls[-1].scene.scene_id == "s2"


def test_strategy_switch_during_wait_applies_next_round(market: MarketHarness) -> None:
    asked(market)
    market.do(market.market.configure(Settings(strategy="manhattan"), market.now))
    market.ranked(EXPRESS)
    assert market.goal.agent == EXPRESS

    market.perform()
    market.award("s2")
    assert market.goal.agent == GUIDE
    assert len(market.questions) == 1


def test_stalled_market_extends_wait_accordingly(market: MarketHarness) -> None:
    asked(market)
    market.stall(30.0)
    market.beat()
    market.ranked(EXPRESS)

    assert market.goal.agent == EXPRESS


def test_challenge_also_asks_external_ranker() -> None:
    market = MarketHarness(strategy="external", on_new_scene="preempt")
    market.register()
    asked(market)
    market.ranked(GUIDE, EXPRESS)
    market.accept()
    market.scene("s2", 3.0, 5.0, 3.5)
    market.bid(round=2)
    assert len(market.questions) == 2
    market.ranked(EXPRESS, GUIDE)

    assert market.auction.decision.outcome is AuctionOutcome.PREEMPTS


def test_run_end_during_wait_closes_challenge() -> None:
    market = MarketHarness(strategy="external", on_new_scene="preempt")
    market.register()
    asked(market)
    market.ranked(GUIDE)
    market.accept()
    market.scene("s2")
    market.bid(round=2)
    market.end()

    assert market.auction.decision.outcome is AuctionOutcome.WAITS
    assert market.auction.decision.closed_by is ClosedBy.STOPPED
    market.collect()
    assert market.all(OpenCall)[-1].scene.scene_id == "s2"


@pytest.mark.parametrize(
    ("ranking", "code"),
    [
        ([], "EMPTY"),
        (["bob"], "UNKNOWN_AGENT"),
        ([GUIDE, ""], "UNKNOWN_AGENT"),
        ([GUIDE, EXPRESS, GUIDE], "DUPLICATE"),
        (["x" * 100_000], "UNKNOWN_AGENT"),
    ],
)
def test_a_malformed_ranking_is_refused(ranking: list[str], code: str) -> None:
    with pytest.raises(Refused) as caught:
        check_ranking(ranking, [GUIDE, EXPRESS])
    assert caught.value.code == code
    assert len(caught.value.reason) < 500


def test_external_text_becomes_one_short_line() -> None:
    assert shown("a\n\x1b[31mb\u202e  c") == "a [31mb c"
    assert len(shown("x" * 10_000)) == 300
