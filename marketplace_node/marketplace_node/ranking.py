# SPDX-License-Identifier: Apache-2.0
"""Ranks the accepted bids of a round: a pure function of the terms and the bids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from bt_agents.errors import Refused
from bt_agents.scene import SceneSpace
from marketplace_node.bid_table import BidTable, weights_of
from marketplace_node.contest import Contest, Measured
from marketplace_node.counterfactual import smallest_change
from marketplace_node.decision import AcceptedBid, External, Ranked, RankedBid, Terms
from marketplace_node.strategies import STRATEGIES, StrategySpec
from marketplace_node.strategies.field import Integers

FALLBACK = "manhattan"
"""What ranks when the strategy cannot."""


def decide(
    space: SceneSpace,
    terms: Terms,
    bids: Sequence[AcceptedBid] | BidTable,
    *,
    external: External | None = None,
) -> Ranked:
    """Rank bids; equal arguments give the equal ranking, on every start and in every order.

    Args:
        space: The scene parameters.
        terms: What was fixed at the opening of the round.
        bids: The accepted bids, one an agent.
        external: What a program outside answered, for the strategy ``external``; None when it was
            not asked.

    Raises:
        Refused: ``UNKNOWN_STRATEGY``: no strategy, or shadow, of that name is installed.
    """
    table = bids if isinstance(bids, BidTable) else BidTable.of(bids, space)
    if not len(table):
        return Ranked()
    contest = _contest(space, terms, table, external)
    fallback = external.failure if external is not None else ""
    try:
        measured = contest.measure()
    except Refused as refused:
        fallback = refused.reason
        contest = replace(contest, spec=STRATEGIES[FALLBACK])
        measured = contest.measure()
    places = contest.order(measured.scores.score)
    shadow_winner, shadow_failure = _shadow(contest)
    return Ranked(
        bids=_ranked(space, terms, table, measured, places),
        by=FALLBACK if fallback else contest.spec.name,
        fallback=fallback,
        precedence=measured.precedence,
        placed=measured.placed,
        shadow_winner=shadow_winner,
        shadow_failure=shadow_failure,
        find_change=partial(smallest_change, contest, places, space),
    )


def nearest(space: SceneSpace, terms: Terms, table: BidTable) -> tuple[RankedBid, ...]:
    """Return the bids ranked by their Manhattan distance, whatever the strategy of the round."""
    contest = _contest(space, replace(terms, strategy=FALLBACK), table, None)
    measured = contest.measure()
    return _ranked(space, terms, table, measured, contest.order(measured.scores.score))


def _spec(name: str) -> StrategySpec:
    spec = STRATEGIES.get(name)
    if spec is None:
        raise Refused(
            "UNKNOWN_STRATEGY",
            f"no strategy '{name}' is installed; there are {', '.join(STRATEGIES)}",
        )
    return spec


def _contest(
    space: SceneSpace, terms: Terms, table: BidTable, external: External | None
) -> Contest:
    return Contest(
        terms=terms,
        table=table,
        field=table.field(space, terms),
        spec=_spec(terms.strategy),
        options=terms.options,
        seed=terms.seed,
        external=external,
    )


def _ranked(
    space: SceneSpace, terms: Terms, table: BidTable, measured: Measured, places: Integers
) -> tuple[RankedBid, ...]:
    scores = measured.scores
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
    """Return the weights of each bid, empty where all are 1."""
    if table.weights is None:
        common = weights_of(space)
        return [() if set(common) == {1.0} else common] * len(places)
    rows = table.weights[places]
    return [
        () if alike else tuple(row)
        for row, alike in zip(rows.tolist(), (rows == 1.0).all(axis=1).tolist(), strict=True)
    ]


def _shadow(contest: Contest) -> tuple[str, str]:
    """Return who would have won by the shadow strategy, and why nobody, in words."""
    terms = contest.terms
    if not terms.shadow:
        return "", ""
    shadow = replace(
        contest,
        spec=_spec(terms.shadow),
        options=terms.shadow_options,
        seed=f"{terms.seed}/shadow",
        external=None,
    )
    try:
        scores = shadow.measure().scores
    except Refused as refused:
        return "", refused.reason
    return contest.table.agents[int(shadow.order(scores.score)[0])], ""
