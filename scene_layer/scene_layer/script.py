# SPDX-License-Identifier: Apache-2.0
"""State machine of a scripted play: the next visit, its end and its timed changes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from bt_agents_core.scene import first_id
from bt_agents_core.text import folded
from bt_agents_language.model.specs import SceneChange, Script, Visit

TAKEN_WITHIN_S = 5.0
"""Idle time of the market after which a sent scene counts as not received [s]."""

AGAIN_WITHIN_S = 10.0
"""Idle time after which a restarted market will no longer ask for the scene again [s]."""


@dataclass(frozen=True, kw_only=True)
class MarketView:
    """State of the market that a play needs; the fields are as in ``MarketStatus.msg``."""

    epoch: str
    idle: bool
    agents: int
    finished_scene_id: str

    @classmethod
    def of(cls, message: Any) -> MarketView:
        """Return the state in a ``MarketStatus.msg``."""
        return cls(
            epoch=message.epoch,
            idle=message.state == message.IDLE and not message.queued,
            agents=message.agents,
            finished_scene_id=message.finished_scene_id,
        )


class ScriptPerformance:
    """Plays the visits of a script in order, each until the market has finished it.

    A visit continues if a restarted market resumes its run. It restarts if the restarted market
    does not know it, or if its scene was not taken. So a play never hangs, skips a visit or serves
    a visitor twice.

    Args:
        wait_for_agents: Number of agents that the market must have before a visit begins.
        pace: Speed of the visits relative to real time.

    Example:
        The owner reports events and asks for actions: ``market`` and ``over`` at every status,
        ``next`` between visits, ``announced`` with the id of the visit's scene, ``started`` and
        ``due`` during its run.

    Attributes:
        unmade: Changes of the current or last visit that have not been due yet.
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
        self.unmade: tuple[SceneChange, ...] = ()
        self._under_way = False

    @property
    def done(self) -> bool:
        """True when all visits are over."""
        return self._index >= len(self._script.visits)

    @property
    def number(self) -> int:
        """Number of the current or next visit, from 1."""
        return self._index + 1

    @property
    def visit(self) -> Visit | None:
        """The current visit."""
        return self._script.visits[self._index] if self._under_way else None

    @property
    def has_started(self) -> bool:
        """True once a run of the current or last visit has started."""
        return self._started_at is not None

    def market(self, market: MarketView, now: float) -> None:
        """Handle the latest status of the market at steady time ``now`` [s]."""
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
        """Return True, once, when the current visit is over."""
        if not self._under_way or self._market is None:
            return False
        if self._is_of_visit(self._market.finished_scene_id):
            self._under_way = False
            self._index += 1
        return not self._under_way

    def not_taken(self, now: float) -> bool:
        """Return True, once, when the market has not taken the scene of the visit."""
        if not self._under_way or self._market is None or not self._market.idle:
            return False
        self._under_way = now - max(self._idle_since, self._begun_at) <= self._limit_s
        return not self._under_way

    def next(self, now: float) -> Visit | None:
        """Begin and return the next visit if the market is ready for it, else return None."""
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
        self.unmade = self._script.visits[self._index].changes
        return self.visit

    def announced(self, scene_id: str) -> None:
        """Set the id of the current visit's scene; later ids are ignored."""
        if self._under_way and not self._scene_id:
            self._scene_id = scene_id
            if self._early_start is not None:
                self.started(*self._early_start)

    def started(self, scene_id: str, now: float) -> None:
        """Handle the start of a run; the first run of a visit starts its clock.

        It may arrive before its scene, which is published on another topic.
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
        """Return the changes that are due, each once."""
        if self._started_at is None or not self._under_way:
            return []
        elapsed = (now - self._started_at) * self._pace
        changes = [change for change in self._changes if change.after_s <= elapsed]
        self._changes = self._changes[len(changes) :]
        self.unmade = tuple(one for one in self.unmade if one not in changes)
        return changes

    def _is_of_visit(self, scene_id: str) -> bool:
        return bool(self._scene_id) and first_id(scene_id) == self._scene_id


def answer(visit: Visit, question: str) -> str:
    """Return the answer of a visit's person to a question; empty if none matches."""
    asked = folded(question)
    return next((text for word, text in visit.answers.items() if folded(word) in asked), "")
