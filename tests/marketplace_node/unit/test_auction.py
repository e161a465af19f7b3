# SPDX-License-Identifier: Apache-2.0
"""One round: accepted and refused bids with their codes, and ties."""

from __future__ import annotations

import math
from array import array
from typing import Any

import numpy as np
import pytest

from market_harness import EXPRESS, GUIDE, SPACE, scene
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.auction import Auction
from marketplace_node.round.decision import Bids, ClosedBy, Decision, RoundKind, Terms

FINE = (4.0, 1.5, 3.0)
TOKEN = b"token of a start"


def entry(host: str = "/agents", **agents: int) -> HostEntry:
    return HostEntry(
        host=host,
        instance="first",
        run_action=f"{host}/run",
        heartbeat=f"{host}/heartbeat",
        agents=agents or {GUIDE: 1, EXPRESS: 2},
        token=TOKEN,
    )


def auction(*hosts: HostEntry, **changes: Any) -> Auction:
    values: dict[str, Any] = {
        "epoch": "epoch",
        "round": 4,
        "follows": 0,
        "scene": scene(),
        "strategy": "manhattan",
        "tie_break": "least_recently_run",
    }
    return Auction(SPACE, Terms(**(values | changes)), hosts or (entry(),))


def bids(**changes: Any) -> Bids:
    values: dict[str, Any] = {
        "epoch": "epoch",
        "round": 4,
        "host": "/agents",
        "instance": "first",
        "agents": (GUIDE, EXPRESS),
        "agent_ids": (1, 2),
        "vectors": (*FINE, 3.0, 5.0, 3.5),
        "token": TOKEN,
    }
    return Bids(**(values | changes))


def close(opened: Auction) -> Decision:
    return opened.close(ClosedBy.DEADLINE, 0.5)


def refusals(decision: Decision) -> list[tuple[str, str]]:
    return [(bid.agent, bid.code) for bid in decision.refused]


def test_the_closest_bid_wins_with_its_margin() -> None:
    opened = auction()
    opened.take(bids())
    decision = opened.close(ClosedBy.ALL_ANSWERED, 0.01)

    assert opened.complete
    assert decision.outcome is AuctionOutcome.AWARDED
    assert decision.winner is not None
    assert [(bid.agent, bid.distance) for bid in decision.ranking] == [
        (GUIDE, 1.5),
        (EXPRESS, 6.5),
    ]
    assert decision.margin == 5.0
    assert not decision.refused


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"epoch": "another"}, "FOREIGN_EPOCH"),
        ({"round": 5}, "FOREIGN_ROUND"),
        ({"round": 0}, "FOREIGN_ROUND"),
        ({"host": "/strangers"}, "UNREGISTERED"),
        ({"instance": "second"}, "WRONG_INSTANCE"),
        ({"token": b"token of another"}, "WRONG_TOKEN"),
        ({"token": b""}, "WRONG_TOKEN"),
    ],
)
def test_foreign_messages_are_refused_and_do_not_count(changes: dict[str, Any], code: str) -> None:
    opened = auction()
    opened.take(bids(**changes))

    assert not opened.complete
    decision = close(opened)
    assert refusals(decision) == [("", code)]
    assert decision.outcome is AuctionOutcome.NO_BIDS
    assert decision.silent_hosts == ("/agents",)


@pytest.mark.parametrize(
    "changes",
    [
        {"vectors": FINE},
        {"vectors": ()},
        {"vectors": (*FINE, *FINE, 1.0)},
        {"agent_ids": (1,)},
        {"declined": ("x",)},
        {"decline_reasons": ("because",)},
        {"unmet": ("scene.person",)},
    ],
)
def test_malformed_message_is_refused_but_counts_as_response(changes: dict[str, Any]) -> None:
    opened = auction()
    opened.take(bids(**changes))

    assert opened.complete
    assert refusals(close(opened)) == [("", "WRONG_LENGTH")]


@pytest.mark.parametrize("vector", [(), (4.0,), (4.0, 1.5, 3.0, 1.0)])
def test_single_bid_of_wrong_length_names_its_agent(vector: tuple[float, ...]) -> None:
    opened = auction(entry(**{GUIDE: 1}))
    opened.take(bids(agents=(GUIDE,), agent_ids=(1,), vectors=vector))

    assert refusals(close(opened)) == [(GUIDE, "WRONG_LENGTH")]


