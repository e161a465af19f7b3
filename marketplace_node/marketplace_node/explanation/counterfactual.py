# SPDX-License-Identifier: Apache-2.0
"""The smallest change of a scene by which the runner-up of a round would have won it."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from marketplace_node.explanation.piecewise_linear import Intervals, losing_intervals
from marketplace_node.round.decision import Counterfactual
from marketplace_node.round.round_model import RoundModel
from marketplace_node.settings import EXTERNAL, RULES
from marketplace_node.strategies.arrays import Floats, Integers

RIVALS = 12
"""So many of the best bids are looked at first; whoever else gets in the way joins them."""

MOST_WORK = 400_000
"""Bound of the search: parameters times bids times scenes that are scored, and some for each look.

It counts work and not time, so that the same round always has the same outcome.
"""

_LOOK = 2_000  # what scoring costs however little is scored
_TURN = 4_000  # of following the straight lines along one parameter
_RULE = 200  # of asking one rule about one scene
_LEAST_LOOKS = 4  # at all bids, for a search to make sense
_FIRST_LOOK = 100_000
_TRIES = 4
_MOST_STEPS = 100
_STEP = 1e-6
_NUDGES = np.array([0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7])
_GRID = (9, 65)
_FINER = 9
_FINEST = 1e-7
_ROUNDINGS = 6


def smallest_change(
    contest: RoundModel, places: Integers, space: SceneSpace
) -> Counterfactual | None:
    """Return the change of one parameter if one does it, else one of several; None without rivals.

    For scores made of straight lines (``StrategySpec.lines``) the change of one parameter is exact
    to 1e-7 of its range, but for rounding. For others it is searched for on a grid, as fine as
    ``MOST_WORK`` allows. A change of several parameters is one of which no part can be left out;
    it need not be the smallest. Whatever is returned has been tried among all bids: the runner-up
    wins with it.

    Args:
        contest: The round.
        places: Indices of its bids, best first.
        space: The scene parameters.
    """
    if len(places) < 2:
        return None
    try:
        search = _Search(contest, places, space)
        obstacle = search.obstacle()
        found = None if obstacle else search.one() or search.several()
        return found or Counterfactual(obstacle=obstacle or search.nothing_found())
    except _TooMuch:
        return Counterfactual(obstacle="the search for it would have taken too long")
    except Refused as refused:
        return Counterfactual(obstacle=refused.reason)


class _TooMuch(Exception):
    """The search has come to its bound."""


class _Search:
    def __init__(self, contest: RoundModel, places: Integers, space: SceneSpace) -> None:
        self._contest = contest
        self._space = space
        self._winner, self._one = int(places[0]), int(places[1])
        self._turn = np.argsort(contest.order(np.zeros(contest.field.shape)))  # among equals
        self._start = contest.field.scene
        self._low = np.array([parameter.minimum for parameter in space.parameters])
        self._high = np.array([parameter.maximum for parameter in space.parameters])
        self._width = self._high - self._low
        self._known = np.flatnonzero(~np.isnan(self._start))
        self._left = MOST_WORK
        self._rivals = [int(place) for place in places[:RIVALS] if place != self._one]
        self._lost: dict[int, Intervals] = {}
        self._among = contest
        self._one_among = self._one
        self._lines = contest.lines()
        self._look_among()

    def obstacle(self) -> str:
        """Return why there is nothing to search for; empty when there is."""
        if not len(self._known):
            return "no value of the scene is known"
        external = self._contest.external
        if self._contest.spec.name == EXTERNAL and external and not external.failure:
            return "nobody knows how the program outside would have ranked another scene"
        if self._contest.field.bids.size * _LEAST_LOOKS > MOST_WORK:
            return "there are too many bids to search for it"
        return ""

    def nothing_found(self) -> str:
        if self._lines is not None and not np.any(self._lines.weights):
            return "chance alone ranked, whatever the scene"
        return "no change of the scene within its ranges was found"

    def one(self) -> Counterfactual | None:
        """Return the smallest change of one parameter by which the bid wins."""
        found = self._exact() if self._lines is not None else self._searched()
        if found is None:
            return None
        parameter, value = found
        return self._change((parameter,), self._with(parameter, value))

    def several(self) -> Counterfactual | None:
        """Return a change of several parameters of which no part can be left out."""
        goal = self._start.copy()
        goal[self._known] = self._contest.table.vectors[self._one][self._known]
        if not self._wins(goal):
            return None
        best = None
        for turns in self._turns(goal):
            try:
                tried = self._taken_back(goal, turns)
            except _TooMuch:
                if best is None:
                    raise
                break
            if tried is not None and (best is None or self._size(tried) < self._size(best)):
                best = tried
        if best is None:
            return None
        moved = tuple(i for i in map(int, self._known) if best[i] != self._start[i])
        return self._change(moved, best)

    def _exact(self) -> tuple[int, float] | None:
        """Look at the nearest place beyond what is lost to the best rivals, then ask all."""
        queue: list[tuple[float, int, float, float, float]] = []
        for index in map(int, self._known):
            for side in (1.0, -1.0):
                self._push(queue, index, side, float(self._start[index]), _STEP)
        for _ in range(_MOST_STEPS):
            if not queue:
                return None
            _, parameter, direction, value, step = heapq.heappop(queue)
            nudged = value + direction * _NUDGES * self._width[parameter]
            nudged = np.clip(nudged, self._low[parameter], self._high[parameter])
            wins = self._wins_among(self._along(self._start, parameter, nudged))
            new = False
            if wins.any():
                found = float(nudged[np.argmax(wins)])
                winner = self._best(self._with(parameter, found))
                if winner == self._one:
                    return parameter, found
                new = self._add_rival(winner)
            if not new:
                # Equal on paper, and rounding decides: further on, in strides that grow.
                value += direction * step * self._width[parameter]
                step *= 2.0
            self._push(queue, parameter, direction, value, step)
        return None

    def _push(
        self,
        queue: list[tuple[float, int, float, float, float]],
        parameter: int,
        direction: float,
        start: float,
        step: float,
    ) -> None:
        value = self._lost_along(parameter).beyond(start, direction)
        if not math.isinf(value):
            size = abs(value - float(self._start[parameter]))
            heapq.heappush(queue, (size, parameter, direction, value, step))

    def _lost_along(self, parameter: int) -> Intervals:
        """Return where along a parameter the bid is behind one of its rivals."""
        assert self._lines is not None, "only straight lines are followed"
        if parameter not in self._lost:
            self._spend(_TURN)
            others = np.array(self._rivals)
            behind = self._turn[self._one] > self._turn[others]
            limits = (float(self._low[parameter]), float(self._high[parameter]))
            self._lost[parameter] = losing_intervals(
                self._lines, self._start, parameter, limits, self._one, others, behind
            )
        return self._lost[parameter]

    def _searched(self) -> tuple[int, float] | None:
        """Look along a grid of each parameter among the best rivals, then ask all."""
        for _ in range(_TRIES):
            found = self._on_grid()
            if found is None:
                return None
            winner = self._best(self._with(*found))
            if winner == self._one:
                return found
            if not self._add_rival(winner):
                return None
        return None

    def _on_grid(self) -> tuple[int, float] | None:
        """Look along all parameters at once, then finer where it may be the nearest."""
        known = self._known
        parameters = np.concatenate([known, known])
        far = np.concatenate([self._high[known], self._low[known]])
        near = self._start[parameters]
        cells = len(parameters) * self._among.field.bids.size
        points = int(np.clip(_FIRST_LOOK // cells, *_GRID))
        while len(parameters):
            at = near[:, None] + (far - near)[:, None] * np.linspace(0.0, 1.0, points)
            at[:, -1] = far
            scenes = np.repeat(self._start[None], at.size, axis=0)
            scenes[np.arange(at.size), np.repeat(parameters, points)] = at.ravel()
            wins = self._wins_among(scenes).reshape(at.shape)
            some = wins.any(axis=1)
            if not some.any():
                return None
            parameters, at, first = parameters[some], at[some], wins[some].argmax(axis=1)
            rows = np.arange(len(parameters))
            near, far = at[rows, np.maximum(first - 1, 0)], at[rows, first]
            sizes = np.abs(far - self._start[parameters])
            best = int(sizes.argmin())
            gap = abs(far[best] - near[best])
            if gap <= _FINEST * self._width[parameters[best]]:
                return int(parameters[best]), float(far[best])
            hopeful = np.abs(near - self._start[parameters]) < sizes[best]
            parameters, near, far = parameters[hopeful], near[hopeful], far[hopeful]
            points = _FINER
        return None

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

    def _taken_back(self, goal: Floats, turns: Sequence[int]) -> Floats | None:
        """Take back what is not needed to win among the rivals, then ask all."""
        for _ in range(_TRIES):
            scene = goal
            for parameter in turns:
                scene = self._with(parameter, self._needed(scene, parameter), scene)
            winner = self._best(scene)
            if winner == self._one:
                return scene
            if not self._add_rival(winner):
                return None
        return None

    def _needed(self, scene: Floats, parameter: int) -> float:
        """Return the value nearest to the scene of the round that is needed to win."""
        near, far = float(self._start[parameter]), float(scene[parameter])
        fine = _FINEST * float(self._width[parameter])
        while abs(far - near) > fine:
            at = np.append(np.linspace(near, far, _FINER), far)
            at[-2] = far - math.copysign(fine, far - near)
            wins = self._wins_among(self._along(scene, parameter, at))
            first = int(np.argmax(wins))
            if first == len(at) - 1 or not wins.any():
                return far
            if first == 0:
                return near
            near, far = float(at[first - 1]), float(at[first])
        return far

    def _change(self, moved: tuple[int, ...], scene: Floats) -> Counterfactual:
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
        shown = scene
        try:
            for row in np.flatnonzero(self._wins_among(tried)):
                if self._wins(tried[row]):
                    shown = tried[row]
                    break
        except _TooMuch:
            shown = scene
        return Counterfactual(
            names=names, values=values, shown=tuple(float(shown[index]) for index in moved)
        )

    def _with(self, parameter: int, value: float, scene: Floats | None = None) -> Floats:
        changed = (self._start if scene is None else scene).copy()
        changed[parameter] = value
        return changed

    @staticmethod
    def _along(scene: Floats, parameter: int, values: Floats) -> Floats:
        """Return a scene for each value of a parameter."""
        scenes = np.repeat(scene[None], len(values), axis=0)
        scenes[:, parameter] = values
        return scenes

    def _size(self, scene: Floats) -> float:
        return float(np.abs((scene - self._start)[self._known]).sum())

    def _add_rival(self, place: int) -> bool:
        """Look at one more bid from now on; return False when it is one already."""
        if place in self._rivals:
            return False
        self._rivals.append(place)
        self._lost = {}
        self._look_among()
        return True

    def _look_among(self) -> None:
        rows = sorted([*self._rivals, self._one])
        if not self._contest.spec.draws and len(rows) < len(self._contest.table):
            self._among = self._contest.among(rows)
            self._one_among = rows.index(self._one)

    def _wins(self, scene: Floats) -> bool:
        return self._best(scene) == self._one

    def _best(self, scene: Floats) -> int:
        """Return who wins among all bids."""
        return int(self._scored(self._contest, scene[None])[0])

    def _wins_among(self, scenes: Floats) -> npt.NDArray[np.bool_]:
        """Return whether the bid wins among its rivals."""
        wins: npt.NDArray[np.bool_] = self._scored(self._among, scenes) == self._one_among
        return wins

    def _scored(self, contest: RoundModel, scenes: Floats) -> Integers:
        self._spend(_LOOK + len(scenes) * contest.field.bids.size)
        if contest.spec.name == RULES:
            self._spend(len(scenes) * len(contest.terms.rules) * _RULE)
        return contest.winners(scenes)

    def _spend(self, work: int) -> None:
        if work > self._left:
            raise _TooMuch
        self._left -= work
