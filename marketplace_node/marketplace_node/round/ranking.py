# SPDX-License-Identifier: Apache-2.0
"""Ranking of the accepted bids of a round: a pure function of terms and bids."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import NamedTuple, overload

import numpy as np

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from marketplace_node.round.bid_table import BidTable, weights_of
from marketplace_node.round.counterfactual import smallest_change
from marketplace_node.round.decision import (
    AcceptedBid,
    Counterfactual,
    External,
    Ranked,
    RankedBid,
    Terms,
    UndecidedRule,
)
from marketplace_node.round.round_model import RoundModel, Scored
from marketplace_node.strategies import STRATEGIES, StrategySpec
from marketplace_node.strategies.arrays import Integers, Sum
from marketplace_node.strategies.nearest import MANHATTAN, weighted_distance
from marketplace_node.strategies.nearest import nearest as nearest_rows

FALLBACK = "manhattan"
"""What ranks when the strategy cannot."""

FEW = 60
"""Up to so many numbers, bids are ranked one by one, which is faster than arrays."""

_MODEST = 1e100


def decide(
    space: SceneSpace,
    terms: Terms,
    bids: Sequence[AcceptedBid] | BidTable,
    *,
    external: External | None = None,
) -> Ranked:
    """Rank bids, one an agent; equal arguments give the equal ranking, in every order.

    ``space`` is that of profiles, as everywhere here; the scene may have further values.
    ``external`` is what a program outside answered, None when it was not asked.

    Raises:
        Refused: ``UNKNOWN_STRATEGY``: no strategy, or shadow, of that name is installed.
    """
    table = bids if isinstance(bids, BidTable) else BidTable.of(bids, space)
    if not len(table):
        return Ranked()
    spec = _spec(terms.strategy)
    if spec.sum is not None and external is None and _is_modest(space):
        return _lazily_ranked(space, terms, table, spec, spec.sum)
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
        bids=LazyRanking(
            _ranked(space, terms, table, scored, places[:1])[0],
            len(table),
            partial(_ranked, space, terms, table, scored, places),
        ),
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


def nearest(space: SceneSpace, terms: Terms, table: BidTable) -> tuple[RankedBid, ...]:
    """Return the bids ranked by their Manhattan distance, whatever the strategy of the round."""
    model = _model(space, replace(terms, strategy=FALLBACK), table, None)
    scored = model.score()
    return _ranked(space, terms, table, scored, model.order(scored.scores.score))


def _lazily_ranked(
    space: SceneSpace, terms: Terms, table: BidTable, spec: StrategySpec, distance: Sum
) -> Ranked:
    """Rank the winner eagerly and the others lazily."""

    @cache
    def rest() -> tuple[RoundModel, Scored, Integers]:
        model = _model(space, terms, table, None)
        scored = model.score()
        return model, scored, model.order(scored.scores.score)

    def change() -> Counterfactual | None:
        model, _, places = rest()
        return smallest_change(model, places, space)

    def ranked() -> tuple[RankedBid, ...]:
        if table.vectors.size > FEW:
            return _ranked(space, terms, table, *rest()[1:])
        bids = [_bid(space, terms, table, distance, row) for row in range(len(table))]
        by_run = terms.tie_break == "least_recently_run"
        return tuple(sorted(bids, key=lambda bid: (bid.score, bid.last_run if by_run else 0)))

    best = winning_row(space, terms, table, distance)
    shadow = _shadow(_model(space, terms, table, None)) if terms.shadow else _Shadow()
    return Ranked(
        bids=LazyRanking(_bid(space, terms, table, distance, best), len(table), ranked),
        bidders=table.agents,
        by=spec.name,
        shadow_winner=shadow.winner,
        shadow_failure=shadow.failure,
        undecided=shadow.undecided,
        find_change=change,
    )


def _is_modest(space: SceneSpace) -> bool:
    """Return whether any distance within the ranges is a finite number."""
    return all(max(-one.minimum, one.maximum) < _MODEST for one in space.parameters)


def winning_row(
    space: SceneSpace, terms: Terms, table: BidTable, distance: Sum = MANHATTAN
) -> int:
    """Return the row of the bid that wins: the nearest one, of equals as the terms say."""
    weights = weights_of(space) if table.weights is None else table.weights
    rows = nearest_rows(
        table.vectors, np.array(space.compared(terms.scene).vector), distance, weights
    )
    if len(rows) == 1 or terms.tie_break != "least_recently_run":
        return rows[0]
    return min(rows, key=lambda row: terms.last_run.get(table.agents[row], 0))


def _bid(space: SceneSpace, terms: Terms, table: BidTable, distance: Sum, row: int) -> RankedBid:
    vector = tuple(table.vectors[row].tolist())
    stated = weights_of(space) if table.weights is None else tuple(table.weights[row].tolist())
    scene = space.compared(terms.scene).vector
    total, parts = weighted_distance(vector, scene, distance, stated)
    agent = table.agents[row]
    return RankedBid(
        agent=agent,
        agent_id=table.agent_ids[row],
        host=table.hosts[row],
        instance=table.instances[row],
        vector=vector,
        distance=total,
        contributions=parts,
        weights=() if set(stated) == {1.0} else stated,
        bonus=0.0,
        score=total,
        runs=terms.runs.get(agent, 0),
        last_run=terms.last_run.get(agent, 0),
    )


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
    """Return the weights of each bid, empty where all are 1."""
    if table.weights is None:
        common = weights_of(space)
        return [() if set(common) == {1.0} else common] * len(places)
    rows = table.weights[places]
    return [
        () if alike else tuple(row)
        for row, alike in zip(rows.tolist(), (rows == 1.0).all(axis=1).tolist(), strict=True)
    ]


class _Shadow(NamedTuple):
    """Outcome of the shadow strategy, as :class:`Ranked` has it."""

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


class LazyRanking(Sequence[RankedBid]):
    """Ranking whose winner is computed eagerly and the rest lazily.

    Args:
        best: The first.
        count: How many there are.
        rank: Returns all of them; asked once, when another than the first is looked at.
    """

    def __init__(
        self, best: RankedBid, count: int, rank: Callable[[], tuple[RankedBid, ...]]
    ) -> None:
        self._best = best
        self._count = count
        self._rank = rank

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> RankedBid: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[RankedBid, ...]: ...

    def __getitem__(self, index: int | slice) -> RankedBid | tuple[RankedBid, ...]:
        return self._best if index == 0 else self._all[index]

    def __iter__(self) -> Iterator[RankedBid]:
        return iter(self._all)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self._all == tuple(other)

    def __repr__(self) -> str:
        return repr(self._all)

    @cached_property
    def _all(self) -> tuple[RankedBid, ...]:
        return self._rank()
