# SPDX-License-Identifier: Apache-2.0
"""Previews: rounds that show who would win, without a run and uncounted."""

from __future__ import annotations

from functools import partial

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Scene
from marketplace_node.effects import PreviewEnded
from marketplace_node.explanation.reason import reason_of
from marketplace_node.interaction.open_round import OpenRound
from marketplace_node.market_state import MarketState
from marketplace_node.settings import check_strategy

MOST = 8
"""As many previews may be under way at once."""


class Previews:
    """Open previews, each of which ends once."""

    def __init__(self, market_state: MarketState) -> None:
        self._market_state = market_state
        self._open: list[OpenRound] = []

    @property
    def open_rounds(self) -> list[OpenRound]:
        """Open rounds of all previews."""
        return list(self._open)

    def ask(self, scene: Scene, strategy: str, now: float) -> int:
        """Open a preview and return its number; ``strategy`` is empty for the one in force.

        Raises:
            Refused: ``UNKNOWN_STRATEGY`` or ``BUSY``.
        """
        strategy = strategy or self._market_state.settings.strategy
        check_strategy(strategy)
        if len(self._open) >= MOST:
            raise Refused(
                "BUSY", f"{MOST} previews are under way, and more may not be; ask again later"
            )
        preview = OpenRound(self._market_state, scene, now, preview=strategy)
        self._open.append(preview)
        return preview.number

    def update(self, now: float) -> None:
        """End the previews that are due."""
        for preview in self.open_rounds:
            by = preview.closing(now)
            if by is not None:
                self._open.remove(preview)
                decision = preview.close(by, now)
                outcome = self._market_state.outcome(decision, partial(reason_of, decision))
                self._market_state.effects.append(
                    PreviewEnded(number=preview.number, outcome=outcome)
                )

    def give_up(self, code: str, reason: str) -> None:
        """End all previews without an outcome."""
        for preview in self._open:
            self._market_state.effects.append(
                PreviewEnded(number=preview.number, outcome=Refused(code, reason))
            )
        self._open = []
