# SPDX-License-Identifier: Apache-2.0
"""Sources of chance that are seeded together draw what each would draw alone."""

from __future__ import annotations

import numpy as np

from bt_agents_lab.experiments.seeding import sources
from marketplace_node.strategies import round_rng

SEEDS = [f"run {number}/{number % 7}.{number % 3}" for number in range(500)]


def test_many_sources_draw_what_each_draws_alone() -> None:
    for seed, source in zip(SEEDS, sources(SEEDS), strict=True):
        alone = round_rng(seed)
        for _ in range(2):
            assert np.array_equal(source.random((3,)), alone.random((3,)))
            assert np.array_equal(source.standard_normal((2, 3)), alone.standard_normal((2, 3)))


def test_a_seed_draws_what_it_has_always_drawn() -> None:
    assert round_rng("epoch/4").random(2).tolist() == [0.2232831641075249, 0.6788254797385785]
