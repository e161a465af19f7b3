# SPDX-License-Identifier: Apache-2.0
"""Delivers announced scenes to a market that may be absent, or die while it takes them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from bt_agents_core.scene import Scene

MOST_KEPT = 10
"""Most scenes that wait for a market; beyond it, the oldest is dropped."""

KEPT_S = 60.0
"""How long a scene waits for a market [s]; later the person will be gone."""

LEASE_S = 1.0
"""Silence after which a market counts as absent [s]."""

_TAKEN_S = 1.0
_MOST_UNSURE = 1000


@dataclass(eq=False, kw_only=True)
class _Undelivered:
    """Scene that a market may not have taken yet.

    Attributes:
        announced_at: Steady time of the announcement [s].
        epoch: Market that it was sent to; empty before.
        sent_at: Steady time of the last sending [s].
        sends: How many more times to send it to this market, unless the market shows it.
    """

    scene: Scene
    announced_at: float
    epoch: str = ""
    sent_at: float = 0.0
    sends: int = 0


class SceneDelivery:
    """Scenes to deliver to the market, each until it is certain that a market has taken it.

    A market has taken a scene if it shows the scene, or if it is still alive a second after the
    scene was sent. It refuses a scene that it already has, so resending one does no harm.

    Attributes:
        epoch: Epoch in the market's last heartbeat; empty before the first.
    """

    def __init__(self) -> None:
        self.epoch = ""
        self._scenes: list[_Undelivered] = []
        self._heard_at = -LEASE_S

    @property
    def pending(self) -> bool:
        """Whether there are scenes to deliver."""
        return bool(self._scenes)

    def market_there(self, now: float) -> bool:
        """Return whether a market has recently sent a heartbeat."""
        return bool(self.epoch) and now - self._heard_at < LEASE_S

    def announce(self, scene: Scene, now: float, *, listens: bool) -> bool:
        """Add a scene that is being published; return whether it is kept for a later market.

        Args:
            scene: The scene.
            now: Steady time [s].
            listens: Whether a market is matched.
        """
        one = _Undelivered(scene=scene, announced_at=now)
        sent = listens and self.market_there(now)
        if sent:
            one.epoch, one.sent_at = self.epoch, now
        self._scenes = [*self._scenes[-_MOST_UNSURE:], one]
        return not sent

    def heartbeat(self, epoch: str, now: float) -> None:
        """Handle the heartbeat of a market."""
        self.epoch, self._heard_at = epoch, now
        self._scenes = [one for one in self._scenes if not self._is_taken(one)]

    def shown(self, names: Collection[str]) -> None:
        """Handle the scenes that a market shows to have: ids, or labels."""
        self._scenes = [one for one in self._scenes if not self._is_shown(one, names)]

    def due(self, now: float, *, listens: bool) -> list[Scene]:
        """Return the scenes to send to the market now."""
        if not (listens and self.market_there(now)):
            return []
        due = []
        for one in self._scenes:
            if one.epoch != self.epoch:
                # A message to a market that is just starting may be lost, so it is sent twice.
                one.epoch, one.sends = self.epoch, 2
            elif now - one.sent_at < _TAKEN_S:
                continue
            if one.sends:
                one.sends -= 1
                one.sent_at = now
                due.append(one.scene)
        return due

    def given_up(self, now: float) -> list[Scene]:
        """Return the scenes that stop waiting for a market: too many, or too old."""
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
        sent = one.epoch == self.epoch and not one.sends
        return sent and self._heard_at - one.sent_at >= _TAKEN_S

    def _is_shown(self, one: _Undelivered, names: Collection[str]) -> bool:
        sent = bool(one.scene.label) and one.epoch == self.epoch
        return one.scene.scene_id in names or (sent and one.scene.label in names)
