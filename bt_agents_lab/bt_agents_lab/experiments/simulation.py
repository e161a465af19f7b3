# SPDX-License-Identifier: Apache-2.0
"""Simulation of runs with the strategies of the market and the update rules of the learning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bt_agents_core.feedback import MOOD_RULE, FeedbackKind
from bt_agents_core.scene import Vector
from bt_agents_lab.experiments.random_streams import RandomStreams, RoundDraws, round_seed
from bt_agents_lab.experiments.simulated_world import (
    Arm,
    Bools,
    Floats,
    Integers,
    Person,
    SimulatedWorld,
)
from feedback_node.learning import learning_step
from marketplace_node.strategies import STRATEGIES, Bid, RoundBids, differences, total

NEVER = 1_000_000
"""Time of an event that never happens [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """Course of R runs of T rounds, of N agents with n parameters.

    Attributes:
        awarded: Index of the first agent that got each scene, [R, T].
        cancelled: Number of cancelled runs for each scene, [R, T].
        won: Whether each agent ran in each round, [R, T, N].
        profiles: Profiles after each round, [R, T, N, n].
    """

    awarded: Integers
    cancelled: Integers
    won: Bools
    profiles: Floats

    @property
    def all_ran(self) -> Bools:
        """Whether every agent ran at least once, [R]."""
        return np.asarray(np.all(np.any(self.won, axis=1), axis=-1))


def simulate(
    world: SimulatedWorld, arm: Arm, streams: RandomStreams, wrong_share: float = 0.0
) -> Course:
    """Play all runs of ``streams``, each alone, with a probability of wrong feedback, 0..1."""
    runs = [
        _Run(world, arm, seed, streams.rounds(row), wrong_share)
        for row, seed in enumerate(streams.seeds)
    ]
    return Course(
        awarded=np.array([[won[0] for won in run.won] for run in runs]),
        cancelled=np.array([run.cancelled for run in runs]),
        won=np.array(
            [
                [[agent in won for agent in range(len(world.agents))] for won in run.won]
                for run in runs
            ]
        ),
        profiles=np.array([run.profiles for run in runs]),
    )


class _Run:
    """One run, played as it is made.

    Attributes:
        won: For each round, the agents that ran, in order.
        cancelled: For each round, the number of cancelled runs.
        profiles: The profiles after each round.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        arm: Arm,
        seed: int,
        rounds: Sequence[RoundDraws],
        wrong_share: float,
    ) -> None:
        self._world = world
        self._arm = arm
        self._seed = seed
        self._wrong_share = wrong_share
        self._spec = STRATEGIES[arm.strategy]
        self._options = self._spec.values(arm.options)
        self._rule = learning_step.parameter_rules(arm.rule, world.space)
        self._starts = _vectors(world.starts)
        self._rates: list[float] = world.rates.tolist()
        self._profiles = _vectors(world.starts)
        self._runs = [0] * len(world.agents)
        self._last_run = [0] * len(world.agents)
        self._changes = [0] * len(world.agents)
        self._recent: list[list[Vector]] = [[] for _ in world.agents]
        self.won: list[list[int]] = []
        self.cancelled: list[int] = []
        self.profiles: list[list[Vector]] = []
        scenes = _vectors(world.scenes)
        for index, draws in enumerate(rounds):
            made_for = _vectors(world.best_in(index))
            self.won.append([])
            self.cancelled.append(0)
            self._play(index, draws, scenes[draws.scene], made_for)
            self.profiles.append(list(self._profiles))

    def _play(
        self, index: int, draws: RoundDraws, scene: Vector, made_for: Sequence[Vector]
    ) -> None:
        person, measured = self._world.person, scene
        for attempt in range(self._world.attempts):
            left = [
                agent
                for agent, name in enumerate(self._world.agents)
                if agent not in self.won[-1] and self._world.absent.get(name, 0) <= index
            ]
            if not left:
                break
            chosen = self._award(scene, left, draws.ties[attempt], index, attempt)
            is_wrong = draws.error_draw[attempt] < self._wrong_share
            if person is None:
                target = draws.wrong if is_wrong else made_for[chosen]
                self._learn(chosen, FeedbackKind.DIRECT, target, 1.0)
                break
            misfit = total(differences(made_for[chosen], measured))
            fit = min(max(1.0 - misfit / person.tolerance, -1.0), 1.0)
            if is_wrong:
                fit = draws.wrong_fit[attempt]
            kinds, mood = self._reaction(person, scene, fit, draws.mood_noise[attempt])
            for kind in kinds:
                self._learn(chosen, kind, scene, self._arm.rule.weight(MOOD_RULE))
            if FeedbackKind.NEGATIVE not in kinds:
                break
            self.cancelled[-1] += 1
            place = self._mood_place
            scene = (*scene[:place], mood, *scene[place + 1 :])

    def _award(
        self, scene: Vector, left: Sequence[int], ties: Sequence[float], index: int, attempt: int
    ) -> int:
        given = RoundBids(
            scene=scene,
            std=(0.0,) * len(scene),
            widths=self._world.space.widths,
            rounds=sum(self._runs),
            bids=[
                Bid(
                    self._world.agents[agent],
                    self._profiles[agent],
                    self._world.space.weights,
                    self._runs[agent],
                    self._last_run[agent],
                )
                for agent in left
            ],
        )
        random = self._spec.random(round_seed(self._seed, index, attempt))
        scores = self._spec.score(given, self._options, random)
        keys: dict[str, Sequence[float]] = {
            "random": ties,
            "least_recently_run": self._last_run,
            "name": range(len(self._runs)),
        }
        key = keys[self._arm.tie_break]
        # Agents are in alphabetical order, so the first of equal ones is first by name.
        tried = zip(left, scores, strict=True)
        chosen = min((score.score, key[agent], agent) for agent, score in tried)[-1]
        self.won[-1].append(chosen)
        self._runs[chosen] += 1
        self._last_run[chosen] = sum(self._runs)
        return chosen

    def _reaction(
        self, person: Person, scene: Vector, fit: float, noise: Sequence[float]
    ) -> tuple[list[FeedbackKind], float]:
        """Return the feedback of the mood rules, and the mood when the run is cancelled."""
        place = self._mood_place
        limits = self._world.space.parameters[place]
        moods = [scene[place]]
        for other in noise:
            mood = moods[-1] + (person.drift * fit + other * person.noise)
            moods.append(min(max(mood, limits.minimum), limits.maximum))
        changes = [mood - moods[0] for mood in moods[1:]]
        praised = _held([one >= person.better for one in changes], person.hold_s)
        blamed = _held([one <= -person.worse for one in changes], person.hold_s)
        kinds = [FeedbackKind.POSITIVE] if praised < blamed else []
        if blamed == NEVER:
            return kinds, moods[-1]
        return [*kinds, FeedbackKind.NEGATIVE], moods[blamed - min(person.hold_s, 1)]

    def _learn(self, agent: int, kind: FeedbackKind, target: Vector, weight: float) -> None:
        rule, profile, recent = self._rule, self._profiles[agent], self._recent[agent]
        rates = learning_step.effective_rates(
            rule, self._rates[agent], weight, self._changes[agent]
        )
        self._profiles[agent] = learning_step.apply_update(
            rule, kind, profile, target, rates, recent, self._starts[agent]
        )
        self._changes[agent] += 1
        recent.append(learning_step.requested(rule, kind, profile, target))
        del recent[: -self._arm.rule.window]

    @property
    def _mood_place(self) -> int:
        assert self._world.space.mood is not None
        return self._world.space.names.index(self._world.space.mood)


def _held(holds: Sequence[bool], hold_s: int) -> int:
    """Return the second, from 1, when a condition has held long enough, or NEVER.

    As in :class:`feedback_node.rules.Watch`, a value counts until the next one: a due rule fires
    on earlier values.
    """
    for start in range(len(holds) - hold_s):
        if all(holds[start : start + max(hold_s, 1)]):
            return start + 1 + hold_s
    return NEVER


def _vectors(rows: Floats) -> list[Vector]:
    return [tuple(row) for row in rows.tolist()]
