# SPDX-License-Identifier: Apache-2.0
"""Scene map: who would win where, over two parameters around one scene, without asking anybody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_agents_core.errors import Refused
from bt_agents_studio.records import SceneMapRecord
from marketplace_node.strategies import STRATEGIES, RoundArrays, manhattan, order

FINEST = 41
"""Places along each side of a computed map, at most."""

COARSEST = 5
"""The same, at least, where many agents bid."""

ASKED = 7
"""Places along each side of a map for which the market is asked at each place."""

_MOST_NUMBERS = 10_000_000


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Scene parameter along one side of a map."""

    name: str
    minimum: float
    maximum: float

    def places(self, count: int) -> tuple[float, ...]:
        """Return evenly spaced values, both ends included."""
        return tuple(float(one) for one in np.linspace(self.minimum, self.maximum, count))


_DISTANCES = frozenset({"manhattan", "weighted_manhattan", "euclidean"})
"""Strategies whose score is the distance alone."""


@dataclass(frozen=True, kw_only=True)
class MapBid:
    """Bid of an agent; without weights every parameter counts 1.

    The bonus is what exploration takes off its distance.
    """

    agent: str
    vector: Sequence[float]
    weights: Sequence[float]
    bonus: float
    last_run: int


def is_computed(strategy: str) -> bool:
    """Return whether a map can be computed for a strategy.

    That is where the score is a distance, perhaps less a bonus that no value of the scene moves.
    """
    spec = STRATEGIES.get(strategy)
    if spec is None:
        return False
    return strategy in _DISTANCES or (spec.counts and not spec.draws and spec.lines is not None)


def computed_map(
    strategy: str,
    bids: Sequence[MapBid],
    scene: Mapping[str, float],
    across: Axis,
    up: Axis,
    tie_break: str,
) -> SceneMapRecord:
    """Return who would win for a scene with two of its values anywhere in their ranges.

    The same agents bid everywhere: what keeps one from bidding elsewhere is not known here.

    Args:
        strategy: One that :func:`is_computed`.
        bids: At least one.
        scene: All scene parameters in their order, those of the map known; NaN where missing.
        across: From left to right.
        up: From bottom to top.
        tie_break: Which of equally good bids wins.

    Raises:
        Refused: ``UNKNOWN_PARAMETER``.
    """
    names = list(scene)
    columns = [_column(names, axis.name) for axis in (across, up)]
    width = min(len(names), *(len(bid.vector) for bid in bids))
    sides = side_length(len(bids), width)
    xs, ys = across.places(sides), up.places(sides)
    scenes = np.empty((sides, sides, len(names)))
    scenes[...] = list(scene.values())
    scenes[..., columns[0]] = xs
    scenes[..., columns[1]] = np.asarray(ys)[:, None]
    weights = [(list(bid.weights) or [1.0] * width)[:width] for bid in bids]
    field = RoundArrays(
        scene=scenes[..., :width],
        std=np.zeros(width),
        bids=np.asarray([list(bid.vector)[:width] for bid in bids]),
        weights=np.asarray(weights),
        widths=np.ones(width),
        runs=np.zeros(len(bids)),
        rounds=np.zeros(()),
        idle=np.zeros(len(bids)),
    )
    spec = STRATEGIES[strategy]
    measure = spec.score if strategy in _DISTANCES else manhattan
    distance = measure(field, {}, np.random.default_rng(0)).distance
    scores = distance - np.asarray([bid.bonus for bid in bids])
    best = order(scores, [bid.last_run for bid in bids], [bid.agent for bid in bids], tie_break)
    winners = [[bids[index].agent for index in row] for row in best[..., 0]]
    return map_record(across, up, xs, ys, winners, is_asked=False)


def map_record(
    across: Axis,
    up: Axis,
    xs: Sequence[float],
    ys: Sequence[float],
    winners: Sequence[Sequence[str]],
    *,
    is_asked: bool,
) -> SceneMapRecord:
    """Return the record of a map from the winners of its rows, the lowest first; "" for nobody."""
    agents = sorted({name for row in winners for name in row})
    numbers = {name: number for number, name in enumerate(agents)}
    return SceneMapRecord(
        across=across.name,
        up=up.name,
        xs=tuple(xs),
        ys=tuple(ys),
        agents=tuple(agents),
        winners=tuple(numbers[name] for row in winners for name in row),
        is_asked=is_asked,
    )


def side_length(bids: int, width: int) -> int:
    """Return how many places a side has, so that so many bids are compared in bounded time."""
    return max(COARSEST, min(FINEST, int((_MOST_NUMBERS / max(bids * width, 1)) ** 0.5)))


def _column(names: list[str], name: str) -> int:
    if name not in names:
        raise Refused(
            "UNKNOWN_PARAMETER", f"no scene parameter '{name[:40]}'; there are {', '.join(names)}"
        )
    return names.index(name)
