# SPDX-License-Identifier: Apache-2.0
"""Scene map: the winners over two parameters around a scene, computed without a request."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bt_agents_studio.records import ParameterRecord, SceneMapRecord
from marketplace_node.strategies import STRATEGIES, Bid, winners

FINEST = 41
"""Maximum number of points along each side of a computed map."""

COARSEST = 5
"""Minimum number of points along each side, used if many agents bid."""

ASKED = 7
"""Points along each side of a map if the market must be asked for each point."""

_MOST_NUMBERS = 300_000


def places(parameter: ParameterRecord, count: int) -> tuple[float, ...]:
    """Return evenly spaced values of a parameter, including both ends."""
    return tuple(float(one) for one in np.linspace(parameter.minimum, parameter.maximum, count))


def is_computed(strategy: str) -> bool:
    """Return whether a map can be computed for a strategy.

    A map can be computed if the score is a sum over the parameters, perhaps less a bonus that does
    not depend on the scene.
    """
    spec = STRATEGIES.get(strategy)
    return spec is not None and spec.difference is not None and not spec.draws


def computed_map(
    strategy: str,
    bids: Sequence[Any],
    scene: Mapping[str, float],
    across: ParameterRecord,
    up: ParameterRecord,
    tie_break: str,
) -> SceneMapRecord:
    """Return the winners for a scene with two of its values anywhere in their ranges.

    The same agents bid everywhere: reasons not to bid elsewhere are not known here.

    Args:
        strategy: A strategy that :func:`is_computed` accepts.
        bids: At least one ``RankedBid``; without weights, every parameter has weight 1.
            Exploration subtracts the bonus from the distance.
        scene: All scene parameters in order, with values for the map's sides; NaN if missing.
        across: Parameter from left to right.
        up: Parameter from bottom to top.
        tie_break: Decides between equally good bids.
    """
    names = list(scene)
    width = min(len(names), *(len(bid.vector) for bid in bids))
    sides = side_length(len(bids), width)
    xs, ys = places(across, sides), places(up, sides)
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
    scenes[:, names.index(across.name)] = np.tile(xs, sides)
    scenes[:, names.index(up.name)] = np.repeat(ys, sides)
    difference = STRATEGIES[strategy].difference
    assert difference is not None, "see is_computed"
    found = winners(difference, scenes[:, :width], offered, [bid.bonus for bid in bids], tie_break)
    names = [bids[index].agent for index in found]
    rows = [names[row * sides : (row + 1) * sides] for row in range(sides)]
    return map_record(across, up, xs, ys, rows, is_asked=False)


def map_record(
    across: ParameterRecord,
    up: ParameterRecord,
    xs: Sequence[float],
    ys: Sequence[float],
    winners: Sequence[Sequence[str]],
    *,
    is_asked: bool,
) -> SceneMapRecord:
    """Return the record of a map from the winners of its rows, lowest row first; "" for none."""
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
    """Return the points along a side that keep the time for a number of bids bounded."""
    return max(COARSEST, min(FINEST, int((_MOST_NUMBERS / max(bids * width, 1)) ** 0.5)))
