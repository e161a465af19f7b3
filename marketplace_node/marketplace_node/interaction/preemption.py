# SPDX-License-Identifier: Apache-2.0
"""Preemption round: decides whether a new scene stops the running agent."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

from marketplace_node.explanation.reason import preemption_reason
from marketplace_node.interaction.interaction import QueuedScene
from marketplace_node.interaction.phases import OpenRound
from marketplace_node.market_state import MarketState
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy, Decision
from marketplace_node.settings import EXTERNAL, Settings


class PreemptionRound:
    """Round for a queued scene during a run; the scene keeps its place in the queue."""

    def __init__(
        self, market_state: MarketState, queued: QueuedScene, running: str, now: float
    ) -> None:
        self.queued = queued
        # Any bid for an urgent scene stops the run, so no external ranking is needed.
        self.open_round = OpenRound(
            market_state, queued.scene, now, asks_external=not queued.scene.urgent
        )
        self._market_state = market_state
        self._running = running
        queued.asked = True
        queued.round = self.open_round.number

    def decide(
        self, by: ClosedBy, now: float, *, cooldown_left_s: float, no_room: str
    ) -> tuple[bool, str]:
        """Close the round and publish its decision; return whether the run is stopped, and why.

        Args:
            by: What closes the round.
            now: Steady time [s].
            cooldown_left_s: Only urgent scenes may stop a run for this time [s].
            no_room: Why the scene cannot wait; empty when it can.
        """
        settings = self._market_state.settings
        decision = self.open_round.close(by, now)
        worth = justifies_preemption(decision, self._running, settings)
        obstacle = ""
        if worth and cooldown_left_s > 0 and not decision.terms.scene.urgent:
            obstacle = f"the next stop may come in {cooldown_left_s:.1f} s at the earliest"
        stops = worth and not obstacle
        if stops:
            self.queued.drawn = self.open_round.number
            self.queued.excluded = self._no_more(decision)
        decision = replace(
            decision, outcome=AuctionOutcome.PREEMPTS if stops else AuctionOutcome.WAITS
        )
        reason = preemption_reason(
            decision, self._running, settings.preempt_margin, obstacle=obstacle, no_room=no_room
        )
        self._market_state.publish(decision, lambda: reason)
        return stops, reason

    def _no_more(self, decision: Decision) -> dict[str, str]:
        """Return the agents to exclude after the stop, so no agent is stopped in its own favour.

        With the same bids, the same random draw finds the same winner. So it is enough to exclude
        a stopped agent that did not bid but may bid now. An external program may rank differently
        the next time, so the stopped agent is always excluded there.
        """
        silent = all(bid.agent != self._running for bid in decision.ranking)
        if decision.terms.scene.urgent or not (silent or decision.terms.strategy == EXTERNAL):
            return {}
        return {self._running: f"its run was stopped for scene '{decision.terms.scene.scene_id}'"}

    def give_up(self, reason: str, now: float) -> None:
        """Close the round without a decision, because the run is ending anyway."""
        decision = self.open_round.close(ClosedBy.STOPPED, now, stopped=reason)
        decision = replace(decision, outcome=AuctionOutcome.WAITS)
        self._market_state.publish(
            decision, partial(preemption_reason, decision, self._running, 0.0)
        )


def justifies_preemption(decision: Decision, running: str, settings: Settings) -> bool:
    """Return whether the bids for a scene justify stopping the running agent.

    For an urgent scene any bid is enough. Any other scene needs another agent that is nearer by
    the margin; a running agent without a bid counts as infinitely far.
    """
    winner = decision.winner
    if winner is None:
        return False
    if decision.terms.scene.urgent:
        return True
    if winner.agent == running:
        return False
    own = next((bid.distance for bid in decision.ranking if bid.agent == running), math.inf)
    return own - winner.distance >= settings.preempt_margin
