# SPDX-License-Identifier: Apache-2.0
"""Rules of a market, reconstructed from the recorded texts of its hosts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import SceneSpace
from bt_agents_language.files.market_reader import MARKET_FILE, MarketRule, read_market
from bt_agents_language.yaml.source import Source
from marketplace_node.round.precedence import apply_rules
from marketplace_node.settings import RULES

Rules = tuple[MarketRule, ...]


def rules_of_market(
    auctions: Sequence[Any], texts: Iterable[str], space: SceneSpace
) -> tuple[Rules, ...]:
    """Return the rules that agree with all rounds of one start of a market, at least one.

    A market reads its rules at its start, and its hosts send their texts at each change: so its
    rules may differ from the newest text, and a host of another folder may have none. If none
    agree, the result is the rules of the first text.

    Args:
        auctions: Rounds of the market.
        texts: Texts of ``market.yaml``, the most likely one first.
        space: The scene parameters.
    """
    candidates = [*(_rules(text, space) for text in texts), ()]
    agreeing = [
        rules for rules in candidates if all(_agree(rules, auction) for auction in auctions)
    ]
    return tuple(agreeing) or (candidates[0],)


def _rules(text: str, space: SceneSpace) -> Rules:
    """Return the rules of a text; none if it is invalid, because then no rule counts."""
    try:
        return read_market(Source(MARKET_FILE, text), space)
    except BtAgentsError:
        return ()


def _agree(rules: Rules, auction: Any) -> bool:
    """Return whether these rules agree with a round that rules ranked or only scored."""
    bidders = [bid.agent for bid in auction.ranking]
    if RULES not in (auction.strategy, auction.shadow_strategy) or not bidders:
        return True
    values = {value.name: value.value for value in auction.scene.values}
    rule = apply_rules(rules, values, auction.scene.person, bidders).rule
    first = [agent for agent in rule.agents if agent in bidders] if rule else []
    if auction.strategy == RULES:
        return [bid.agent for bid in auction.ranking if bid.score < 0.0] == first
    return not first or auction.shadow_winner == first[0]
