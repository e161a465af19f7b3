# SPDX-License-Identifier: Apache-2.0
"""Scores of a round: as it is, and as it would be for another scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from marketplace_node.formatting import shown
from marketplace_node.round.decision import AcceptedBid, External, Terms, UndecidedRule
from marketplace_node.round.precedence import AppliedRules, apply_precedence, apply_rules
from marketplace_node.settings import EXTERNAL, RULES
from marketplace_node.strategies import Bid, RoundBids, Score, StrategySpec, order


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
