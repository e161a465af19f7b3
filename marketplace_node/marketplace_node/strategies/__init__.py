# SPDX-License-Identifier: Apache-2.0
"""Strategies that rank bids: named pure functions on arrays."""

from marketplace_node.strategies.arrays import (
    TIE_BREAKS,
    BatchRandomSource,
    LinearScores,
    Option,
    RandomSource,
    RoundArrays,
    Scores,
    StrategySpec,
    order,
    round_rng,
    scores_of,
    with_bonus,
)
from marketplace_node.strategies.catalogue import STRATEGIES
from marketplace_node.strategies.distances import (
    euclidean,
    expected_manhattan,
    manhattan,
    weighted_manhattan,
)
from marketplace_node.strategies.exploration import (
    bounded_ucb,
    epsilon_greedy,
    softmax,
    thompson,
    ucb,
)
from marketplace_node.strategies.plugins import add_installed

__all__ = [
    "STRATEGIES",
    "TIE_BREAKS",
    "BatchRandomSource",
    "LinearScores",
    "Option",
    "RandomSource",
    "RoundArrays",
    "Scores",
    "StrategySpec",
    "add_installed",
    "bounded_ucb",
    "epsilon_greedy",
    "euclidean",
    "expected_manhattan",
    "manhattan",
    "order",
    "round_rng",
    "scores_of",
    "softmax",
    "thompson",
    "ucb",
    "weighted_manhattan",
    "with_bonus",
]
