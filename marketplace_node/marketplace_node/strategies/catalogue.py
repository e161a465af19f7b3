# SPDX-License-Identifier: Apache-2.0
"""Catalogue of all strategies by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from marketplace_node.strategies import exploration
from marketplace_node.strategies.distances import (
    difference,
    euclidean,
    expected_manhattan,
    manhattan,
    weighted_difference,
    weighted_manhattan,
)
from marketplace_node.strategies.exploration import (
    bounded_ucb,
    epsilon_greedy,
    softmax,
    thompson,
    ucb,
)
from marketplace_node.strategies.strategy import Option, StrategySpec

_OWN = (
    StrategySpec(
        name="manhattan",
        description="The nearest bid by the sum of the differences wins, as in the paper.",
        score=manhattan,
        difference=difference,
    ),
    StrategySpec(
        name="weighted_manhattan",
        description="Like manhattan, with a weight for each parameter.",
        score=weighted_manhattan,
        difference=weighted_difference,
    ),
    StrategySpec(
        name="euclidean",
        description="The nearest bid by straight-line distance wins; one big difference counts "
        "more than several small ones.",
        score=euclidean,
    ),
    StrategySpec(
        name="expected_manhattan",
        description="Like manhattan, but an uncertain value of the scene counts less.",
        score=expected_manhattan,
    ),
    StrategySpec(
        name="softmax",
        description="Nearer bids are more likely to win, but every bid has a chance.",
        score=softmax,
        options=(exploration.TEMPERATURE,),
        draws=True,
        difference=difference,
    ),
    StrategySpec(
        name="epsilon_greedy",
        description="The nearest bid wins, except in a share of the rounds with a random order.",
        score=epsilon_greedy,
        options=(exploration.EPSILON,),
        draws=True,
    ),
    StrategySpec(
        name="ucb",
        description="The nearest bid wins, after a bonus for agents that seldom ran.",
        score=ucb,
        options=(exploration.UCB_C,),
        counts=True,
        difference=difference,
    ),
    StrategySpec(
        name="bounded_ucb",
        description="Like ucb, but an agent much farther away than the nearest cannot win.",
        score=bounded_ucb,
        options=(exploration.BOUNDED_C, exploration.MARGIN),
        counts=True,
        difference=difference,
    ),
    StrategySpec(
        name="thompson",
        description="The nearest of randomly drawn profiles wins; they vary more for agents that "
        "seldom ran.",
        score=thompson,
        options=(exploration.SIGMA,),
        draws=True,
    ),
    StrategySpec(
        name="rules",
        description="The first rule of market.yaml that applies names the winner; manhattan ranks "
        "the other agents.",
        score=manhattan,
    ),
    StrategySpec(
        name="external",
        description="An external program ranks through the service 'bt_agents/select'; without "
        "an answer in time, manhattan does.",
        score=manhattan,
        options=(
            Option(
                name="limit",
                default=0.5,
                minimum=0.05,
                maximum=60.0,
                description="longest time for its answer [s]",
            ),
        ),
    ),
)

_ALL = {spec.name: spec for spec in _OWN}

STRATEGIES: Mapping[str, StrategySpec] = MappingProxyType(_ALL)
"""All strategies; the keys are the values of the parameter ``strategy``."""


def add(spec: StrategySpec) -> None:
    """Add a strategy, unless its name is taken."""
    _ALL.setdefault(spec.name, spec)
