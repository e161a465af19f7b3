# SPDX-License-Identifier: Apache-2.0
"""The smallest change of a scene by which the runner-up of a round would have won it."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from bt_agents.errors import Refused
from bt_agents.scene import SceneSpace
from marketplace_node.contest import Contest
from marketplace_node.decision import Change
from marketplace_node.lines import losing
from marketplace_node.strategies import Lines, chance
from marketplace_node.strategies.field import Floats, Integers

RIVALS = 32
"""So many of the best bids are looked at first; whoever else gets in the way joins them."""

MOST_STEPS = 200
MOST_CELLS = 2_000_000
"""Bounds of the search: steps, and scenes times bids times parameters that are scored."""

_CELLS_AT_ONCE = 500_000  # bounds the memory
_NUDGES = np.array([0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7])
_GRID = 129
_FINER = 17
_ROUNDINGS = 6


def smallest_change(contest: Contest, places: Integers, space: SceneSpace) -> Change | None:
    """Return the change of one parameter if one does it, else one of several; None without rivals.

    For scores made of straight lines (``StrategySpec.lines``) the change of one parameter is exact
    to 1e-7 of its range. For others it is searched for on a grid, as fine as the number of bids
    allows. A change of several parameters is one of which no part can be left out; it need not be
    the smallest. Whatever is returned has been tried: the runner-up wins with it.

    Args:
        contest: The round.
        places: Indices of its bids, best first.
        space: The scene parameters.
    """
    if len(places) < 2:
        return None
    search = _Search(contest, places, space)
    obstacle = search.obstacle()
    if obstacle:
        return Change(obstacle=obstacle)
    try:
        found = search.one() or search.several()
    except Refused as refused:
        return Change(obstacle=refused.reason)
    return found or Change(obstacle=search.nothing_found())


class _Search:
    def __init__(self, contest: Contest, places: Integers, space: SceneSpace) -> None:
        self._contest = contest
        self._space = space
        self._winner, self._one = int(places[0]), int(places[1])
        self._places = places
        self._turn = np.argsort(contest.order(np.zeros(contest.field.shape)))  # among equals
        self._start = contest.field.scene
        self._low = np.array([parameter.minimum for parameter in space.parameters])
        self._high = np.array([parameter.maximum for parameter in space.parameters])
        self._width = self._high - self._low
        self._known = np.flatnonzero(~np.isnan(self._start))
        self._lines: Lines | None = None
        if contest.spec.lines is not None:
            options = contest.spec.values(contest.options)
            self._lines = contest.spec.lines(contest.field, options, chance(contest.seed))
        cells = max(1, contest.field.bids.size)
        self._affordable = min(_GRID, MOST_CELLS // (cells * max(1, len(self._known))))

    def obstacle(self) -> str:
        """Return why there is nothing to search for; empty when there is."""
        if not len(self._known):
            return "no value of the scene is known"
        external = self._contest.external
        if self._contest.spec.name == "external" and external and not external.failure:
            return "nobody knows how the program outside would have ranked another scene"
        if self._lines is None and self._affordable < _FINER:
            return "there are too many bids to search for it"
        return ""

    def nothing_found(self) -> str:
        if self._lines is not None and not np.any(self._lines.weights):
            return "chance alone ranked, whatever the scene"
        return "no change of the scene within its ranges was found"

    def one(self) -> Change | None:
        """Return the smallest change of one parameter by which the bid wins."""
        found = self._exact() if self._lines is not None else self._searched()
        if found is None:
            return None
        parameter, value = found
        return self._change((parameter,), self._with({parameter: value}))

    def several(self) -> Change | None:
        """Return a change of several parameters of which no part can be left out."""
        if self._contest.field.bids.size * _GRID > MOST_CELLS:
            return None
        goal = self._start.copy()
        goal[self._known] = self._contest.table.vectors[self._one][self._known]
        if not self._wins(goal[None])[0]:
            return None
        best = goal
        for turns in self._turns(goal):
            tried = self._taken_back(goal, turns)
            if self._size(tried) < self._size(best):
                best = tried
        moved = tuple(i for i in map(int, self._known) if best[i] != self._start[i])
        return self._change(moved, best)

    def _exact(self) -> tuple[int, float] | None:
        """Look at the nearest place beyond what is lost to the best rivals, then ask all."""
        rivals = [int(place) for place in self._places[:RIVALS] if place != self._one]
        queue: list[tuple[float, int, float, float]] = []
        for index in map(int, self._known):
            for side in (1.0, -1.0):
                self._push(queue, rivals, index, side, float(self._start[index]))
        for _ in range(MOST_STEPS):
            if not queue:
                return None
            _, parameter, direction, value = heapq.heappop(queue)
            nudged = value + direction * _NUDGES * self._width[parameter]
            nudged = np.clip(nudged, self._low[parameter], self._high[parameter])
            scenes = np.repeat(self._start[None], len(nudged), axis=0)
            scenes[:, parameter] = nudged
            winners = self._winners(scenes)
            if (winners == self._one).any():
                return parameter, float(nudged[np.argmax(winners == self._one)])
            new = [int(w) for w in np.unique(winners) if int(w) not in rivals]
            rivals += new
            further = value if new else value + direction * 1e-6 * self._width[parameter]
            self._push(queue, rivals, parameter, direction, further)
        return None

    def _push(
        self,
        queue: list[tuple[float, int, float, float]],
        rivals: Sequence[int],
        parameter: int,
        direction: float,
        start: float,
    ) -> None:
        assert self._lines is not None, "only straight lines are followed"
        others = np.array(rivals)
        behind = self._turn[self._one] > self._turn[others]
        limits = (float(self._low[parameter]), float(self._high[parameter]))
        lost = losing(self._lines, self._start, parameter, limits, self._one, others, behind)
        value = lost.beyond(start, direction)
        if not math.isinf(value):
            size = abs(value - float(self._start[parameter]))
            heapq.heappush(queue, (size, parameter, direction, value))

    def _searched(self) -> tuple[int, float] | None:
        """Look along a grid of each parameter, then finer between the last two points."""
        best: tuple[float, int, float] | None = None
        for parameter in map(int, self._known):
            for end in (self._high[parameter], self._low[parameter]):
                value = self._first(self._start, parameter, float(end), self._affordable)
                if value is None:
                    continue
                size = abs(value - float(self._start[parameter]))
                if best is None or size < best[0]:
                    best = size, parameter, value
        return None if best is None else best[1:]

    def _first(self, scene: Floats, parameter: int, end: float, points: int) -> float | None:
        """Return where the bid first wins on the way to ``end``; None when it does nowhere."""
        near, far = float(scene[parameter]), end
        for count in (points, *[_FINER] * 6):
            values = np.linspace(near, far, count)
            scenes = np.repeat(scene[None], count, axis=0)
            scenes[:, parameter] = values
            wins = self._wins(scenes)
            if not wins.any():
                return None
            first = int(np.argmax(wins))
            if first == 0:
                return near
            near, far = float(values[first - 1]), float(values[first])
        return far

    def _turns(self, goal: Floats) -> Iterator[tuple[int, ...]]:
        """Yield orders in which to take parameters back, the one that helps least first."""
        moved = [i for i in map(int, self._known) if goal[i] != self._start[i]]
        vectors = self._contest.table.vectors
        help_of = {}
        for index in moved:
            rival, here, there = vectors[self._winner, index], self._start[index], goal[index]
            own = vectors[self._one, index]
            gain = (abs(own - here) - abs(rival - here)) - (abs(own - there) - abs(rival - there))
            help_of[index] = gain / abs(there - here)
        by_help = sorted(moved, key=help_of.__getitem__)
        for shift in range(min(len(moved), 4)):
            yield tuple(by_help[shift:] + by_help[:shift])

    def _taken_back(self, goal: Floats, turns: Sequence[int]) -> Floats:
        scene = goal
        for parameter in turns:
            toward = scene.copy()
            toward[parameter] = self._start[parameter]
            value = self._first(toward, parameter, float(scene[parameter]), _FINER)
            if value is not None:
                scene = toward
                scene[parameter] = value
        return scene

    def _change(self, moved: tuple[int, ...], scene: Floats) -> Change:
        names = tuple(self._space.names[index] for index in moved)
        values = tuple(float(scene[index]) for index in moved)
        tried = np.repeat(scene[None], 2 * _ROUNDINGS, axis=0)
        for index in moved:
            coarse = math.floor(math.log10(self._width[index])) - 2.0
            steps = np.repeat(10.0 ** (coarse - np.arange(_ROUNDINGS)), 2)
            side = math.copysign(1.0, scene[index] - self._start[index])
            rounded = side * np.ceil(np.round(side * scene[index] / steps, 6))
            rounded[1::2] += side  # one step further, where an equal score loses
            nice = np.round(rounded * steps, 12)
            tried[:, index] = np.clip(nice, self._low[index], self._high[index])
        wins = self._wins(tried)
        shown = tried[np.argmax(wins)] if wins.any() else scene
        return Change(
            names=names, values=values, shown=tuple(float(shown[index]) for index in moved)
        )

    def _with(self, values: dict[int, float]) -> Floats:
        scene = self._start.copy()
        for index, value in values.items():
            scene[index] = value
        return scene

    def _size(self, scene: Floats) -> float:
        return float(np.abs((scene - self._start)[self._known]).sum())

    def _wins(self, scenes: Floats) -> npt.NDArray[np.bool_]:
        wins: npt.NDArray[np.bool_] = self._winners(scenes) == self._one
        return wins

    def _winners(self, scenes: Floats) -> Integers:
        """Return who wins in each scene; those after the first that the bid wins may be absent."""
        at_once = max(1, _CELLS_AT_ONCE // self._contest.field.bids.size)
        parts = []
        for start in range(0, len(scenes), at_once):
            parts.append(self._contest.winners(scenes[start : start + at_once]))
            if (parts[-1] == self._one).any():
                break
        return np.concatenate(parts)
