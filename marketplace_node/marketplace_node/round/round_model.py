# SPDX-License-Identifier: Apache-2.0
"""Model of a round in which everything but the scene is fixed, to score other scenes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from bt_agents_core.errors import Refused
from marketplace_node.formatting import shown
from marketplace_node.round.bid_table import BidTable
from marketplace_node.round.decision import External, Terms, UndecidedRule
from marketplace_node.round.precedence import AppliedRules, apply_precedence, apply_rules
from marketplace_node.settings import EXTERNAL, RULES
from marketplace_node.strategies import (
    LinearScores,
    RandomSource,
    RoundArrays,
    Scores,
    StrategySpec,
    order,
    round_rng,
)
from marketplace_node.strategies.arrays import Floats, Integers


@dataclass(frozen=True, kw_only=True)
class Scored:
    """Scores of one round; precedence, placed bids and undecided rules as in :class:`Ranked`."""

    scores: Scores
    precedence: str = ""
    placed: int = 0
    undecided: tuple[UndecidedRule, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundModel:
    """Bids of a round with the strategy, options and seed that rank them.

    ``field`` contains ``table`` as arrays; there is at least one bid.
    """

    terms: Terms
    table: BidTable
    field: RoundArrays
    spec: StrategySpec
    options: Mapping[str, float]
    seed: str
    external: External | None = None

    def score(self) -> Scored:
        """Return the scores for the scene of the round.

        Raises:
            Refused: ``STRATEGY_FAILED``; see :func:`scored`.
        """
        scores = scored(self.spec, self.field, self.options, round_rng(self.seed))
        applied = self._applied_rules()
        agents, why = self._first(applied)
        places = [self.table.agents.index(agent) for agent in agents]
        if not places:
            return Scored(scores=scores, undecided=applied.undecided)
        return Scored(
            scores=apply_precedence(scores, places),
            precedence=why,
            placed=len(places),
            undecided=applied.undecided,
        )

    def order(self, scores: Floats) -> Integers:
        """Return indices of the bids, best first; [..., N] to [..., N]."""
        last_run = self.field.rounds - self.field.idle
        return order(scores, last_run, None, self.terms.tie_break)

    def winners(self, scenes: Floats) -> Integers:
        """Return the winners in other scenes with the same random draws; [G, n] to [G].

        Raises:
            Refused: ``STRATEGY_FAILED``.
        """
        field = replace(self.field, scene=scenes)
        same = _SameForAll(round_rng(self.seed))
        scores = scored(self.spec, field, self.options, same).score
        return self.order(scores)[:, 0]

    def lines(self) -> LinearScores | None:
        """Return the scores as a function of the scene; None where they are not piecewise linear.

        Raises:
            Refused: ``STRATEGY_FAILED``, as in :func:`scored`.
        """
        if self.spec.lines is None:
            return None
        count, width = self.field.bids.shape
        with _guarded(self.spec):
            lines = self.spec.lines(
                self.field, self.spec.values(self.options), round_rng(self.seed)
            )
            weights = np.asarray(lines.weights, dtype=np.float64)
            by_bid = (width,) if weights.ndim == 1 else (count, width)
            return LinearScores(
                profiles=_checked("profiles of lines", lines.profiles, (count, width)),
                weights=_checked("weights of lines", weights, by_bid),
                offsets=_checked("offsets of lines", lines.offsets, (count,)),
            )

    def _applied_rules(self) -> AppliedRules:
        if self.spec.name != RULES:
            return AppliedRules()
        scene = self.terms.scene
        named = {value.name: value.value for value in scene.values}
        return apply_rules(self.terms.rules, named, scene.person, self.table.agents)

    def _first(self, applied: AppliedRules) -> tuple[list[str], str]:
        """Return the bidders that precede nearer ones, and why."""
        external, bidders = self.external, self.table.agents
        if applied.rule is not None:
            ours = [agent for agent in applied.rule.agents if agent in bidders]
            return ours, f"rule {applied.number}: {applied.rule.condition.text}"
        if self.spec.name == EXTERNAL and external is not None and not external.failure:
            return list(external.ranking), external.message
        return [], ""


def scored(
    spec: StrategySpec, field: RoundArrays, options: Mapping[str, float], random: RandomSource
) -> Scores:
    """Return the checked scores of a strategy, which may be third-party.

    Raises:
        Refused: ``STRATEGY_FAILED``; it raised, or it did not return one finite score per bid.
    """
    with _guarded(spec):
        scores = spec.score(field, spec.values(options), random)
        parts = (*field.shape, field.bids.shape[-1])
        return Scores(
            distance=_checked("distance", scores.distance, field.shape),
            bonus=_checked("bonus", scores.bonus, field.shape),
            score=_checked("score", scores.score, field.shape),
            contributions=_checked("contributions", scores.contributions, parts),
        )


@contextmanager
def _guarded(spec: StrategySpec) -> Iterator[None]:
    """Turn errors of a strategy into a ``Refused`` that names it."""
    try:
        yield
    except Refused as refused:
        raise Refused("STRATEGY_FAILED", f"strategy {spec.name}: {refused.reason}") from None
    except (Exception, SystemExit) as error:
        raise Refused(
            "STRATEGY_FAILED",
            f"strategy {spec.name} raised {type(error).__name__}: {shown(str(error))}",
        ) from error


def _checked(what: str, found: object, shape: tuple[int, ...]) -> Floats:
    array = np.asarray(found, dtype=np.float64)
    if array.shape != shape:
        raise Refused(
            "STRATEGY_FAILED",
            f"its {what} has the shape {list(array.shape)}, expected {list(shape)}",
        )
    if not np.isfinite(array).all():
        raise Refused("STRATEGY_FAILED", f"its {what} is not a finite number for every bid")
    return array


class _SameForAll:
    """Random source that repeats the draws of the round's own scene for each of many scenes."""

    def __init__(self, source: np.random.Generator) -> None:
        self._source = source

    def random(self, size: tuple[int, ...], /) -> Floats:
        return np.broadcast_to(self._source.random(size[1:]), size)

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        return np.broadcast_to(self._source.standard_normal(size[1:]), size)
