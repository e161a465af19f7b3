# SPDX-License-Identifier: Apache-2.0
"""The mood of the person during one run, against the mood at its start."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from bt_agents_core.scene import MISSING, Scene, SceneSpace, SceneValue


def mood_of(scene: Scene, space: SceneSpace, *, confidence: float = 0.0) -> float:
    """Return the mood of the person in a scene, NaN when it is not known.

    It is known of a person who is there, when it was measured or given, with enough confidence: a
    person who is lost is not unhappy, and neither is one whose mood is only assumed.

    Args:
        scene: The scene.
        space: Says which parameter is the mood.
        confidence: The least that counts, 0..1.
    """
    if space.mood is None or not scene.person:
        return MISSING
    value = scene.values[space.names.index(space.mood)]
    return value.value if value.observed and value.confidence >= confidence else MISSING


class Addressee:
    """The person whom a run is about; live scenes about somebody else say that nobody is there.

    Args:
        awarded: Scene as awarded; when it does not say who it is, the first live one does.
    """

    def __init__(self, awarded: Scene) -> None:
        self._person_id = awarded.person_id

    def seen(self, live: Scene) -> Scene:
        """Return a live scene, without the person when it is somebody else."""
        self._person_id = self._person_id or live.person_id
        if not live.person_id or live.person_id == self._person_id:
            return live
        nothing = tuple(SceneValue.missing(value.name) for value in live.values)
        return replace(live, person=False, values=nothing)


class Mood:
    """The mood of one run against that at its start, in the unit of its scene parameter.

    Attributes:
        start: Mood of the scene as awarded; when that is not known, the first live one that is.
            With a baseline the mean over its time, NaN until then.
        now: Mood of the latest live scene; NaN when it is not known.

    Args:
        awarded: Scene as awarded.
        space: The scene parameters.
        clock: Steady time [s].
        baseline_s: Length of the baseline, from the first known mood on [s]; 0 for none.
        confidence: Moods with less are not known, 0..1.
    """

    def __init__(
        self,
        awarded: Scene,
        space: SceneSpace,
        clock: Callable[[], float],
        *,
        baseline_s: float = 0.0,
        confidence: float = 0.0,
    ) -> None:
        self.start = MISSING
        self.now = MISSING
        self._space = space
        self._clock = clock
        self._baseline_s = baseline_s
        self._confidence = confidence
        self._until = math.inf
        self._counted_to = 0.0
        self._sum = 0.0
        self._seconds = 0.0
        if not baseline_s:
            self.start = mood_of(awarded, space, confidence=confidence)

    @property
    def change(self) -> float:
        """Mood now minus mood at the start; NaN when either is unknown."""
        return self.now - self.start

    @property
    def due(self) -> float:
        """When the baseline is complete [s]; infinite when it is, or has not begun."""
        return self._until

    def see(self, live: Scene) -> None:
        """Take a live scene."""
        self.tick()
        self.now = mood_of(live, self._space, confidence=self._confidence)
        if math.isnan(self.now) or not math.isnan(self.start):
            return
        if not self._baseline_s:
            self.start = self.now
        elif self._until == math.inf:
            self._counted_to = self._clock()
            self._until = self._counted_to + self._baseline_s

    def tick(self) -> None:
        """Let time pass: the mood has been the same since the last scene."""
        if self._until == math.inf:
            return
        now = self._clock()
        end = min(now, self._until)
        if not math.isnan(self.now):
            self._sum += self.now * (end - self._counted_to)
            self._seconds += end - self._counted_to
        self._counted_to = end
        if now < self._until:
            return
        if self._seconds:
            self.start = self._sum / self._seconds
        self._until = math.inf

    def forget(self) -> None:
        """Let the mood be unknown: nothing has been heard for too long."""
        self.now = MISSING
