# SPDX-License-Identifier: Apache-2.0
"""The wait for an external ranking: answers, silence, and other events meanwhile."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Vector
from market_harness import EXPRESS, GUIDE, PLAIN, MarketHarness, with_host
from marketplace_node.effects import PublishAuction, SendGoal, State
from marketplace_node.formatting import shown
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy
from marketplace_node.round.precedence import check_ranking


@pytest.fixture
def market() -> MarketHarness:
    return with_host(strategy="external")


@pytest.fixture
def asked(market: MarketHarness) -> MarketHarness:
    """A market that has asked for a ranking."""
    market.award()
    assert [question.round for question in market.questions] == [1]
    assert market.all(PublishAuction) == []
    return market


def test_question_contains_scene_bids_and_distances(asked: MarketHarness) -> None:
    [question] = asked.questions

    distances = dict(zip(question.agents, question.distances, strict=True))
    assert distances == {GUIDE: 1.5, EXPRESS: 6.5}
    assert set(question.vectors) == {(4.0, 1.5, 3.0), (3.0, 5.0, 3.5)}
    assert (question.scene.scene_id, question.limit_s) == ("s1", 0.5)
    assert asked.status.state is State.BIDDING
    assert asked.status.message == "asking outside for a ranking"


def test_first_answer_decides_ranking(asked: MarketHarness) -> None:
    asked.ranked(EXPRESS, GUIDE)
    asked.ranked(GUIDE)

    assert [sent.goal.agent for sent in asked.all(SendGoal)] == [EXPRESS]
    assert [bid.agent for bid in asked.auction.decision.ranking] == [EXPRESS, GUIDE]
    assert asked.auction.decision.closed_by is ClosedBy.ALL_ANSWERED


def test_silence_ends_at_time_limit(asked: MarketHarness) -> None:
    asked.wait(0.4)
    assert asked.all(PublishAuction) == []

    asked.wait(0.2)
    assert asked.goal.agent == GUIDE
    assert "did not answer within 0.5 s" in asked.auction.reason
    asked.ranked(EXPRESS)
    assert (asked.goal.agent, len(asked.all(PublishAuction))) == (GUIDE, 1)
    assert "ranking from outside is late" in asked.notes[-1]


@pytest.mark.parametrize("bids", [{}, {GUIDE: (1.0, 1.0, 1.0)}])
def test_trivial_ranking_needs_no_question(market: MarketHarness, bids: dict[str, Vector]) -> None:
    declined = {name: "tired" for name in (GUIDE, EXPRESS) if name not in bids}
    market.scene()
    market.bid(vectors=bids, declined=declined)

    assert (market.questions, len(market.all(PublishAuction))) == ([], 1)


def test_bids_during_wait_are_late(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.award()
    market.wait(0.6)
    market.bid("/others", {PLAIN: (5.0, 1.0, 3.0)})
    market.ranked(EXPRESS)

    assert market.notes == ["bids of /others are late: round 1 is closed"]
    assert {bid.agent for bid in market.auction.decision.ranking} == {GUIDE, EXPRESS}
    assert market.auction.decision.silent_hosts == ("/others",)


def test_a_stop_during_the_wait_ends_the_scene(asked: MarketHarness) -> None:
    assert asked.cancel()[0]
    asked.ranked(EXPRESS)

    assert asked.ends == [("s1", "STOPPED")]
    assert (asked.auction.decision.closed_by, asked.all(SendGoal)) == (ClosedBy.STOPPED, [])


def test_host_dying_during_wait_is_skipped(market: MarketHarness) -> None:
    market.register("/others", PLAIN)
    market.configure(strategy="external", options={"external.limit": 5.0})
    market.award()
    market.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})
    market.lose(away_s=1.5)
    market.ranked(EXPRESS, GUIDE, PLAIN)

    assert market.goal.agent == PLAIN
    assert market.events == ["1 professional_express REFUSED", "1 attentive_guide REFUSED"]


def test_strategy_switch_during_wait_applies_next_round(asked: MarketHarness) -> None:
    asked.configure(strategy="manhattan")
    asked.ranked(EXPRESS)
    assert asked.goal.agent == EXPRESS

    asked.perform()
    asked.award("s2")
    assert (asked.goal.agent, len(asked.questions)) == (GUIDE, 1)


def test_stalled_market_extends_wait_accordingly(asked: MarketHarness) -> None:
    asked.stall(30.0)
    asked.beat()
    asked.ranked(EXPRESS)

    assert asked.goal.agent == EXPRESS


@pytest.fixture
def challenged() -> MarketHarness:
    """A market that asks for a ranking of the bids for a second scene."""
    market = with_host(strategy="external", on_new_scene="preempt")
    market.award()
    market.ranked(GUIDE, EXPRESS)
    market.accept()
    market.scene("s2", 3.0, 5.0, 3.5)
    market.bid(round=2)
    assert len(market.questions) == 2
    return market


def test_challenge_also_asks_external_ranker(challenged: MarketHarness) -> None:
    challenged.ranked(EXPRESS, GUIDE)

    assert challenged.auction.decision.outcome is AuctionOutcome.PREEMPTS


def test_run_end_during_wait_closes_challenge(challenged: MarketHarness) -> None:
    challenged.end()

    assert challenged.auction.decision.outcome is AuctionOutcome.WAITS
    assert challenged.auction.decision.closed_by is ClosedBy.STOPPED
    challenged.collect()
    assert challenged.calls[-1].scene.scene_id == "s2"


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
    assert (shown("a\n\x1b[31mb\u202e  c"), len(shown("x" * 10_000))) == ("a [31mb c", 300)
