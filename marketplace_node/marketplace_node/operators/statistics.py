# SPDX-License-Identifier: Apache-2.0
"""What the decisions of a market tell together: where the shadow disagrees, and who is starved."""

from __future__ import annotations

from marketplace_node.operators.starvation import Starvation
from marketplace_node.round.decision import AuctionOutcome, Decision


class MarketStatistics:
    """Counts over the rounds of a market.

    Attributes:
        shadow_rounds: Awarded rounds that the strategies in force, the one that ranks and its
            shadow, have both ranked.
        shadow_disagreements: In how many of these they had another winner.
        starvation: Who bids in vain.
    """

    def __init__(self) -> None:
        self.shadow_rounds = 0
        self.shadow_disagreements = 0
        self.starvation = Starvation()
        self._compared = ("", "")

    def take(self, decision: Decision) -> None:
        """Count a decision; one that only foretells is not to be counted."""
        winner, terms = decision.winner, decision.terms
        if winner is None or decision.outcome is not AuctionOutcome.AWARDED:
            return
        if (terms.strategy, terms.shadow) != self._compared:
            self._compared = (terms.strategy, terms.shadow)
            self.shadow_rounds = self.shadow_disagreements = 0
        if decision.shadow_winner and decision.ranked.by == terms.strategy:
            self.shadow_rounds += 1
            self.shadow_disagreements += decision.shadow_winner != winner.agent
