# SPDX-License-Identifier: Apache-2.0
"""Ranking of the accepted bids of a round: a pure function of terms and bids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from marketplace_node.round.bid_table import BidTable, weights_of
from marketplace_node.round.counterfactual import smallest_change
from marketplace_node.round.decision import (
    AcceptedBid,
    External,
    Ranked,
    RankedBid,
    Terms,
    UndecidedRule,
)
from marketplace_node.round.round_model import RoundModel, Scored
from marketplace_node.strategies import STRATEGIES, StrategySpec
from marketplace_node.strategies.arrays import Integers

FALLBACK = "manhattan"
"""Strategy that ranks when the one in force fails."""


def decide(
    space: SceneSpace,
    terms: Terms,
    bids: Sequence[AcceptedBid],
    *,
    external: External | None = None,
) -> Ranked:
    """Rank bids, one per agent; the result depends only on the arguments, not on their order.

    ``space`` is the space of profiles, as everywhere here; the scene may have further values.
    ``external`` is the answer of an external program; None when it was not asked.

    Raises:
        Refused: ``UNKNOWN_STRATEGY``; the strategy or the shadow is not installed.
    """
    if not bids:
        return Ranked()
    table = BidTable.of(bids, space)
    model = _model(space, terms, table, external)
    fallback = external.failure if external is not None else ""
    try:
        scored = model.score()
    except Refused as refused:
        fallback = refused.reason
        model = replace(model, spec=STRATEGIES[FALLBACK])
        scored = model.score()
    places = model.order(scored.scores.score)
    shadow = _shadow(model)
    return Ranked(
        bids=_ranked(space, terms, table, scored, places),
        bidders=table.agents,
        by=FALLBACK if fallback else model.spec.name,
        fallback=fallback,
        precedence=scored.precedence,
        placed=scored.placed,
        shadow_winner=shadow.winner,
        shadow_failure=shadow.failure,
        undecided=scored.undecided or shadow.undecided,
        find_change=lambda: smallest_change(model, places, space),
    )


def nearest(space: SceneSpace, terms: Terms, bids: Sequence[AcceptedBid]) -> tuple[RankedBid, ...]:
    """Return the bids ranked by Manhattan distance, whatever the strategy of the round."""
    if not bids:
        return ()
    table = BidTable.of(bids, space)
    model = _model(space, replace(terms, strategy=FALLBACK), table, None)
    scored = model.score()
    return _ranked(space, terms, table, scored, model.order(scored.scores.score))


def _spec(name: str) -> StrategySpec:
    spec = STRATEGIES.get(name)
    if spec is None:
        raise Refused(
            "UNKNOWN_STRATEGY",
            f"no strategy '{name}' is installed; there are {', '.join(STRATEGIES)}",
        )
    return spec


def _model(
    space: SceneSpace, terms: Terms, table: BidTable, external: External | None
) -> RoundModel:
    return RoundModel(
        terms=terms,
        table=table,
        field=table.field(space, terms),
        spec=_spec(terms.strategy),
        options=terms.options,
        seed=terms.seed,
        external=external,
    )


def _ranked(
    space: SceneSpace, terms: Terms, table: BidTable, scored: Scored, places: Integers
) -> tuple[RankedBid, ...]:
    scores = scored.scores
    columns = zip(
        places.tolist(),
        table.vectors[places].tolist(),
        scores.contributions[places].tolist(),
        _weights(space, table, places),
        scores.distance[places].tolist(),
        scores.bonus[places].tolist(),
        scores.score[places].tolist(),
        strict=True,
    )
    return tuple(
        RankedBid(
            agent=table.agents[index],
            agent_id=table.agent_ids[index],
            host=table.hosts[index],
            instance=table.instances[index],
            vector=tuple(vector),
            distance=distance,
            contributions=tuple(contributions),
            weights=weights,
            bonus=bonus,
            score=score,
            runs=terms.runs.get(table.agents[index], 0),
            last_run=terms.last_run.get(table.agents[index], 0),
        )
        for index, vector, contributions, weights, distance, bonus, score in columns
    )


def _weights(space: SceneSpace, table: BidTable, places: Integers) -> list[tuple[float, ...]]:
    """Return the weights of each bid; empty where all are 1."""
    if table.weights is None:
        common = weights_of(space)
        return [() if set(common) == {1.0} else common] * len(places)
    rows = table.weights[places]
    return [
        () if alike else tuple(row)
        for row, alike in zip(rows.tolist(), (rows == 1.0).all(axis=1).tolist(), strict=True)
    ]


class _Shadow(NamedTuple):
    """Outcome of the shadow strategy; see :class:`Ranked`."""

    winner: str = ""
    failure: str = ""
    undecided: tuple[UndecidedRule, ...] = ()


def _shadow(model: RoundModel) -> _Shadow:
    terms = model.terms
    if not terms.shadow:
        return _Shadow()
    shadow = replace(
        model,
        spec=_spec(terms.shadow),
        options=terms.shadow_options,
        seed=f"{terms.seed}/shadow",
        external=None,
    )
    try:
        scored = shadow.score()
    except Refused as refused:
        return _Shadow(failure=refused.reason)
    winner = model.table.agents[int(shadow.order(scored.scores.score)[0])]
    return _Shadow(winner=winner, undecided=scored.undecided)
