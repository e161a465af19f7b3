# SPDX-License-Identifier: Apache-2.0
"""Rounds of the market made by hand, and a plain sum to compare distances with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from bt_agents_core.scene import Scene, Vector
from market_harness import SPACE, scene
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import AcceptedBid, ClosedBy, Decision, Terms
from marketplace_node.round.ranking import decide


def added_up(bid: Vector, wanted: Vector) -> float:
    """Return the Manhattan distance, added up by a plain loop."""
    distance = 0.0
    for offered, value in zip(bid, wanted, strict=True):
        if not math.isnan(value):
            distance += abs(offered - value)
    return distance


def terms(awarded_for: Scene | None = None, **changes: Any) -> Terms:
    """Return valid terms of a round, apart from ``changes``."""
    values: dict[str, Any] = {
        "epoch": "epoch",
        "round": 4,
        "follows": 0,
        "scene": awarded_for or scene(),
        "strategy": "manhattan",
        "tie_break": "least_recently_run",
        "seed": "epoch/4",
    }
    return Terms(**(values | changes))


def bids(vectors: Mapping[str, Vector], **weights: Vector) -> list[AcceptedBid]:
    """Return one accepted bid per agent; ids count from 1."""
    return [
        AcceptedBid(
            agent=agent,
            agent_id=number,
            host="/agents",
            instance="first",
            vector=vector,
            weights=weights.get(agent, ()),
        )
        for number, (agent, vector) in enumerate(vectors.items(), 1)
    ]


def decided(of: Terms, accepted: Sequence[AcceptedBid], **changes: Any) -> Decision:
    """Return the decision of a round that all agents have answered."""
    external = changes.pop("external", None)
    ranked = decide(changes.pop("space", SPACE), of, accepted, external=external)
    values: dict[str, Any] = {
        "terms": of,
        "outcome": AuctionOutcome.AWARDED if ranked.bids else AuctionOutcome.NO_BIDS,
        "closed_by": ClosedBy.ALL_ANSWERED,
        "duration_s": 0.01,
        "ranked": ranked,
        "refused": (),
        "silent_hosts": (),
    }
    return Decision(**(values | changes))
