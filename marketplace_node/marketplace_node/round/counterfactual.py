# SPDX-License-Identifier: Apache-2.0
"""Smallest change of one scene value that would have made the runner-up of a round win."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneSpace
from marketplace_node.round.decision import Counterfactual
from marketplace_node.round.round_model import RoundModel
from marketplace_node.settings import EXTERNAL
from marketplace_node.strategies import LinearScores
from marketplace_node.strategies.arrays import Floats, Integers

MOST_NUMBERS = 100_000
"""Most numbers in all bids together; with more, the search would take too long."""

_MOST_STEPS = 10
_STEP = 1e-6
_NUDGES = np.array([0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7])

_STRICTLY = 1e-9
"""How much smaller a score must be where a tie loses."""


def smallest_change(
    model: RoundModel, places: Integers, space: SceneSpace
) -> Counterfactual | None:
    """Return the smallest change of one parameter that makes the runner-up win; None without one.

    The result is exact to 1e-7 of the range of the parameter, except for rounding: where scores
    are mathematically equal, the last digit decides. It is verified against all bids. There is
    none where scores are not piecewise linear (``StrategySpec.lines``). ``places`` contains the
    indices of the bids, best first.
    """
    if len(places) < 2 or model.spec.lines is None:
        return None
    if obstacle := _obstacle(model):
        return Counterfactual(obstacle=obstacle)
    try:
        lines = model.lines()
        assert lines is not None, "the strategy has lines"
        return _Search(model, lines, int(places[1]), space).change()
    except Refused as refused:
        return Counterfactual(obstacle=refused.reason)


def _obstacle(model: RoundModel) -> str:
    """Return why a search is impossible; empty when it is possible."""
    if np.isnan(model.field.scene).all():
        return "no value of the scene is known"
    external = model.external
    if model.spec.name == EXTERNAL and external and not external.failure:
        return "nobody knows how the program outside would have ranked another scene"
    if model.field.bids.size > MOST_NUMBERS:
        return "there are too many bids to search for it"
    return ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """Open intervals of one parameter; ``low[k] <= high[k]``."""

    low: Floats
    high: Floats

    def beyond(self, start: float, direction: float) -> float:
        """Return the first value up (1) or down (-1) outside all intervals; may be infinite."""
        low, high = self.low, self.high
        if direction < 0:
            low, high = -high, -low
        at = direction * start
        by_low = np.argsort(low, kind="stable")
        low, reach = low[by_low], np.maximum.accumulate(high[by_low])
        begun = int(np.searchsorted(low, at, side="right"))
        if begun == 0 or reach[begun - 1] <= at:
            return start
        ends = np.append(low[1:] >= reach[:-1], True)
        last = begun - 1 + int(np.argmax(ends[begun - 1 :]))
        return direction * float(reach[last])


class _Search:
    """Visits the ends of the losing intervals of all parameters, nearest first."""

    def __init__(
        self, model: RoundModel, lines: LinearScores, one: int, space: SceneSpace
    ) -> None:
        self._model = model
        self._lines = lines
        self._one = one
        self._space = space
        self._start = model.field.scene
        self._low = np.array([parameter.minimum for parameter in space.parameters])
        self._high = np.array([parameter.maximum for parameter in space.parameters])
        self._width = self._high - self._low
        self._lost: dict[int, Intervals] = {}
        self._queue: list[tuple[float, int, float, float, float]] = []

    def change(self) -> Counterfactual:
        """Return the smallest change, or why none can be found; empty when none exists."""
        if not np.any(self._lines.weights):
            return Counterfactual(obstacle="chance alone ranked, whatever the scene")
        for index in map(int, np.flatnonzero(~np.isnan(self._start))):
            self._lost[index] = self._lost_along(index)
            for direction in (1.0, -1.0):
                self._push(index, direction, float(self._start[index]), _STEP)
        for _ in range(_MOST_STEPS):
            if not self._queue:
                break
            _, parameter, direction, value, step = heapq.heappop(self._queue)
            nudged = value + direction * _NUDGES * self._width[parameter]
            nudged = np.clip(nudged, self._low[parameter], self._high[parameter])
            scenes = np.repeat(self._start[None], len(nudged), axis=0)
            scenes[:, parameter] = nudged
            wins = self._model.winners(scenes) == self._one
            if wins.any():
                found = float(nudged[np.argmax(wins)])
                return Counterfactual(names=(self._space.names[parameter],), values=(found,))
            # Mathematically a tie, decided by rounding: continue in growing steps.
            value += direction * step * self._width[parameter]
            self._push(parameter, direction, value, 2.0 * step)
        return Counterfactual()

    def _push(self, parameter: int, direction: float, start: float, step: float) -> None:
        value = self._lost[parameter].beyond(start, direction)
        if not math.isinf(value):
            size = abs(value - float(self._start[parameter]))
            heapq.heappush(self._queue, (size, parameter, direction, value, step))

    def _lost_along(self, parameter: int) -> Intervals:
        """Return the intervals of a parameter in which the bid loses to any of the K others.

        Its score minus that of another bid is linear between the limits of the parameter and the
        two profiles, so each of the three pieces contains at most one such interval. Values beyond
        the limits always lose.
        """
        turn = np.argsort(self._model.order(np.zeros(self._model.field.shape)))
        others = np.delete(np.arange(len(turn)), self._one)
        loses_ties = turn[self._one] > turn[others]
        limits = float(self._low[parameter]), float(self._high[parameter])
        lines = self._lines
        weights = np.broadcast_to(lines.weights, lines.profiles.shape)
        own_weight, own = weights[self._one, parameter], lines.profiles[self._one, parameter]
        weight, profile = weights[others, parameter], lines.profiles[others, parameter]

        def moved(at: Floats) -> Floats:
            part: Floats = own_weight * np.abs(own - at) - weight[:, None] * np.abs(
                profile[:, None] - at
            )
            return part

        here = moved(np.full((len(others), 1), self._start[parameter]))
        base = self._differences(others)[:, None] - here
        bends = np.clip(np.stack([np.full_like(profile, own), profile], axis=1), *limits)
        bends.sort(axis=1)
        ends = np.full((len(others), 1), 1.0)
        at = np.concatenate([limits[0] * ends, bends, limits[1] * ends], axis=1)
        behind = base + moved(at) + np.where(loses_ties, _STRICTLY, 0.0)[:, None]
        left, right = at[:, :-1], at[:, 1:]
        at_left, at_right = behind[:, :-1], behind[:, 1:]
        rise = np.where(at_right == at_left, 1.0, at_right - at_left)
        root = np.clip(left - at_left * (right - left) / rise, left, right)
        lost_left, lost_right = at_left > 0.0, at_right > 0.0
        # An interval lost at the end of a piece continues beyond it; a root is a tie, which wins.
        low = np.where(lost_left, np.nextafter(left, -math.inf), root)
        high = np.where(lost_right, np.nextafter(right, math.inf), root)
        lost = lost_left | lost_right
        low[:, 0] = np.where(lost_left[:, 0], -math.inf, low[:, 0])
        high[:, -1] = np.where(lost_right[:, -1], math.inf, high[:, -1])
        outside_low = [-math.inf, math.nextafter(limits[1], math.inf)]
        outside_high = [math.nextafter(limits[0], -math.inf), math.inf]
        return Intervals(
            low=np.concatenate([low[lost], outside_low]),
            high=np.concatenate([high[lost], outside_high]),
        )

    def _differences(self, others: Integers) -> Floats:
        """Return the score of the bid minus those of others, [K]; skips missing values."""
        lines, known = self._lines, ~np.isnan(self._start)
        rows = np.append(others, self._one)
        weights = np.broadcast_to(lines.weights, lines.profiles.shape)[rows][:, known]
        parts = weights * np.abs(lines.profiles[rows][:, known] - self._start[known])
        scores = lines.offsets[rows] + parts.sum(axis=-1)
        gap: Floats = scores[-1] - scores[:-1]
        return gap
