# SPDX-License-Identifier: Apache-2.0
"""Delivery of announced scenes to a market that may be away, or die while it takes them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from bt_agents_core.scene import Scene

MOST_KEPT = 10
"""As many scenes wait for a market; one more pushes the oldest out."""

KEPT_S = 60.0
"""A scene waits for a market for so long [s]; by then the person is gone."""

LEASE_S = 1.0
"""A market without a heartbeat for so long is away [s]."""

_TAKEN_S = 1.0
_MOST_UNSURE = 1000


@dataclass(eq=False, kw_only=True)
class _Undelivered:
    """Scene of which it is not sure yet that a market has taken it.

    Attributes:
        announced_at: Steady time [s].
        epoch: Market that it was sent to; empty before.
        sent_at: When that was, steady time [s].
        sends: How often it is still to be sent to this market unless it shows that it has it.
    """

    scene: Scene
    announced_at: float
    epoch: str = ""
    sent_at: float = 0.0
    sends: int = 0


class SceneDelivery:
    """Scenes that are to reach the market, each until it is sure that one has taken it.

    A market has taken a scene when it shows it, and when it is still alive a second after the
    scene was sent. It refuses a scene that it has already, so sending one again does no harm.
    """

    def __init__(self) -> None:
        self._scenes: list[_Undelivered] = []
        self._epoch = ""
        self._heard_at = -LEASE_S

    @property
    def pending(self) -> bool:
        """Whether there is something to deliver."""
        return bool(self._scenes)

    def market_there(self, now: float) -> bool:
        """Return whether a market has had a heartbeat of late."""
        return bool(self._epoch) and now - self._heard_at < LEASE_S

    def announce(self, scene: Scene, now: float, *, listens: bool) -> bool:
        """Take a scene that is being published; return whether it is kept for a later market.

        Args:
            scene: The scene.
            now: Steady time [s].
            listens: Whether a market is matched.
        """
        one = _Undelivered(scene=scene, announced_at=now)
        sent = listens and self.market_there(now)
        if sent:
            one.epoch, one.sent_at = self._epoch, now
        self._scenes = [*self._scenes[-_MOST_UNSURE:], one]
        return not sent

    def heartbeat(self, epoch: str, now: float) -> None:
        """Take the heartbeat of a market."""
        self._epoch, self._heard_at = epoch, now
        self._scenes = [one for one in self._scenes if not self._is_taken(one)]

    def shown(self, names: Collection[str]) -> None:
        """Take what a market shows to have: ids of scenes, or their labels."""
        self._scenes = [one for one in self._scenes if not self._is_shown(one, names)]

    def due(self, now: float, *, listens: bool) -> list[Scene]:
        """Return the scenes to send to the market now."""
        if not (listens and self.market_there(now)):
            return []
        due = []
        for one in self._scenes:
            if one.epoch != self._epoch:
                # What a market that is just starting is sent may be lost, so it is sent twice.
                one.epoch, one.sends = self._epoch, 2
            elif now - one.sent_at < _TAKEN_S:
                continue
            if one.sends:
                one.sends -= 1
                one.sent_at = now
                due.append(one.scene)
        return due

    def given_up(self, now: float) -> list[Scene]:
        """Return the scenes that wait no longer for a market, as they are too many or too old."""
        if self.market_there(now):
            return []
        room = len(self._scenes) - MOST_KEPT
        given_up = [
            one
            for place, one in enumerate(self._scenes)
            if place < room or now - one.announced_at >= KEPT_S
        ]
        self._scenes = [one for one in self._scenes if one not in given_up]
        return [one.scene for one in given_up]

    def _is_taken(self, one: _Undelivered) -> bool:
        sent = one.epoch == self._epoch and not one.sends
        return sent and self._heard_at - one.sent_at >= _TAKEN_S

    def _is_shown(self, one: _Undelivered, names: Collection[str]) -> bool:
        sent = bool(one.scene.label) and one.epoch == self._epoch
        return one.scene.scene_id in names or (sent and one.scene.label in names)