@pytest.mark.parametrize(
    ("vector", "code"),
    [
        ((math.nan, 1.5, 3.0), "NOT_FINITE"),
        ((math.inf, 1.5, 3.0), "NOT_FINITE"),
        ((4.0, -math.inf, 3.0), "NOT_FINITE"),
        ((4.0, 1.5, 5.5), "OUT_OF_RANGE"),
        ((0.0, 0.0, 0.0), "OUT_OF_RANGE"),
        (("x", 1.5, 3.0), "NOT_A_NUMBER"),
    ],
)
def test_bad_vector_refuses_only_its_agent(vector: tuple[Any, ...], code: str) -> None:
    opened = auction()
    opened.take(bids(vectors=(*vector, 3.0, 5.0, 3.5)))
    decision = close(opened)

    assert refusals(decision) == [(GUIDE, code)]
    assert [(bid.agent, bid.vector) for bid in decision.ranking] == [(EXPRESS, (3.0, 5.0, 3.5))]
    assert math.isnan(decision.margin)


@pytest.mark.parametrize("kind", [tuple, list, lambda v: array("d", v), np.array])
def test_vectors_and_weights_accept_any_sequence_type(kind: Any) -> None:
    vectors, weights = (*FINE, 3.0, 5.0, 3.5), (1.0, 2.0, 1.0, 1.0, 1.0, 1.0)
    opened = auction()
    opened.take(bids(vectors=kind(vectors), weights=kind(weights)))
    ranking = close(opened).ranking

    assert [bid.vector for bid in ranking] == [vectors[:3], vectors[3:]]
    assert [bid.weights for bid in ranking] == [weights[:3], ()]


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
    opened = auction()
    opened.take(bids(weights=weights))

    assert refusals(close(opened)) == [refused]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"agents": ("stranger", EXPRESS)}, [("stranger", "UNKNOWN_AGENT"), (GUIDE, "NO_ANSWER")]),
        ({"agent_ids": (7, 2)}, [(GUIDE, "WRONG_ID")]),
        ({"agents": (EXPRESS, EXPRESS), "agent_ids": (2, 2)},
         [(EXPRESS, "DUPLICATE"), (GUIDE, "NO_ANSWER")]),
        ({"declined": (EXPRESS,), "decline_reasons": ("no",)}, [(EXPRESS, "DUPLICATE")]),
        ({"declined": ("stranger",), "decline_reasons": ("no",)}, [("stranger", "UNKNOWN_AGENT")]),
    ],
)  # fmt: skip
def test_misnamed_agents_are_refused(
    changes: dict[str, Any], expected: list[tuple[str, str]]
) -> None:
    opened = auction()
    opened.take(bids(**changes))

    assert refusals(close(opened)) == expected


def test_first_response_of_host_counts() -> None:
    opened = auction()
    opened.take(bids())
    opened.take(bids(vectors=(5.0, 1.0, 3.0) * 2))
    decision = close(opened)

    assert refusals(decision) == [("", "DUPLICATE")]
    assert decision.ranking[0].distance == 1.5


def test_declining_counts_as_response() -> None:
    opened = auction()
    opened.take(
        bids(
            agents=(),
            agent_ids=(),
            vectors=(),
            declined=(GUIDE, EXPRESS),
            decline_reasons=("needs scene.person", ""),
        )
    )
    decision = close(opened)

    assert opened.complete
    assert decision.outcome is AuctionOutcome.NO_BIDS
    assert [(bid.kind, bid.reason) for bid in decision.refused] == [
        (RoundKind.DECLINED, "needs scene.person"),
        (RoundKind.DECLINED, "gives no reason"),
    ]


def test_excluded_agent_may_be_omitted_but_not_bid() -> None:
    opened = auction(excluded={GUIDE: "stopped: mood"})
    opened.take(bids())
    silent = auction(excluded={GUIDE: "stopped: mood"})
    silent.take(bids(agents=(EXPRESS,), agent_ids=(2,), vectors=(3.0, 5.0, 3.5)))

    assert refusals(close(opened)) == [(GUIDE, "EXCLUDED")]
    assert refusals(close(silent)) == []


def test_ties_go_to_least_recently_run_then_name() -> None:
    vectors = (4.0, 2.0, 3.0) * 2

    def winner(**changes: Any) -> str:
        opened = auction(**changes)
        opened.take(bids(agents=(EXPRESS, GUIDE), agent_ids=(2, 1), vectors=vectors))
        return close(opened).ranking[0].agent

    assert winner() == GUIDE
    assert winner(last_run={GUIDE: 1}) == EXPRESS
    assert winner(last_run={GUIDE: 1, EXPRESS: 2}) == GUIDE
    assert winner(last_run={GUIDE: 1}, tie_break="name") == GUIDE


def test_stopped_round_awards_nothing_despite_bids() -> None:
    opened = auction()
    opened.take(bids())
    decision = opened.close(ClosedBy.STOPPED, 0.1, stopped="enough")

    assert decision.outcome is AuctionOutcome.NO_BIDS
    assert decision.winner is None
    assert math.isnan(decision.margin)
