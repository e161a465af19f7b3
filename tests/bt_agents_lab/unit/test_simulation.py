# SPDX-License-Identifier: Apache-2.0
"""Simulated runs: the same as runs of the nodes."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from bt_agents_core.feedback import LearningRule, Update
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_lab.experiments.measures import LAST, of_runs, right, summary, wilson
from bt_agents_lab.experiments.random_streams import draw
from bt_agents_lab.experiments.simulated_world import (
    NOT_SIMULATED,
    Arm,
    ChangeOfMind,
    Person,
    SimulatedWorld,
)
from bt_agents_lab.experiments.simulation import simulate
from marketplace_node.strategies import STRATEGIES, round_rng
from one_run import live

MADE_FOR = np.array([[1.0, 1.0, 1.0], [3.0, 3.0, 3.0], [5.0, 5.0, 5.0]])


def space(*names: str, default: float) -> SceneSpace:
    parameters = (SceneParameter(name=n, minimum=1, maximum=5, default=default) for n in names)
    return SceneSpace(parameters=tuple(parameters), mood="mood" if "mood" in names else None)


def told(*agents: str) -> SimulatedWorld:
    """The paper's Experiment 3, with agents in the order of their scenes."""
    order = sorted(range(3), key=lambda place: agents[place])
    return SimulatedWorld(
        space=space("age", "profession", "emotion", default=2.5),
        agents=tuple(sorted(agents)),
        starts=np.full((3, 3), 2.5),
        best=MADE_FOR[order],
        scenes=MADE_FOR,
        rates=np.full(3, 0.2),
    )


PAPER = told("agent_1", "agent_3", "agent_5")
PERSONS = SimulatedWorld(
    space=space("age", "familiarity", "mood", default=3.0),
    agents=("calm", "guide", "play", "swift"),
    starts=np.full((4, 3), 3.0),
    best=np.array([[3.5, 2.0, 1.5], [4.5, 1.5, 3.0], [1.5, 2.0, 4.0], [3.0, 5.0, 3.0]]),
    scenes=np.array([[3.5, 2.0, 1.5], [4.5, 1.5, 3.0], [1.5, 2.0, 4.0], [3.0, 5.0, 3.0]]),
    rates=np.array([0.2, 0.3, 0.1, 0.2]),
    person=Person(),
)
CHANGING = replace(
    PERSONS,
    best=PERSONS.best[[0, 1, 0, 3]],  # two equally good ones
    change=ChangeOfMind(after=6, best=PERSONS.best[::-1]),
    absent={"guide": 3, "swift": 9},
)
STRATEGY_NAMES = [name for name in STRATEGIES if name not in NOT_SIMULATED]


@pytest.mark.parametrize("update", Update)
@pytest.mark.parametrize("strategy", STRATEGY_NAMES)
@pytest.mark.parametrize("world", [PAPER, PERSONS, CHANGING], ids=["told", "persons", "changing"])
def test_a_run_equals_market_and_learning_exactly(world, strategy, update):
    streams = draw(world, [3, 11], 15)
    arm = Arm(strategy=strategy, rule=LearningRule(update=update, anneal=0.01, window=4))
    course = simulate(world, arm, streams, 0.3)
    for row in range(len(streams.seeds)):
        lived = live(world, arm, streams, row, 0.3)
        assert course.awarded[row].tolist() == lived.awarded
        assert course.cancelled[row].tolist() == lived.cancelled
        assert course.profiles[row].tolist() == [list(map(list, one)) for one in lived.profiles]
    if world.person is not None:
        assert course.cancelled.any()


def test_absent_agent_gets_no_award_and_counts_later():
    world = replace(PAPER, absent={"agent_5": 20})
    streams = draw(world, range(5), 40)
    course = simulate(world, Arm(strategy="bounded_ucb"), streams)
    correct = right(world, streams, course)
    last = world.agents.index("agent_5")
    before, after = slice(None, 20), slice(20, None)
    assert not (course.awarded[:, before] == last).any()
    assert (course.awarded[:, after] == last).any(axis=1).all()
    fives = streams.scene == 2
    assert np.array_equal(correct & fives, (course.awarded == [[1] * 20 + [2] * 20]) & fives)


