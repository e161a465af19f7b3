# SPDX-License-Identifier: Apache-2.0
"""Round arrays written by hand, and the scores that strategies give them."""

from __future__ import annotations

from typing import Any

import numpy as np

from marketplace_node.strategies import STRATEGIES, RandomSource, RoundArrays, Scores, round_rng

WIDTH = 4.0


def field(scene: Any, bids: Any, **changes: Any) -> RoundArrays:
    """Return bids for a scene; nobody has run, all is certain and counts alike but for changes."""
    scenes, vectors = np.array(scene, dtype=float), np.array(bids, dtype=float)
    count = vectors.shape[-1]
    values: dict[str, Any] = {
        "scene": scenes,
        "std": np.zeros_like(scenes),
        "bids": vectors,
        "weights": np.ones(count),
        "widths": np.full(count, WIDTH),
        "runs": np.zeros(vectors.shape[:-1]),
        "rounds": np.zeros(scenes.shape[:-1]),
        "idle": np.zeros(vectors.shape[:-1]),
    }
    return RoundArrays(
        **(values | {name: np.array(v, dtype=float) for name, v in changes.items()})
    )


def scored(
    name: str, of: RoundArrays, random: RandomSource | None = None, **options: float
) -> Scores:
    """Return the scores of a strategy, with the defaults of what is not named."""
    spec = STRATEGIES[name]
    return spec.score(of, spec.values(options), random or round_rng("seed"))
