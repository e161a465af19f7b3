# SPDX-License-Identifier: Apache-2.0
"""State machine of a scripted play: the next visit, its end, and its timed changes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bt_agents_core.scene import first_id
from bt_agents_language.model.specs import SceneChange, Script, Visit

TAKEN_WITHIN_S = 5.0
"""A market that stays idle this long after a scene was sent has not got it [s]."""

AGAIN_WITHIN_S = 10.0
"""A restarted market that stays idle this long will not ask for the scene again [s]."""


@dataclass(frozen=True, kw_only=True)
class MarketView:
    """State of the market as a play needs it; the fields are those of ``MarketStatus.msg``."""

    epoch: str
    idle: bool
    agents: int
    finished_scene_id: str


class ScriptPerformance:
    """Plays the visits of a script one after the other, each until the market has finished it.

    A visit whose run a restarted market takes up again goes on as that. It is begun again when the
    restarted market knows nothing of it, or when its scene was not taken, so a play neither hangs
    nor skips a visit, nor serves a visitor twice.

    Args:
        wait_for_agents: The market must have so many agents before a visit begins.
        pace: Speed of the visits relative to real time.

    Example:
        The owner reports what happens and asks what to do: ``market`` and ``over`` at every
        status, ``next`` between visits, ``announced`` with the id of the visit's scene,
        ``started`` and ``due`` during its run.
    """

    def __init__(self, script: Script, *, wait_for_agents: int = 1, pace: float = 1.0) -> None:
        self._script = script
        self._pace = pace
        self._wait_for_agents = wait_for_agents
        self._market: MarketView | None = None
        self._idle_since = math.inf
        self._index = 0
        self._epoch = ""
        self._begun_at = math.inf
        self._limit_s = TAKEN_WITHIN_S
        self._scene_id = ""
        self._started_at: float | None = None
        self._early_start: tuple[str, float] | None = None
        self._changes: list[SceneChange] = []
        self._under_way = False

    @property
    def done(self) -> bool:
        """True when all visits are over."""
        return self._index >= len(self._script.visits)

    @property
    def number(self) -> int:
        """Number of the visit under way or next, from 1."""
        return self._index + 1

    @property
    def visit(self) -> Visit | None:
        """The visit under way."""
        return self._script.visits[self._index] if self._under_way else None

    def market(self, market: MarketView, now: float) -> None:
        """Take the latest status of the market, at steady time ``now`` [s]."""
        was_idle = self._market is not None and self._market.idle
        if market.idle and not was_idle:
            self._idle_since = now
        self._market = market
        if self._under_way and market.epoch != self._epoch:
            self._epoch = market.epoch
            self._begun_at = now
            self._limit_s = AGAIN_WITHIN_S
            self._started_at = None

    def over(self) -> bool:
        """Return True once when the visit under way is over."""
        if not self._under_way or self._market is None:
            return False
        if self._is_of_visit(self._market.finished_scene_id):
            self._under_way = False
            self._index += 1
        return not self._under_way

    def not_taken(self, now: float) -> bool:
        """Return True once when the market leaves the scene of the visit lying about."""
        if not self._under_way or self._market is None or not self._market.idle:
            return False
        self._under_way = now - max(self._idle_since, self._begun_at) <= self._limit_s
        return not self._under_way

    def next(self, now: float) -> Visit | None:
        """Begin the next visit when the market is ready for it and return it, else None."""
        if self._under_way or self.done or self._market is None:
            return None
        if not self._market.idle or self._market.agents < self._wait_for_agents:
            return None
        self._under_way = True
        self._epoch = self._market.epoch
        self._begun_at = now
        self._limit_s = TAKEN_WITHIN_S
        self._scene_id = ""
        self._started_at = self._early_start = None
        return self.visit

    def announced(self, scene_id: str) -> None:
        """Take the id of the scene that the visit under way has led to; later ones are ignored."""
        if self._under_way and not self._scene_id:
            self._scene_id = scene_id
            if self._early_start is not None:
                self.started(*self._early_start)

    def started(self, scene_id: str, now: float) -> None:
        """Take the start of a run; the first one of the visit starts its clock.

        It may be received before the scene that it is for, as that is another topic.
        """
        visit = self.visit
        if visit is None:
            return
        if not self._scene_id:
            self._early_start = scene_id, now
        elif self._is_of_visit(scene_id) and self._started_at is None:
            self._changes = sorted(visit.changes, key=lambda change: change.after_s)
            self._started_at = now

    def due(self, now: float) -> list[SceneChange]:
        """Return the changes whose time has come, each once."""
        if self._started_at is None or not self._under_way:
            return []
        elapsed = (now - self._started_at) * self._pace
        changes = [change for change in self._changes if change.after_s <= elapsed]
        self._changes = self._changes[len(changes) :]
        return changes

    def _is_of_visit(self, scene_id: str) -> bool:
        return bool(self._scene_id) and first_id(scene_id) == self._scene_id


def answer(visit: Visit, question: str) -> str:
    """Return what the person of a visit answers to a question; empty when nothing fits."""
    asked = question.casefold()
    return next((text for word, text in visit.answers.items() if word.casefold() in asked), "")
