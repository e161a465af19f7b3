# SPDX-License-Identifier: Apache-2.0
"""Strategies that rank bids: named pure functions of the bids of one round."""

from marketplace_node.strategies.catalogue import (
    STRATEGIES,
    bounded_ucb,
    differences,
    epsilon_greedy,
    euclidean,
    expected_manhattan,
    manhattan,
    softmax,
    thompson,
    ucb,
    weighted_manhattan,
)
from marketplace_node.strategies.plugins import add_installed
from marketplace_node.strategies.strategy import (
    TIE_BREAKS,
    Bid,
    Option,
    RoundBids,
    Score,
    StrategySpec,
    order,
    round_rng,
    total,
    winners,
)

__all__ = [
    "STRATEGIES",
    "TIE_BREAKS",
    "Bid",
    "Option",
    "RoundBids",
    "Score",
    "StrategySpec",
    "add_installed",
    "bounded_ucb",
    "differences",
    "epsilon_greedy",
    "euclidean",
    "expected_manhattan",
    "manhattan",
    "order",
    "round_rng",
    "softmax",
    "thompson",
    "total",
    "ucb",
    "weighted_manhattan",
    "winners",
]
