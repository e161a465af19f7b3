# SPDX-License-Identifier: Apache-2.0
"""Contextual bandits of MABWiser as baselines: they learn from rewards, without profiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.experiments.simulated_world import SimulatedWorld
from marketplace_node.strategies import Option
from marketplace_node.strategies.arrays import Bools, Floats, Integers

_ALPHA = Option(
    name="alpha",
    default=1.0,
    minimum=0.0,
    maximum=100.0,
    description="how much it explores; more is more",
)
_NEIGHBOURS = Option(
    name="k", default=20.0, minimum=1.0, maximum=1000.0, description="how many scenes count"
)
_EPSILON = Option(
    name="epsilon",
    default=0.1,
    minimum=0.0,
    maximum=1.0,
    description="share of the rounds that are left to chance",
)

BANDITS: Mapping[str, tuple[Option, ...]] = MappingProxyType(
    {"linucb": (_ALPHA,), "lints": (_ALPHA,), "knn": (_NEIGHBOURS, _EPSILON)}
)
"""Options of each bandit by name: LinUCB (Li and others, 2010), linear Thompson sampling
(Agrawal and Goyal, 2013), and the best of the nearest earlier scenes."""


class Bandits:
    """One bandit for each of many runs.

    Its arms are the present agents, its context is the scene as shares of the ranges, and its
    reward is between −1 and 1.
    """

    def __init__(
        self, name: str, options: Mapping[str, float], world: SimulatedWorld, seeds: Sequence[int]
    ) -> None:
        try:
            from mabwiser import mab
        except ImportError:
            raise BtAgentsError(
                f"{name} needs MABWiser, which is not installed; install it with "
                "'pip install bt-agents[lab]'"
            ) from None
        values = {
            option.name: options.get(option.name, option.default) for option in BANDITS[name]
        }
        policies: dict[str, Callable[[], Any]] = {
            "linucb": lambda: (mab.LearningPolicy.LinUCB(alpha=values["alpha"]),),
            "lints": lambda: (mab.LearningPolicy.LinTS(alpha=values["alpha"]),),
            "knn": lambda: (
                mab.LearningPolicy.EpsilonGreedy(epsilon=values["epsilon"]),
                mab.NeighborhoodPolicy.KNearest(k=int(values["k"])),
            ),
        }
        self._world = world
        present = np.flatnonzero(world.present_in(0)).tolist()
        self._bandits: list[Any] = [mab.MAB(present, *policies[name](), seed=one) for one in seeds]
        self._rewarded = np.zeros(len(seeds), dtype=np.int64)
        # From here on a neighbourhood is full; before, chance decides.
        self._needed = int(values.get("k", 1))

    def award(self, rows: Integers, scene: Floats, excluded: Bools, chance: Floats) -> Integers:
        """Return the agent that each of some runs selects.

        Args:
            rows: Some runs.
            scene: [rows, n].
            excluded: Agents that are not allowed, the same number in each run, [rows, N].
            chance: Order of the agents while nothing is known, [rows, N].
        """
        contexts = self._contexts(scene)
        scores = np.where(excluded, np.inf, chance)
        for place, row in enumerate(rows.tolist()):
            if self._rewarded[row] < self._needed:
                continue
            bandit = self._bandits[row]
            for agent in np.flatnonzero(~excluded[place]).tolist():
                if agent not in bandit.arms:
                    bandit.add_arm(agent)
            expected = bandit.predict_expectations(contexts[place : place + 1])
            for agent in np.flatnonzero(~excluded[place]).tolist():
                scores[place, agent] = -expected[agent]
        return np.asarray(scores.argmin(axis=-1))

    def learn(self, rows: Integers, scene: Floats, chosen: Integers, reward: Floats) -> None:
        """Give each of some runs the reward of its selected agent."""
        contexts = self._contexts(scene)
        for place, row in enumerate(rows.tolist()):
            agent = int(chosen[place])
            bandit = self._bandits[row]
            if agent not in bandit.arms:
                bandit.add_arm(agent)
            # The first reward creates a bandit, the others update it.
            take = bandit.partial_fit if self._rewarded[row] else bandit.fit
            take([agent], [float(reward[place])], contexts[place : place + 1])
            self._rewarded[row] += 1

    def _contexts(self, scene: Floats) -> Floats:
        low, high = self._world.low, self._world.high
        shares = (scene - low) / (high - low)
        return np.concatenate([np.ones((len(scene), 1)), shares], axis=1)
