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
        description="The nearest bid wins: the sum of the differences, as in the paper.",
        score=manhattan,
        difference=difference,
    ),
    StrategySpec(
        name="weighted_manhattan",
        description="As manhattan, but parameters count by their weight.",
        score=weighted_manhattan,
        difference=weighted_difference,
    ),
    StrategySpec(
        name="euclidean",
        description="The nearest bid by the straight line wins; one big difference counts more "
        "than some small ones.",
        score=euclidean,
    ),
    StrategySpec(
        name="expected_manhattan",
        description="As manhattan, but an uncertain value of the scene counts less.",
        score=expected_manhattan,
    ),
    StrategySpec(
        name="softmax",
        description="Nearer bids are likelier to win, but none is left out for ever.",
        score=softmax,
        options=(exploration.TEMPERATURE,),
        draws=True,
        difference=difference,
    ),
    StrategySpec(
        name="epsilon_greedy",
        description="The nearest bid wins, but now and then anybody does.",
        score=epsilon_greedy,
        options=(exploration.EPSILON,),
        draws=True,
    ),
    StrategySpec(
        name="ucb",
        description="The nearest bid wins, but who ran seldom is forgiven some distance.",
        score=ucb,
        options=(exploration.UCB_C,),
        counts=True,
        difference=difference,
    ),
    StrategySpec(
        name="bounded_ucb",
        description="As ucb, but nobody wins who is much further than the nearest.",
        score=bounded_ucb,
        options=(exploration.BOUNDED_C, exploration.MARGIN),
        counts=True,
        difference=difference,
    ),
    StrategySpec(
        name="thompson",
        description="Profiles are taken for the less certain the less they ran; the nearest of "
        "drawn ones wins.",
        score=thompson,
        options=(exploration.SIGMA,),
        draws=True,
    ),
    StrategySpec(
        name="rules",
        description="The first rule of market.yaml that holds says who wins; the others by "
        "manhattan.",
        score=manhattan,
    ),
    StrategySpec(
        name="external",
        description="A program outside ranks, asked by the service 'bt_agents/select'; without "
        "its answer in time, manhattan.",
        score=manhattan,
        options=(
            Option(
                name="limit",
                default=0.5,
                minimum=0.05,
                maximum=60.0,
                description="how long its answer is waited for [s]",
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
