# SPDX-License-Identifier: Apache-2.0
"""Says again in words why a round ended as it did, where its message holds all that they tell."""

from __future__ import annotations

from typing import Any

from bt_agents_core.scene import SceneSpace
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import reason
from marketplace_node.round.decision import (
    AuctionOutcome,
    ClosedBy,
    Decision,
    Ranked,
    RefusedBid,
    RoundKind,
    Terms,
)
from marketplace_node.settings import EXTERNAL

_NOT_ASKED = " is not asked: "
"""In lines about hosts of which the message says nothing else."""


def words_difference(auction: Any, terms: Terms, ranked: Ranked, space: SceneSpace) -> str:
    """Return what differs in the reason and explanation of a plain award; empty when nothing does.

    Others tell of more than their message holds: an earlier scene, people who had a say, what a
    program outside answered, a run that goes on.

    Args:
        auction: The ``Auction`` message.
        terms: What was fixed when the round opened.
        ranked: The bids, ranked again.
        space: The scene parameters.
    """
    if auction.outcome != AuctionOutcome.AWARDED or auction.follows or auction.intervention:
        return ""
    if auction.strategy == EXTERNAL:
        return ""
    decision = Decision(
        terms=terms,
        outcome=AuctionOutcome.AWARDED,
        closed_by=ClosedBy(auction.closed_by),
        duration_s=auction.duration_s,
        ranked=ranked,
        refused=tuple(
            RefusedBid(
                agent=bid.agent,
                host=bid.host,
                kind=RoundKind(bid.kind),
                code=bid.code,
                reason=bid.reason,
            )
            for bid in auction.refused
        ),
        silent_hosts=tuple(auction.silent_hosts),
    )
    told = reason(decision)
    if auction.reason != told:
        return f"the reason was '{auction.reason}', now '{told}'"
    was, now = _lines(auction.explanation), _lines(explanation(decision, space))
    for before, after in zip([*was, ""], [*now, ""], strict=False):
        if before != after:
            return f"the explanation said '{before}', now '{after}'"
    return ""


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if _NOT_ASKED not in line]
