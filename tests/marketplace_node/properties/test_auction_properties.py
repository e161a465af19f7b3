# SPDX-License-Identifier: Apache-2.0
"""Laws of auctions: exactly one outcome for any input in any order."""

from __future__ import annotations

import math
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from market_harness import SPACE, scene
from marketplace_node.explanation.reason import reason_of
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.auction import Auction
from marketplace_node.round.decision import Bids, ClosedBy, RoundKind
from ranked_rounds import added_up, terms

HOSTS = [
    HostEntry(
        host=host,
        instance="first",
        run_action=f"{host}/run",
        heartbeat=f"{host}/heartbeat",
        agents={f"{name}_{index}": 10 * number + index for index in range(2)},
    )
    for number, (host, name) in enumerate((("/a", "ann"), ("/b", "bob"), ("/c", "cat")))
]
NAMES = [name for host in HOSTS for name in host.agents] + ["stranger", ""]
numbers = st.one_of(st.floats(1.0, 5.0), st.floats(), st.just(3.0))


@st.composite
def messages(draw: st.DrawFn) -> Bids:
    """Return an answer that is usually valid."""
    host = draw(st.sampled_from(HOSTS))
    mostly_own = st.one_of(st.sampled_from(list(host.agents)), st.sampled_from(NAMES))
    agents = draw(st.lists(mostly_own, max_size=3))
    declined = draw(st.lists(mostly_own, max_size=2))
    count = draw(st.sampled_from([3 * len(agents)] * 6 + [0, 1, 7]))
    return Bids(
        epoch=draw(st.sampled_from(["epoch"] * 6 + ["other"])),
        round=draw(st.sampled_from([1] * 6 + [0, 2])),
        host=draw(st.sampled_from([host.host] * 6 + ["/strangers", ""])),
        instance=draw(st.sampled_from(["first"] * 6 + ["second"])),
        agents=tuple(agents),
        agent_ids=tuple(host.agents.get(agent, 0) for agent in agents),
        vectors=tuple(draw(st.lists(numbers, min_size=count, max_size=count))),
        declined=tuple(declined),
        decline_reasons=("no",) * len(declined),
    )


@given(
    st.lists(messages(), max_size=8),
    st.lists(st.one_of(st.floats(1.0, 5.0), st.just(math.nan)), min_size=3, max_size=3),
    st.sampled_from(ClosedBy),
)
def test_an_auction_ends_in_exactly_one_outcome(
    answers: list[Bids], values: list[float], by: ClosedBy
) -> None:
    awarded_for = scene("s", *values)
    auction = Auction(SPACE, terms(awarded_for, round=1, excluded={"bob_1": "stopped"}), HOSTS)
    for answer in answers:
        auction.take(answer)
    decision = auction.close(by, 0.5, stopped="enough" if by is ClosedBy.STOPPED else "")

    stopped = by is ClosedBy.STOPPED
    assert (decision.outcome is AuctionOutcome.AWARDED) == (bool(decision.ranking) and not stopped)
    assert (decision.winner is None) == (decision.outcome is AuctionOutcome.NO_BIDS)
    assert reason_of(decision)

    ranked = [bid.agent for bid in decision.ranking]
    assert max(Counter(ranked).values(), default=1) == 1, "nobody is ranked twice"
    assert "bob_1" not in ranked
    distances = [bid.distance for bid in decision.ranking]
    assert distances == sorted(distances)
    for bid in decision.ranking:
        assert SPACE.vector(bid.vector) == bid.vector
        assert bid.distance == added_up(bid.vector, awarded_for.vector)
    assert math.isnan(decision.margin) or decision.margin >= 0.0

    answered = {host.host for host in HOSTS} - set(decision.silent_hosts)
    assert auction.complete == (not decision.silent_hosts)
    declined = {bid.agent for bid in decision.refused if bid.kind is RoundKind.DECLINED}
    assert not declined & set(ranked)
    refused_whole = {bid.host for bid in decision.refused if bid.code == "WRONG_LENGTH"}
    for host in HOSTS:
        if host.host in answered and host.host not in refused_whole:
            recorded = set(ranked) | {bid.agent for bid in decision.refused}
            assert host.agents.keys() <= recorded | {"bob_1"}, "every agent is accounted for"
