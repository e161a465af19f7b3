# SPDX-License-Identifier: Apache-2.0
"""Search for the nearest bids that measures no more than it needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from marketplace_node.strategies.arrays import Floats, Sum

FEW = 12
"""Up to so many numbers, loops are faster than arrays."""

SOME = 300
"""Up to so many numbers, less is lost by one array of all than by going block by block."""

BLOCK = 16_384
"""So many bids are worked on at once: their sums stay in the cache of a core."""

MANHATTAN = Sum()

_added = np.add.reduce


def nearest(
    bids: Floats, scene: Floats, distance: Sum = MANHATTAN, weights: Any = 1.0
) -> list[int]:
    """Return the rows of all bids than which none is nearer, ascending.

    Each distance is bit for bit that of the strategy.

    Args:
        bids: [N, n], stored parameter by parameter; N at least 1, all finite.
        scene: [n], NaN where missing.
        distance: How it is measured.
        weights: Of a weighted sum, [N, n], [n] or one number.
    """
    if distance is not MANHATTAN:
        return _among_many(bids, scene, distance, weights)
    numbers = bids.size
    if numbers <= FEW:
        found = _added_up(bids.tolist(), scene.tolist())
    elif numbers <= SOME:
        # Whole columns are added one after the other, as in a loop.
        found = _added(abs(bids - scene), 1).tolist()
    else:
        return _among_many(bids, scene, distance, weights)
    least = min(found)
    if least != least:  # a value of the scene is missing
        return _among_many(bids, scene, distance, weights)
    if found.count(least) == 1:
        return [found.index(least)]
    return [row for row, measured in enumerate(found) if measured == least]


def weighted_distance(
    bid: Sequence[float], scene: Sequence[float], distance: Sum, weights: Sequence[float]
) -> tuple[float, tuple[float, ...]]:
    """Return the distance of one bid and what each parameter adds to it, as its strategy does.

    All are n values; those of the scene are NaN where missing.
    """
    differences = zip(bid, scene, strict=True)
    parts = [
        0.0 if math.isnan(wanted) else abs(offered - wanted) for offered, wanted in differences
    ]
    if distance.weighted:
        parts = [part * weight for part, weight in zip(parts, weights, strict=True)]
    if distance.squared:
        parts = [part * part for part in parts]
    added = 0.0
    for part in parts:  # sum() rounds otherwise, from Python 3.12 on
        added += part
    if not distance.squared:
        return added, tuple(parts)
    length = math.sqrt(added)
    return length, tuple(part / (length or 1.0) for part in parts)


def _added_up(bids: list[list[float]], scene: list[float]) -> list[float]:
    found = []
    for bid in bids:
        added = 0.0
        for offered, wanted in zip(bid, scene):  # noqa: B905 - the keyword takes longer than a sum
            added += abs(offered - wanted)
        found.append(added)
    return found


def _among_many(bids: Floats, scene: Floats, distance: Sum, weights: Any) -> list[int]:
    known = np.flatnonzero(~np.isnan(scene)).tolist()
    if not known:
        return list(range(len(bids)))
    by_bid = np.broadcast_to(weights, bids.shape) if distance.weighted else None
    sums, parts = np.empty(BLOCK), np.empty(BLOCK)
    least = math.inf
    rows: list[int] = []
    for first in range(0, len(bids), BLOCK):
        block = slice(first, first + BLOCK)
        added = sums[: len(bids) - first]
        for index in known:
            part = added if index == known[0] else parts[: len(added)]
            np.subtract(bids[block, index], scene[index], out=part)
            if distance.squared:
                np.multiply(part, part, out=part)
            else:
                np.abs(part, out=part)
            if by_bid is not None:
                np.multiply(part, by_bid[block, index], out=part)
            if part is not added:
                np.add(added, part, out=added)
        if distance.squared:
            np.sqrt(added, out=added)
        best = float(added[added.argmin()])
        if best <= least:
            equals = (np.flatnonzero(added == best) + first).tolist()
            rows = equals if best < least else rows + equals
            least = best
    return rows
