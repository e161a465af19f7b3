# SPDX-License-Identifier: Apache-2.0
"""A round from its call for bids to its close, with the clock that bounds it."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents.scene import Scene
from marketplace_node.auction import Auction, Bids, ClosedBy, Decision
from marketplace_node.effects import OpenCall
from marketplace_node.floor import Floor


class OpenRound:
    """Calls for bids and takes them; its owner closes it when :meth:`closing` says so.

    Args:
        floor: Counts the round and says whom to ask.
        scene: What the bids are for.
        now: Steady time [s].
        follows: The round this one continues, 0 for none.
        excluded: Agents that may not bid, with the reason.

    Attributes:
        number: Number of the round.
        scene: What the bids are for.
    """

    def __init__(
        self,
        floor: Floor,
        scene: Scene,
        now: float,
        *,
        follows: int = 0,
        excluded: Mapping[str, str] | None = None,
    ) -> None:
        excluded = excluded or {}
        asked, unasked = floor.whom_to_ask(excluded, now)
        terms = floor.terms(scene, follows=follows, excluded=excluded, unasked=unasked)
        self.number = terms.round
        self.scene = scene
        self._auction = Auction(floor.space, terms, asked)
        self._limit_s = floor.settings.bid_deadline_s
        self._opened: float | None = None
        # A call that is never published has to end, too.
        self._deadline = now + 2 * self._limit_s
        if asked:
            floor.effects.append(
                OpenCall(
                    round=self.number,
                    scene=scene,
                    deadline_s=self._limit_s,
                    excluded=tuple(excluded),
                    hosts=len(floor.registry.live(now)),
                )
            )

    def called(self, now: float) -> None:
        """Start the clock, as the call for bids is published."""
        self._opened = now
        self._deadline = now + self._limit_s

    def excuse(self, lasted_s: float) -> None:
        """Move the deadline, as nobody has listened for so long [s]."""
        self._deadline += lasted_s

    def take(self, bids: Bids) -> None:
        """Take a host's answer, whatever it looks like."""
        self._auction.take(bids)

    def closing(self, now: float) -> ClosedBy | None:
        """Return what closes the round at this time; None while it has to stay open."""
        if self._auction.complete:
            return ClosedBy.ALL_ANSWERED
        return ClosedBy.DEADLINE if now >= self._deadline else None

    def close(self, by: ClosedBy, now: float, *, stopped: str = "") -> Decision:
        """Return the decision; ``stopped`` says why, when the round is stopped."""
        opened = now if self._opened is None else self._opened
        return self._auction.close(by, now - opened, stopped=stopped)
