# SPDX-License-Identifier: Apache-2.0
"""Ranking of the accepted bids of a round: a pure function of terms and bids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from marketplace_node.round.counterfactual import smallest_change
from marketplace_node.round.decision import (
    AcceptedBid,
    External,
    Ranked,
    RankedBid,
    Terms,
    UndecidedRule,
)
from marketplace_node.round.round_model import RoundModel, RoundScores, round_bids
from marketplace_node.strategies import STRATEGIES, StrategySpec

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
    accepted = _sorted(bids)
    model = _model(space, terms, accepted, external)
    fallback = external.failure if external is not None else ""
    try:
        scored = model.score()
    except Refused as refused:
        fallback = refused.reason
        model = replace(model, spec=STRATEGIES[FALLBACK])
        scored = model.score()
    places = model.order(scored.scores)
    shadow = _shadow(model)
    return Ranked(
        bids=_ranked(model, accepted, scored, places),
        bidders=tuple(bid.agent for bid in accepted),
        by=FALLBACK if fallback else model.spec.name,
        fallback=fallback,
        precedence=scored.precedence,
        placed=scored.placed,
        shadow_winner=shadow.winner,
        shadow_failure=shadow.failure,
        undecided=scored.undecided or shadow.undecided,
        find_change=(
            (lambda: smallest_change(model, scored.scores, places[1])) if len(places) > 1 else None
        ),
    )


def nearest(space: SceneSpace, terms: Terms, bids: Sequence[AcceptedBid]) -> tuple[RankedBid, ...]:
    """Return the bids ranked by Manhattan distance, whatever the strategy of the round."""
    if not bids:
        return ()
    accepted = _sorted(bids)
    model = _model(space, replace(terms, strategy=FALLBACK), accepted, None)
    scored = model.score()
    return _ranked(model, accepted, scored, model.order(scored.scores))


def _sorted(bids: Sequence[AcceptedBid]) -> list[AcceptedBid]:
    return sorted(bids, key=lambda bid: bid.agent)


def _spec(name: str) -> StrategySpec:
    spec = STRATEGIES.get(name)
    if spec is None:
        raise Refused(
            RefusalCode.UNKNOWN_STRATEGY,
            f"no strategy '{name}' is installed; there are {', '.join(STRATEGIES)}",
        )
    return spec


def _model(
    space: SceneSpace, terms: Terms, accepted: Sequence[AcceptedBid], external: External | None
) -> RoundModel:
    return RoundModel(
        space=space,
        terms=terms,
        given=round_bids(space, terms, accepted),
        spec=_spec(terms.strategy),
        options=terms.options,
        seed=terms.seed,
        external=external,
    )


def _ranked(
    model: RoundModel, accepted: Sequence[AcceptedBid], scored: RoundScores, places: Sequence[int]
) -> tuple[RankedBid, ...]:
    ranked = []
    for place in places:
        bid, of, score = accepted[place], model.given.bids[place], scored.scores[place]
        ranked.append(
            RankedBid(
                agent=bid.agent,
                agent_id=bid.agent_id,
                host=bid.host,
                instance=bid.instance,
                vector=bid.vector,
                distance=score.distance,
                contributions=score.contributions,
                weights=() if set(of.weights) == {1.0} else of.weights,
                bonus=score.bonus,
                score=score.score,
                runs=of.runs,
                last_run=of.last_run,
            )
        )
    return tuple(ranked)


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
    winner = model.given.bids[shadow.order(scored.scores)[0]].agent
    return _Shadow(winner=winner, undecided=scored.undecided)
