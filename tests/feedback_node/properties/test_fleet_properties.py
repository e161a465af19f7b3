# SPDX-License-Identifier: Apache-2.0
"""Laws of a fleet that learns together: profiles depend on the steps, not on their order."""

from __future__ import annotations

import contextlib
import math
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from feedback_node.learning.fleet_steps import StepEvent
from feedback_node.ledger.rows import hidden_layer
from feedback_node.management.management import ManagementAction
from simulated_fleet import Clock, Robot, largest_difference, learning

NAMES = ("anna", "ben", "cleo")

rules = st.sampled_from(
    [
        learning(),
        learning(anneal=0.5),
        learning(anneal=0.5, layers=("person", "place")),
        learning(update="huber"),
        learning(update="median", general=1.0),
        learning(drift=(0.5, 1.0), retreat=(1.5, math.nan)),
    ]
)
values = st.one_of(st.just(math.nan), st.floats(1.0, 5.0))
events = st.one_of(
    st.tuples(
        st.just("teach"),
        st.sampled_from(FeedbackKind),
        st.tuples(values, st.floats(1.0, 5.0)),
        st.sampled_from(["", "", "lobby", "hall"]),
        st.sampled_from(["", "", "anna"]),
    ),
    st.tuples(st.sampled_from(["undo", "reset", "meet"])),
    st.tuples(st.just("forget"), st.sampled_from(["place/lobby", "person/anna"])),
)
acts = st.tuples(st.integers(0, len(NAMES) - 1), st.sampled_from([0.0, 0.5, 60.0]), events)


def perform(robots: list[Robot], who: int, event: tuple[Any, ...]) -> None:
    robot = robots[who]
    if event[0] == "teach":
        _, kind, vector, place, person = event
        robot.teach(kind, vector, place=place, person=person)
    elif event[0] == "meet":
        robot.take([step for other in robots if other is not robot for step in other.steps()])
    elif event[0] == "forget":
        with contextlib.suppress(Refused):
            robot.forget(event[1])
    elif event[0] == "reset":
        robot.manage(ManagementAction.RESET, agent="guide")
    else:
        with contextlib.suppress(Refused):
            robot.manage(ManagementAction.UNDO, agent="guide")


def lived(course: list[tuple[Any, ...]], *names: str, **fields: Any) -> list[Robot]:
    """Return robots after a course of events."""
    clock = Clock()
    robots = [Robot(name, clock, **fields) for name in names]
    for who, later_s, event in course:
        clock.now += later_s
        perform(robots, who % len(robots), event)
    return robots


@settings(max_examples=60, deadline=None)
@given(rules, st.lists(acts, max_size=25), st.randoms(use_true_random=False))
def test_profiles_depend_on_steps_not_on_their_order(rule, course, random):
    robots = lived(course, *NAMES, rule=rule)
    everything = [step for robot in robots for step in robot.steps()]
    for robot in robots:
        others = [step for step in everything if step.robot != robot.name]
        random.shuffle(others)
        half = len(others) // 2
        for part in (others[:half], others[half // 2 :]):
            assert {one["code"] for one in robot.take(part)} <= {"FORGOTTEN"}
    assert largest_difference(robots) <= 1e-9
    forgettings = [step for step in everything if step.event is StepEvent.FORGET]
    later = [
        step
        for step in everything
        if not any(
            step.key < end.key and hidden_layer(step.layer) == end.layer for end in forgettings
        )
    ]
    newcomer = Robot("dora", robots[0].clock, rule=rule)
    assert newcomer.take(later) == []
    assert largest_difference([*robots, newcomer]) <= 1e-9


@settings(max_examples=40, deadline=None)
@given(rules, st.lists(acts, max_size=20))
def test_fleet_order_does_not_move_single_robot(rule, course):
    [robot] = lived(course, "anna", rule=rule)
    other = Robot("ben", robot.clock, rule=rule)
    before = robot.current()
    other.take(robot.steps())
    robot.take([])
    assert robot.current() == before
    shared = {layer for layer in before if any(s.layer == layer for s in robot.steps())}
    for layer in shared:
        assert other.current()[layer] == before[layer]


def test_median_after_undo_is_same_everywhere():
    robots = [Robot(name, Clock(), rule=learning(update="median")) for name in NAMES]
    for age in (2.0, 1.0, None, 1.0):
        if age is None:
            robots[0].manage(ManagementAction.UNDO, agent="guide")
        else:
            robots[0].teach(FeedbackKind.DIRECT, (math.nan, age))
    for robot in robots[1:]:
        robot.take(robots[0].steps())
    assert largest_difference(robots) <= 1e-9


@settings(max_examples=30, deadline=None)
@given(st.lists(acts, max_size=15), st.integers(1, 3))
def test_repeated_steps_are_taken_once(course, times):
    robots = lived(course, *NAMES)
    steps = [step for robot in robots[1:] for step in robot.steps()]
    robots[0].take(steps)
    after = len(robots[0].ledger.entries())
    for _ in range(times):
        robots[0].take(steps)
    assert len(robots[0].ledger.entries()) == after
