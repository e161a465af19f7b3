# SPDX-License-Identifier: Apache-2.0
"""The mood of the person during one run, against the mood at its start."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bt_agents.scene import MISSING, Scene, SceneSpace


@dataclass(frozen=True, kw_only=True)
class Mood:
    """Start and present of the mood, in the unit of its scene parameter; NaN when unknown.

    Attributes:
        start: Mood of the scene as awarded; when that is missing, the first known live mood.
        now: Mood of the latest live scene.
    """

    start: float = MISSING
    now: float = MISSING

    @property
    def change(self) -> float:
        """Mood now minus mood at the start; NaN when either is unknown."""
        return self.now - self.start


def at_start(awarded: Scene, space: SceneSpace) -> Mood:
    """Return the mood of a run that has just begun."""
    return Mood(start=_of(awarded, space))


def seen(mood: Mood, live: Scene, space: SceneSpace) -> Mood:
    """Return the mood after one more live scene; without a person it is unknown."""
    now = _of(live, space)
    return replace(mood, start=now if math.isnan(mood.start) else mood.start, now=now)


def _of(scene: Scene, space: SceneSpace) -> float:
    return scene.get(space.mood) if space.mood is not None and scene.person else MISSING
