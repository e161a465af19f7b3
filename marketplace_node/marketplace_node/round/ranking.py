# SPDX-License-Identifier: Apache-2.0
"""Ranking of the accepted bids of a round: a pure function of terms and bids.

:func:`decide` ranks the bids for the scene of the round, :func:`smallest_change` for other scenes;
both let a :class:`RoundModel` score and order them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from marketplace_node.formatting import shown
from marketplace_node.round.decision import (
    AcceptedBid,
    Counterfactual,
    External,
    Ranked,
    RankedBid,
    Terms,
    UndecidedRule,
)
from marketplace_node.round.precedence import AppliedRules, apply_precedence, apply_rules
from marketplace_node.settings import EXTERNAL, RULES
from marketplace_node.strategies import (
    STRATEGIES,
    Bid,
    RoundBids,
    Score,
    StrategySpec,
    order,
    winners,
)

FALLBACK = "manhattan"
"""Strategy that ranks when the one in force fails."""

FINEST = 80
"""Maximum number of steps that divide the range of a parameter."""

COARSEST = 8
"""Fewest steps; where bids are too many for them, nothing is tried."""

MOST_NUMBERS = 100_000
"""Most numbers of bids that all tries together compare with a scene."""


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


@dataclass(frozen=True, kw_only=True)
class RoundScores:
    """Scores of one round; precedence, placed bids and undecided rules as in :class:`Ranked`."""

    scores: Sequence[Score]
    precedence: str = ""
    placed: int = 0
    undecided: tuple[UndecidedRule, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundModel:
    """Bids of a round with the strategy, options and seed that rank them.

    ``given`` contains at least one bid.
    """

    space: SceneSpace
    terms: Terms
    given: RoundBids
    spec: StrategySpec
    options: Mapping[str, float]
    seed: str
    external: External | None = None

    def score(self) -> RoundScores:
        """Return the scores for the scene of the round.

        Raises:
            Refused: ``STRATEGY_FAILED``; see :func:`strategy_scores`.
        """
        scores = strategy_scores(self.spec, self.given, self.options, self.seed)
        applied = self._applied_rules()
        agents, why = self._first(applied)
        if not agents:
            return RoundScores(scores=scores, undecided=applied.undecided)
        bidders = self._bidders()
        return RoundScores(
            scores=apply_precedence(scores, [bidders.index(agent) for agent in agents]),
            precedence=why,
            placed=len(agents),
            undecided=applied.undecided,
        )

    def order(self, scores: Sequence[Score]) -> list[int]:
        """Return the indices of the bids, best first."""
        return order([one.score for one in scores], self.given.bids, self.terms.tie_break)

    def with_value(self, index: int, value: float) -> RoundModel:
        """Return the same round for a scene with another value of one parameter."""
        vector = list(self.given.scene)
        vector[index] = value
        given = replace(self.given, scene=tuple(vector))
        if self.spec.name != RULES:
            # Nothing else looks at the scene of the terms.
            return replace(self, given=given)
        scene = self.terms.scene
        values = list(scene.values)
        values[index] = replace(values[index], value=value)
        scene = replace(scene, values=tuple(values))
        return replace(self, given=given, terms=replace(self.terms, scene=scene))

    def _applied_rules(self) -> AppliedRules:
        if self.spec.name != RULES:
            return AppliedRules()
        scene = self.terms.scene
        named = {value.name: value.value for value in scene.values}
        return apply_rules(self.terms.rules, named, scene.person, self._bidders())

    def _first(self, applied: AppliedRules) -> tuple[list[str], str]:
        """Return the bidders that precede nearer ones, and why."""
        external = self.external
        if applied.rule is not None:
            bidders = set(self._bidders())
            ours = [agent for agent in applied.rule.agents if agent in bidders]
            return ours, f"rule {applied.number}: {applied.rule.condition.text}"
        if self.spec.name == EXTERNAL and external is not None and not external.failure:
            return list(external.ranking), external.message
        return [], ""

    def _bidders(self) -> list[str]:
        return [bid.agent for bid in self.given.bids]


def round_bids(space: SceneSpace, terms: Terms, accepted: Sequence[AcceptedBid]) -> RoundBids:
    """Return the input of a strategy; ``accepted`` is sorted by the agents' names."""
    scene = space.compared(terms.scene)
    return RoundBids(
        scene=scene.vector,
        std=tuple(0.0 if math.isnan(std) else std for std in scene.std),
        widths=space.widths,
        rounds=terms.rounds_run,
        bids=tuple(
            Bid(
                agent=bid.agent,
                profile=bid.vector,
                weights=bid.weights or space.weights,
                runs=terms.runs.get(bid.agent, 0),
                last_run=terms.last_run.get(bid.agent, 0),
            )
            for bid in accepted
        ),
    )


