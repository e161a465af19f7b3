# SPDX-License-Identifier: Apache-2.0
"""Simulated world: agents, the scenes they should learn, and a person who reacts to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from bt_agents_core.feedback import LearningRule
from bt_agents_core.scene import SceneSpace
from marketplace_node.settings import EXTERNAL, RULES
from marketplace_node.strategies import TIE_BREAKS

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

NOT_SIMULATED = (EXTERNAL, RULES)
"""Strategies that need more than the bids."""


@dataclass(frozen=True, kw_only=True)
class Person:
    """Model of a person's mood during a run, and of the mood rules that observe it.

    The mood changes each second by ``drift * fit`` plus normally distributed noise, within the
    range of its parameter. The fit is 1 for an agent that is made for the scene, falls with the
    Manhattan distance between both, is 0 at ``tolerance`` and never less than −1. If feedback is
    wrong, the mood has other reasons, and the fit is uniform from −1 to 1.

    Attributes:
        seconds: Duration of an interaction; the mood is sampled once a second [s].
        drift: Change of the mood by a perfectly fitting agent [1/s].
        noise: Standard deviation of other changes of the mood in a second.
        tolerance: Distance at which an agent neither pleases nor annoys.
        better: Rise of the mood that gives positive feedback.
        worse: Fall of the mood that gives negative feedback and cancels the run.
        hold_s: Time that either must last; whole seconds [s].
    """

    seconds: int = 12
    drift: float = 0.3
    noise: float = 0.15
    tolerance: float = 2.0
    better: float = 0.5
    worse: float = 1.0
    hold_s: int = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangeOfMind:
    """Change of the scenes that agents are made for.

    Attributes:
        after: Number of rounds before it.
        best: Scene that each agent is then made for, [N, n].
    """

    after: int
    best: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedWorld:
    """World of simulated runs.

    N agents, K scenes, n parameters.

    Attributes:
        space: The scene parameters; with a person, one of them is the mood.
        agents: Names in alphabetical order, N.
        starts: Profiles before the first round, [N, n].
        best: Scene that each agent is made for, which only the person knows, [N, n].
        scenes: [K, n].
        rates: Learning rate of each agent, [N].
        person: Person whose mood reacts during the run; with None, each agent gets the scene that
            it is made for as feedback after its run, as in the paper.
        change: Change of the person's wishes during a run; None for none.
        absent: Number of rounds at the start without an agent, by its name.
    """

    space: SceneSpace
    agents: tuple[str, ...]
    starts: Floats
    best: Floats
    scenes: Floats
    rates: Floats
    person: Person | None = None
    change: ChangeOfMind | None = None
    absent: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def low(self) -> Floats:
        """Lower ends of the ranges, [n]."""
        return np.array([p.minimum for p in self.space.parameters])

    @cached_property
    def high(self) -> Floats:
        """Upper ends of the ranges, [n]."""
        return np.array([p.maximum for p in self.space.parameters])

    def best_in(self, round_index: int) -> Floats:
        """Return the scene that each agent is made for in a round, counted from 0, [N, n]."""
        change = self.change
        return self.best if change is None or round_index < change.after else change.best

    def present_in(self, round_index: int) -> Bools:
        """Return whether each agent is present in a round, counted from 0, [N]."""
        return np.array([self.absent.get(name, 0) <= round_index for name in self.agents])

    def misfit_in(self, round_index: int) -> Floats:
        """Return the Manhattan distance of each scene to the one that each agent is made for.

        It is infinite for an agent that is absent in the round, [K, N].
        """
        misfit = np.abs(self.scenes[:, None] - self.best_in(round_index)).sum(axis=-1)
        return np.where(self.present_in(round_index), misfit, np.inf)

    @property
    def attempts(self) -> int:
        """Maximum number of runs per interaction: another agent follows a cancelled run."""
        return 1 if self.person is None else len(self.agents)


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Method of selection.

    Attributes:
        strategy: As in the market's parameter.
        options: Options of the strategy; others have their defaults.
        tie_break: As in the market's parameter, or ``random``, which the market does not have.
    """

    strategy: str = "manhattan"
    options: Mapping[str, float] = field(default_factory=dict)
    tie_break: str = TIE_BREAKS[0]

    @property
    def label(self) -> str:
        """Label for tables and figures: ``ucb c=2``."""
        parts = [self.strategy, *(f"{name}={value:g}" for name, value in self.options.items())]
        if self.tie_break != TIE_BREAKS[0]:
            parts.append(f"(ties: {self.tie_break})")
        return " ".join(parts)


@dataclass(frozen=True, kw_only=True)
class Arm(Selection):
    """Method of selection and learning."""

    rule: LearningRule = field(default_factory=LearningRule)
