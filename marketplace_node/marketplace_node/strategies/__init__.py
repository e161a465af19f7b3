# SPDX-License-Identifier: Apache-2.0
"""The rules by which the marketplace ranks bids: pure functions on arrays, by name."""

from marketplace_node.strategies.arrays import (
    Chance,
    Chances,
    Field,
    Lines,
    Option,
    Scores,
    StrategySpec,
    chance,
    explored,
    plain,
)
from marketplace_node.strategies.catalogue import STRATEGIES
from marketplace_node.strategies.distances import (
    euclidean,
    expected_manhattan,
    manhattan,
    weighted_manhattan,
)
from marketplace_node.strategies.exploration import epsilon_greedy, softmax, thompson, ucb
from marketplace_node.strategies.ordering import TIE_BREAKS, order
from marketplace_node.strategies.plugins import add_installed

__all__ = [
    "STRATEGIES",
    "TIE_BREAKS",
    "Chance",
    "Chances",
    "Field",
    "Lines",
    "Option",
    "Scores",
    "StrategySpec",
    "add_installed",
    "chance",
    "epsilon_greedy",
    "euclidean",
    "expected_manhattan",
    "explored",
    "manhattan",
    "order",
    "plain",
    "softmax",
    "thompson",
    "ucb",
    "weighted_manhattan",
]
