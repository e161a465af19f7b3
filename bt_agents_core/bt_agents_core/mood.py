# SPDX-License-Identifier: Apache-2.0
"""Change of the mood during one run, relative to its start or to a baseline."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from bt_agents_core.scene import MISSING, Origin, Scene, SceneSpace, SceneValue, mood_of


class Addressee:
    """Person whom a run is about: the first one named; scenes about others count as empty."""

    def __init__(self, awarded: Scene) -> None:
        self._person_id = awarded.person_id

    def mask(self, live: Scene) -> Scene:
        """Return a live scene, without its person if that is somebody else."""
        self._person_id = self._person_id or live.person_id
        if not live.person_id or live.person_id == self._person_id:
            return live
        nothing = tuple(SceneValue.missing(value.name) for value in live.values)
        return replace(live, person=False, values=nothing)


class MoodStart:
    """Mood that the changes in a run start from.

    It is the mood of the scene as awarded. A given mood may be wrong, and a camera that measures
    another one has seen no change: the first measured mood replaces a given one.

    Attributes:
        value: The mood; NaN if unknown.
    """

    def __init__(self, awarded: Scene, space: SceneSpace, confidence: float = 0.0) -> None:
        self.value = mood_of(awarded, space, confidence=confidence)
        self._space = space
        self._confidence = confidence
        self.is_given = self._origin(awarded) is Origin.GIVEN and not math.isnan(self.value)

    def follow(self, live: Scene) -> None:
        """Take a live scene as long as the mood is only given."""
        if self.is_given and self._origin(live) is Origin.MEASURED:
            measured = mood_of(live, self._space, confidence=self._confidence)
            if not math.isnan(measured):
                self.value, self.is_given = measured, False

    def _origin(self, scene: Scene) -> Origin:
        if self._space.mood is None:
            return Origin.MISSING
        return scene.values[self._space.names.index(self._space.mood)].origin


class Mood:
    """Mood in one run and its change since the start, in the unit of the scene parameter.

    Attributes:
        start: Mood of the scene as awarded, see :class:`MoodStart`; if that is unknown, the first
            known mood of a live scene. With a baseline, the mean over its time, NaN until then.
        now: Mood of the latest live scene; NaN if unknown.

    Args:
        clock: Steady time [s].
        baseline_s: Length of the baseline from the first known mood on [s]; 0 for none.
        confidence: Moods with less confidence count as unknown, 0..1.
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
        self._first = MoodStart(awarded, space, confidence)
        if not baseline_s:
            self.start = self._first.value

    @property
    def change(self) -> float:
        """Mood now minus mood at the start; NaN if either is unknown."""
        return self.now - self.start

    @property
    def due(self) -> float:
        """When the baseline will be complete [s]; infinite if it is complete or has not begun."""
        return self._until

    def receive(self, live: Scene) -> None:
        """Take a live scene."""
        self.tick()
        self.now = mood_of(live, self._space, confidence=self._confidence)
        if self._first.is_given and not self._baseline_s:
            self._first.follow(live)
            self.start = self._first.value
        if math.isnan(self.now) or not math.isnan(self.start):
            return
        if not self._baseline_s:
            self.start = self.now
        elif self._until == math.inf:
            self._counted_to = self._clock()
            self._until = self._counted_to + self._baseline_s

    def tick(self) -> None:
        """Advance the time; the mood has been constant since the last scene."""
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
        """Mark the mood as unknown, because the live scene has become stale."""
        self.now = MISSING
