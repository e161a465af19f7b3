# SPDX-License-Identifier: Apache-2.0
"""Precedence of bids over nearer ones, by a rule of ``market.yaml`` or an external ranking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from bt_agents_core.errors import Refused
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.name_resolution import SceneFacts, resolve, surely_true
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.formatting import shown
from marketplace_node.strategies import Scores

_BIDDERS_NAMED = 5


def applicable_rule(
    rules: Sequence[MarketRule], values: Mapping[str, float], person: bool, agents: Sequence[str]
) -> tuple[int, MarketRule] | None:
    """Return the first rule that holds and names a bidder, with its number from 1.

    A condition on a missing value, NaN, does not hold, nor does one that cannot be decided.
    """

    def holds(rule: MarketRule) -> bool:
        try:
            return surely_true(rule.condition, names)
        except Undecided:
            return False

    names = partial(resolve, scene=SceneFacts(person=person, values=values))
    bidders = set(agents)
    for number, rule in enumerate(rules, 1):
        if not bidders.isdisjoint(rule.agents) and holds(rule):
            return number, rule
    return None


def check_ranking(ranking: Sequence[str], bidders: Sequence[str]) -> tuple[str, ...]:
    """Return a ranking from outside, best first, when it names bidders only and none twice.

    Raises:
        Refused: ``EMPTY``, ``UNKNOWN_AGENT`` or ``DUPLICATE``.
    """
    if not ranking:
        raise Refused("EMPTY", "it ranks nobody, expected the names of bidders, best first")
    known = set(bidders)
    named: set[str] = set()
    for agent in ranking:
        if agent not in known:
            few = ", ".join(bidders[:_BIDDERS_NAMED]) + (
                " …" if len(bidders) > _BIDDERS_NAMED else ""
            )
            raise Refused(
                "UNKNOWN_AGENT", f"it ranks '{shown(agent)}', which has not bid; there are {few}"
            )
        if agent in named:
            raise Refused("DUPLICATE", f"it ranks '{agent}' twice, expected each bidder once")
        named.add(agent)
    return tuple(ranking)


def apply_precedence(scores: Scores, places: Sequence[int]) -> Scores:
    """Put the bids at some places first, in that order; what is left is ranked by its distance.

    The score of the k-th of m such bids is k - m, below every distance. That is a place and no
    exploration, so there is no bonus.
    """
    score = scores.distance.copy()
    score[list(places)] = np.arange(len(places)) - float(len(places))
    return replace(scores, bonus=np.zeros_like(score), score=score)
