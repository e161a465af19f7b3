# SPDX-License-Identifier: Apache-2.0
"""The vectors and weights of one host's answer, checked all at once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bt_agents_core.errors import Refused
from bt_agents_core.scene import MAX_WEIGHT, SceneSpace
from marketplace_node.round.decision import Bids
from marketplace_node.strategies.arrays import Floats


class BidRows:
    """Rows of numbers, one an agent.

    Args:
        space: The scene parameters.
        bids: An answer whose lengths are right.

    Attributes:
        vectors: [k, n]; a row counts only when :meth:`check` has passed.
        weights: The same for weights; None when the host states none.
    """

    def __init__(self, space: SceneSpace, bids: Bids) -> None:
        self._space = space
        self._bids = bids
        shape = (len(bids.agents), len(space))
        low = [parameter.minimum for parameter in space.parameters]
        high = [parameter.maximum for parameter in space.parameters]
        self.vectors, self._fine = _within(bids.vectors, shape, low, high)
        self.weights: Floats | None = None
        if len(bids.weights):
            self.weights, fine = _within(bids.weights, shape, [0.0], [MAX_WEIGHT])
            self._fine &= fine

    @property
    def all_fine(self) -> bool:
        """Whether every row counts."""
        return bool(self._fine.all())

    def check(self, row: int, agent: str) -> None:
        """Check one row.

        Raises:
            Refused: As :meth:`SceneSpace.vector`, or ``BAD_WEIGHT``.
        """
        if self._fine[row]:
            return
        width = len(self._space)
        cells = slice(row * width, (row + 1) * width)
        self.vectors[row] = self._space.vector(self._bids.vectors[cells], what=f"bid of {agent}")
        for name, weight in zip(self._space.names, self._bids.weights[cells], strict=False):
            if not (math.isfinite(weight) and 0.0 <= weight <= MAX_WEIGHT):
                raise Refused(
                    "BAD_WEIGHT",
                    f"bid of {agent}: the weight of {name} is {weight:g}, expected 0 to "
                    f"{MAX_WEIGHT:g}",
                )


def _within(
    values: Sequence[float], shape: tuple[int, int], low: list[float], high: list[float]
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the values [k, n] and which rows are numbers within the limits, [k]."""
    try:
        table = np.array(values, dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError):
        return np.full(shape, math.nan), np.zeros(shape[0], dtype=np.bool_)
    fine: npt.NDArray[np.bool_] = np.all((table >= low) & (table <= high), axis=1)
    return table, fine