def strategy_scores(
    spec: StrategySpec, given: RoundBids, options: Mapping[str, float], seed: str
) -> list[Score]:
    """Return the checked scores of a strategy, which may be third-party.

    Raises:
        Refused: ``STRATEGY_FAILED``; it raised, or it did not return one finite score per bid.
    """
    try:
        found = spec.score(given, spec.values(options), spec.random(seed))
        scores = [
            Score(float(distance), float(bonus), float(score), tuple(map(float, contributions)))
            for distance, bonus, score, contributions in found
        ]
    except (Exception, SystemExit) as error:
        raise Refused(
            RefusalCode.STRATEGY_FAILED,
            f"strategy {spec.name} raised {type(error).__name__}: {shown(str(error))}",
        ) from error
    if problem := _problem(scores, given):
        raise Refused(RefusalCode.STRATEGY_FAILED, f"strategy {spec.name}: {problem}")
    return scores


def _problem(scores: Sequence[Score], given: RoundBids) -> str:
    """Return the problem of the scores; empty for none."""
    if len(scores) != len(given.bids):
        return f"it returns {len(scores)} scores for {len(given.bids)} bids"
    for bid, score in zip(given.bids, scores, strict=True):
        parts, expected = len(score.contributions), len(given.scene)
        if parts != expected:
            return f"{bid.agent} has {parts} contributions, expected {expected}"
        if not all(map(math.isfinite, (*score[:3], *score.contributions))):
            return f"the score of {bid.agent} is not finite"
    return ""


_Try = tuple[float, int, float]
"""Size of a change, index of the parameter, and its changed value."""


def smallest_change(model: RoundModel, scores: Sequence[Score], runner_up: int) -> Counterfactual:
    """Return the smallest change of one parameter that makes the runner-up win.

    It ranks the round again with each parameter at each step of its range, and takes the nearest
    value.

    Args:
        model: The round.
        scores: Scores of the unchanged round.
        runner_up: Index of a bid.
    """
    known = [index for index, x in enumerate(model.given.scene) if not math.isnan(x)]
    external = model.external
    if not known:
        return Counterfactual(obstacle="no value of the scene is known")
    if model.spec.name == EXTERNAL and external and not external.failure:
        return Counterfactual(obstacle="only the external program can rank another scene")
    numbers = len(model.given.bids) * len(model.given.scene) * len(known)
    steps = min(FINEST, MOST_NUMBERS // numbers)
    if steps < COARSEST:
        return Counterfactual(obstacle="there are too many bids to search for it")
    tries: list[_Try] = []
    for index in known:
        one, now = model.space.parameters[index], model.given.scene[index]
        for step in range(steps + 1):
            value = one.minimum + (one.maximum - one.minimum) * step / steps
            tries.append((abs(value - now), index, value))
    tries.sort()
    try:
        for (_, index, value), winner in zip(tries, _winners(model, scores, tries), strict=True):
            if winner == runner_up:
                name = model.space.parameters[index].name
                return Counterfactual(names=(name,), values=(value,))
    except Refused as refused:
        return Counterfactual(obstacle=refused.reason)
    return Counterfactual()


def _winners(model: RoundModel, scores: Sequence[Score], tries: Sequence[_Try]) -> Iterable[int]:
    """Return the index of the winner for each change of a parameter to a value."""
    if model.spec.difference is None:
        return (_winner(model.with_value(index, value)) for _, index, value in tries)
    scenes = np.tile(model.given.scene, (len(tries), 1))
    for scene, (_, index, value) in zip(scenes, tries, strict=True):
        scene[index] = value
    bonuses = [score.bonus for score in scores]
    return winners(model.spec.difference, scenes, model.given.bids, bonuses, model.terms.tie_break)


def _winner(model: RoundModel) -> int:
    return model.order(model.score().scores)[0]