def test_correct_agent_changes_with_persons_preference():
    world = replace(PAPER, change=ChangeOfMind(after=20, best=PAPER.best[::-1]))
    streams = draw(world, [1], 40)
    course = simulate(world, Arm(tie_break="name"), streams)
    expected = np.concatenate([streams.scene[:, :20], 2 - streams.scene[:, 20:]], axis=1)
    found = right(world, streams, course)
    assert np.array_equal(found, course.awarded == expected)
    assert of_runs(world, streams, course).error[0] == pytest.approx(
        np.abs(course.profiles[0, -1] - PAPER.best[::-1]).sum(axis=-1).mean()
    )


def test_equally_good_agents_are_right_but_need_turns():
    world = replace(PAPER, best=MADE_FOR[[0, 0, 2]], scenes=MADE_FOR[[0, 2]])
    streams = draw(world, [1], 120)
    course = simulate(world, Arm(), streams)
    for awarded, served in (([0, 1], True), ([0, 0], False)):
        turns = np.where(streams.scene == 1, 2, np.resize(awarded, 120))
        found = of_runs(world, streams, replace(course, awarded=turns))
        assert found.late.tolist() == [1.0]
        assert found.regret.tolist() == [0.0]
        assert found.served.tolist() == [served]


def test_agent_without_matching_scenes_is_not_starved():
    streams = draw(PAPER, [1], 120)
    course = simulate(PAPER, Arm(), streams)
    streams.scene[:, -LAST:] = 0
    course = replace(course, awarded=np.zeros_like(course.awarded))
    assert of_runs(PAPER, streams, course).served.all()


def test_shorter_run_is_prefix_of_longer_run():
    for world, wrong in ((PAPER, "another"), (PERSONS, "any")):
        short, long = (draw(world, [5, 9], rounds, wrong) for rounds in (7, 20))
        for name in ("scene", "error_draw", "wrong", "wrong_fit", "mood_noise", "ties"):
            assert np.array_equal(getattr(short, name), getattr(long, name)[:, :7]), name


def test_seed_draws_stay_the_same_across_versions():
    assert round_rng("epoch/4").random(2).tolist() == [0.2232831641075249, 0.6788254797385785]


def test_random_streams_are_uncorrelated():
    streams = draw(PERSONS, [5], 400)
    kinds = (streams.error_draw, (streams.wrong_fit + 1.0) / 2.0, streams.ties[..., 0])
    table = np.corrcoef([kind.ravel() for kind in kinds])
    assert np.abs(table - np.eye(3)).max() < 0.1


def test_random_ties_starve_an_agent_in_a_third():
    streams = draw(PAPER, range(600), 60)
    found = summary(of_runs(PAPER, streams, simulate(PAPER, Arm(tie_break="random"), streams)))
    assert found.never.low < 1 / 3 < found.never.high
    assert found.starved == found.never


def test_fixed_tie_order_always_starves_in_two_orders():
    starving = []
    for names in permutations("abc"):
        world = told(*names)
        streams = draw(world, range(5), 120)
        found = summary(of_runs(world, streams, simulate(world, Arm(tie_break="name"), streams)))
        assert found.never.share in (0.0, 1.0)
        if found.never.share:
            starving.append("".join(names))
    # The agent for [5, 5, 5] is the last of them.
    assert starving == ["abc", "bac"]


def test_share_interval_is_wilson_interval():
    # Table I of Newcombe, "Two-sided confidence intervals for the single proportion", 1998.
    for hits, runs, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605)):
        found = wilson(hits, runs)
        assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert wilson(0, 20).low == 0.0
    highs = wilson(0, 20).high, wilson(1, 29).high
    assert highs == pytest.approx((0.1611, 0.1718), abs=5e-5)
