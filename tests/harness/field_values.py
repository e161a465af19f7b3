# SPDX-License-Identifier: Apache-2.0
"""Bids of a round written by hand, and the scores that strategies give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marketplace_node.strategies import STRATEGIES, Bid, RoundBids, Score, round_rng

WIDTH = 4.0

Row = Sequence[float]


def field(
    scene: Row,
    profiles: Sequence[Row],
    *,
    std: Row = (),
    weights: Sequence[Row] = (),
    runs: Sequence[int] = (),
    rounds: int = 0,
) -> RoundBids:
    """Return bids for a scene; by default without runs, all values certain and of weight 1."""
    width, count = len(scene), len(profiles)
    return RoundBids(
        scene=tuple(scene),
        std=tuple(std) or (0.0,) * width,
        widths=(WIDTH,) * width,
        rounds=rounds,
        bids=[
            Bid(agent=f"{number:02}", profile=tuple(profile), weights=tuple(weight), runs=ran)
            for number, (profile, weight, ran) in enumerate(
                zip(
                    profiles, weights or [(1.0,) * width] * count, runs or [0] * count, strict=True
                )
            )
        ],
    )


def scored(
    name: str, of: RoundBids, random: np.random.Generator | None = None, **options: float
) -> list[Score]:
    """Return the scores of a strategy; options that are not named have their defaults."""
    spec = STRATEGIES[name]
    return list(spec.score(of, spec.values(options), random or round_rng("seed")))
