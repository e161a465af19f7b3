# SPDX-License-Identifier: Apache-2.0
"""Precedence of bids over nearer ones, by a rule of ``market.yaml`` or an external ranking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.name_resolution import SceneFacts, resolve, surely_true
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.formatting import shown
from marketplace_node.round.decision import UndecidedRule
from marketplace_node.strategies import Score

_BIDDERS_NAMED = 5


@dataclass(frozen=True, kw_only=True)
class AppliedRules:
    """Rules of the market for one scene and its bidders.

    Attributes:
        number: Number of the rule that holds, from 1; 0 for none.
        rule: The rule that holds; None for none.
        undecided: Rules before it that could not be decided.
    """

    number: int = 0
    rule: MarketRule | None = None
    undecided: tuple[UndecidedRule, ...] = ()


def apply_rules(
    rules: Sequence[MarketRule], values: Mapping[str, float], person: bool, agents: Sequence[str]
) -> AppliedRules:
    """Return the first rule that holds and names a bidder.

    A condition on a missing value (NaN) does not hold, nor does an undecided one.
    """
    names = partial(resolve, scene=SceneFacts(person=person, values=values))
    bidders = set(agents)
    undecided: list[UndecidedRule] = []
    for number, rule in enumerate(rules, 1):
        if bidders.isdisjoint(rule.agents):
            continue
        try:
            if surely_true(rule.condition, names):
                return AppliedRules(number=number, rule=rule, undecided=tuple(undecided))
        except Undecided as error:
            place = rule.position
            message = f"{place}: rule {number} {error}"
            undecided.append(UndecidedRule(file=place.file, line=place.line, message=message))
    return AppliedRules(undecided=tuple(undecided))


def check_ranking(ranking: Sequence[str], bidders: Sequence[str]) -> tuple[str, ...]:
    """Check that an external ranking names only bidders and none twice; return it, best first.

    Raises:
        Refused: ``EMPTY``, ``UNKNOWN_AGENT`` or ``DUPLICATE``.
    """
    if not ranking:
        raise Refused(
            RefusalCode.EMPTY, "it ranks nobody, expected the names of bidders, best first"
        )
    known = set(bidders)
    named: set[str] = set()
    for agent in ranking:
        if agent not in known:
            few = ", ".join(bidders[:_BIDDERS_NAMED]) + (
                " …" if len(bidders) > _BIDDERS_NAMED else ""
            )
            raise Refused(
                RefusalCode.UNKNOWN_AGENT,
                f"it ranks '{shown(agent)}', which has not bid; there are {few}",
            )
        if agent in named:
            raise Refused(
                RefusalCode.DUPLICATE, f"it ranks '{agent}' twice, expected each bidder once"
            )
        named.add(agent)
    return tuple(ranking)


def apply_precedence(scores: Sequence[Score], places: Sequence[int]) -> list[Score]:
    """Put the bids at some places first, in that order; distances rank the rest.

    The k-th of m such bids gets the score k - m, below every distance. This is not exploration, so
    there is no bonus.
    """
    result = [one._replace(bonus=0.0, score=one.distance) for one in scores]
    for number, place in enumerate(places):
        result[place] = result[place]._replace(score=float(number - len(places)))
    return result
