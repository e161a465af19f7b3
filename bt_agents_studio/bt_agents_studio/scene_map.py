# SPDX-License-Identifier: Apache-2.0
"""Scene map: who would win where, over two parameters around one scene, without asking anybody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.records import SceneMapRecord
from marketplace_node.strategies import STRATEGIES, Bid, winners

FINEST = 41
"""Places along each side of a computed map, at most."""

COARSEST = 5
"""The same, at least, where many agents bid."""

ASKED = 7
"""Places along each side of a map for which the market is asked at each place."""

_MOST_NUMBERS = 300_000


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Scene parameter along one side of a map."""

    name: str
    minimum: float
    maximum: float

    def places(self, count: int) -> tuple[float, ...]:
        """Return evenly spaced values, both ends included."""
        return tuple(float(one) for one in np.linspace(self.minimum, self.maximum, count))


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

    That is where the score is a sum over the parameters, perhaps less a bonus that no value of the
    scene moves.
    """
    spec = STRATEGIES.get(strategy)
    return spec is not None and spec.difference is not None and not spec.draws


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
    offered = [
        Bid(
            agent=bid.agent,
            profile=tuple(bid.vector)[:width],
            weights=(tuple(bid.weights) or (1.0,) * width)[:width],
            last_run=bid.last_run,
        )
        for bid in bids
    ]
    scenes = np.tile(list(scene.values()), (sides * sides, 1))
    scenes[:, columns[0]] = np.tile(xs, sides)
    scenes[:, columns[1]] = np.repeat(ys, sides)
    difference = STRATEGIES[strategy].difference
    assert difference is not None, "see is_computed"
    found = winners(difference, scenes[:, :width], offered, [bid.bonus for bid in bids], tie_break)
    names = [bids[index].agent for index in found]
    rows = [names[row * sides : (row + 1) * sides] for row in range(sides)]
    return map_record(across, up, xs, ys, rows, is_asked=False)


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
            RefusalCode.UNKNOWN_PARAMETER,
            f"no scene parameter '{name[:40]}'; there are {', '.join(names)}",
        )
    return names.index(name)
