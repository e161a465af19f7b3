# SPDX-License-Identifier: Apache-2.0
"""Simulation of many runs at once as arrays, equal to separate runs to the last digit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bt_agents_core.feedback import MOOD_RULE, FeedbackKind, Update
from bt_agents_lab.experiments.random_streams import Attempt, CachedRandomSource, RandomStreams
from bt_agents_lab.experiments.simulated_world import Arm, Person, SimulatedWorld
from feedback_node.learning import updates
from marketplace_node.strategies import STRATEGIES, RoundArrays
from marketplace_node.strategies.arrays import Bools, Floats, Integers

NEVER = 1_000_000
"""Time of an event that never happens [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """Course of R runs of T rounds, of N agents with n parameters.

    Attributes:
        awarded: Index of the first agent that got each scene, [R, T].
        cancelled: Number of cancelled runs for each scene, [R, T].
        won: Number of runs of each agent in each round, [R, T, N]; 0 or 1.
        profiles: Profiles after each round, [R, T, N, n], or only after the last one, with one
            round.
    """

    awarded: Integers
    cancelled: Integers
    won: Bools
    profiles: Floats

    @property
    def all_ran(self) -> Bools:
        """Whether every agent ran at least once, [R]."""
        return np.asarray(np.all(np.any(self.won, axis=1), axis=-1))


class _State:
    """State of R runs between two rounds."""

    def __init__(self, world: SimulatedWorld, arm: Arm, runs: int) -> None:
        agents, width = world.starts.shape
        self.profiles: Floats = np.repeat(world.starts[None], runs, axis=0)
        self.total = np.zeros(runs)
        self.runs = np.zeros((runs, agents))
        self.last_run = np.zeros((runs, agents))
        self.changes = np.zeros((runs, agents))
        window = arm.rule.window - 1 if arm.rule.update is Update.MEDIAN else 0
        self.recent = np.full((runs, agents, window, width), np.nan)


def simulate(
    world: SimulatedWorld, arm: Arm, streams: RandomStreams, wrong_share: float = 0.0
) -> Course:
    """Play all runs of ``streams`` with a probability of wrong feedback, 0..1."""
    return _play(world, arm, streams, (wrong_share,), history=True)


def simulate_shares(
    world: SimulatedWorld, arm: Arm, streams: RandomStreams, wrong_shares: Sequence[float]
) -> list[Course]:
    """Play all runs of ``streams`` once for each share of wrong feedback; faster together.

    The result has only the profiles after the last round.
    """
    whole = _play(world, arm, streams, wrong_shares, history=False)
    runs = len(streams.seeds)
    parts = [slice(first, first + runs) for first in range(0, runs * len(wrong_shares), runs)]
    arrays = vars(whole).items()
    return [Course(**{name: values[part] for name, values in arrays}) for part in parts]


def _play(
    world: SimulatedWorld,
    arm: Arm,
    streams: RandomStreams,
    wrong_shares: Sequence[float],
    *,
    history: bool,
) -> Course:
    """Play R runs of ``streams`` for each of S shares; rows of the first share come first."""
    of_streams, rounds = streams.scene.shape
    runs = of_streams * len(wrong_shares)
    share = np.repeat(np.array(wrong_shares), of_streams)
    agents, width = world.starts.shape
    state = _State(world, arm, runs)
    rule = updates.arrays(arm.rule, world.space)
    course = Course(
        awarded=np.empty((runs, rounds), dtype=np.int64),
        cancelled=np.zeros((runs, rounds), dtype=np.int64),
        won=np.zeros((runs, rounds, agents), dtype=bool),
        profiles=np.empty((runs, rounds if history else 1, agents, width)),
    )
    everyone = np.arange(runs)
    for index in range(rounds):
        rows = everyone
        scene = world.scenes[streams.scene[rows % of_streams, index]]
        best, misfit, present = (
            world.best_in(index),
            world.misfit_in(index),
            world.present_in(index),
        )
        for attempt in range(min(world.attempts, int(present.sum()))):
            tried = course.won[rows, index] | ~present
            at = (rows % of_streams, index, attempt)
            chosen = _award(world, arm, state, streams, at, rows, scene, tried)
            if attempt == 0:
                course.awarded[:, index] = chosen
            state.runs[rows, chosen] += 1.0
            state.total[rows] += 1.0
            state.last_run[rows, chosen] = state.total[rows]
            course.won[rows, index, chosen] = True
            is_wrong = streams.error_draw[at] < share[rows]
            if world.person is None:
                target = np.where(is_wrong[:, None], streams.wrong[at[:2]], best[chosen])
                _learn(world, rule, state, rows, chosen, FeedbackKind.DIRECT, target, 1.0)
                break
            person = world.person
            unfit = misfit[streams.scene[at[:2]], chosen]
            moods = _moods(world, person, streams, at, scene, unfit, is_wrong)
            change = moods[1:] - moods[0]
            praised = _held(change >= person.better, person.hold_s)
            blamed = _held(change <= -person.worse, person.hold_s)
            weight = arm.rule.weight(MOOD_RULE)
            stopped = blamed < NEVER
            for kind, some in (
                (FeedbackKind.POSITIVE, praised < blamed),
                (FeedbackKind.NEGATIVE, stopped),
            ):
                _learn(world, rule, state, rows[some], chosen[some], kind, scene[some], weight)
            course.cancelled[rows[stopped], index] += 1
            scene = scene[stopped]
            seen_at = blamed[stopped] - min(person.hold_s, 1)
            scene[:, _mood_place(world)] = moods[seen_at, stopped.nonzero()[0]]
            rows = rows[stopped]
            if not len(rows):
                break
        if history or index == rounds - 1:
            course.profiles[:, index if history else 0] = state.profiles
    return course


def _award(
    world: SimulatedWorld,
    arm: Arm,
    state: _State,
    streams: RandomStreams,
    at: Attempt,
    rows: Integers,
    scene: Floats,
    tried: Bools,
) -> Integers:
    """Return the winner in each run; all runs have the same number of agents left."""
    total = state.total[rows]
    profiles, runs, last_run = state.profiles, state.runs, state.last_run
    bidders = None
    left = len(world.agents) - int(tried[0].sum())
    if left < len(world.agents):
        bidders = np.argsort(tried, axis=-1, kind="stable")[:, :left]
        where = (rows[:, None], bidders)
        profiles, runs, last_run = profiles[where], runs[where], last_run[where]
    spec = STRATEGIES[arm.strategy]
    score = spec.score(
        RoundArrays(
            scene=scene,
            std=np.zeros(scene.shape),
            bids=profiles,
            weights=np.array([p.weight for p in world.space.parameters]),
            widths=world.high - world.low,
            runs=runs,
            rounds=total,
            idle=total[:, None] - last_run,
        ),
        spec.values(arm.options),
        CachedRandomSource(streams, at),
    ).score
    # Bidders stay in alphabetical order, so the first of the remaining ones is first by name.
    best = score == score.min(axis=-1, keepdims=True)
    if arm.tie_break == "random":
        ties = streams.ties[at]
        if bidders is not None:
            ties = np.take_along_axis(ties, bidders, axis=-1)
        chosen = np.where(best, ties, np.inf).argmin(axis=-1)
    elif arm.tie_break == "name":
        chosen = best.argmax(axis=-1)
    else:
        chosen = np.where(best, last_run, np.inf).argmin(axis=-1)
    return np.asarray(chosen if bidders is None else bidders[np.arange(len(rows)), chosen])


def _moods(
    world: SimulatedWorld,
    person: Person,
    streams: RandomStreams,
    at: Attempt,
    scene: Floats,
    misfit: Floats,
    is_wrong: Bools,
) -> Floats:
    """Return the mood at the start and after each second, [seconds + 1, rows]."""
    place = _mood_place(world)
    fit = np.clip(1.0 - misfit / person.tolerance, -1.0, 1.0)
    fit = np.where(is_wrong, streams.wrong_fit[at], fit)
    noise = streams.mood_noise[at].astype(np.float64) * person.noise
    steps = (person.drift * fit[:, None] + noise).T
    moods = np.empty((person.seconds + 1, len(scene)))
    moods[0] = scene[:, place]
    low, high = world.low[place], world.high[place]
    for second, step in enumerate(steps):
        np.clip(moods[second] + step, low, high, out=moods[second + 1])
    return moods


def _held(holds: Bools, hold_s: int) -> Integers:
    """Return the second, from 1, when a condition [seconds, rows] has held long enough, or NEVER.

    As in :class:`feedback_node.rules.Watch`, a value counts until the next one: a due rule fires
    on earlier values.
    """
    starts = len(holds) - hold_s
    if starts < 1:
        return np.full(holds.shape[1], NEVER)
    whole = holds[:starts].copy()
    for shift in range(1, hold_s):
        whole &= holds[shift : shift + starts]
    return np.where(whole.any(axis=0), np.argmax(whole, axis=0) + 1 + hold_s, NEVER)


def _learn(
    world: SimulatedWorld,
    rule: updates.RuleArrays,
    state: _State,
    rows: Integers,
    chosen: Integers,
    kind: FeedbackKind,
    target: Floats,
    weight: float,
) -> None:
    if not len(rows):
        return
    profile = state.profiles[rows, chosen]
    recent = state.recent[rows, chosen]
    rate = updates.rates(
        rule, world.rates[chosen], np.full(len(rows), weight), state.changes[rows, chosen]
    )
    state.profiles[rows, chosen] = updates.apply_update(
        kind, profile, target, rate, rule, recent, world.starts[chosen], world.low, world.high
    )
    state.changes[rows, chosen] += 1.0
    if recent.shape[1]:
        asked = updates.requested(kind, profile, target, rule)
        state.recent[rows, chosen] = np.concatenate([recent[:, 1:], asked[:, None]], axis=1)


def _mood_place(world: SimulatedWorld) -> int:
    assert world.space.mood is not None
    return world.space.names.index(world.space.mood)
