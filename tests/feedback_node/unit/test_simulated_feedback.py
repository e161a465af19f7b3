# SPDX-License-Identifier: Apache-2.0
"""Prepared feedback: given in order, including the first row."""

from __future__ import annotations

import pytest

from bt_agents_language.model.experiment import FeedbackErrors, PreparedFeedback
from feedback_node.simulated_feedback import SimulatedFeedback
from scene_spaces import AGE_AND_MOOD as SPACE

A, B, C, WRONG = (1.0, 1.0), (5.0, 5.0), (3.0, 3.0), (2.0, 2.0)
LISTS = {"one": (A, B), "two": (C,)}
SECOND, THIRD = (FeedbackErrors(space=SPACE, seed=1, every=n, value=WRONG) for n in (2, 3))


@pytest.mark.parametrize(
    ("prepared", "ran", "given"),
    [
        ({"sequence": (A, B)}, "one two one", [A, B, None]),
        ({"sequence": (A, B), "repeat": True}, "one one one one one", [A, B, A, B, A]),
        # An agent with a vector or a list of its own uses no row.
        ({"each": {"one": B}, "sequence": (A,)}, "one one two one", [B, B, A, B]),
        ({"sequences": {"one": (A, B)}, "sequence": (C,)}, "one two one one", [A, C, B, None]),
        ({"sequences": LISTS, "repeat": True}, "one two one two one zoe", [A, C, B, C, A, None]),
        ({"repeat": True}, "one", [None]),
        # Errors count the feedback of all agents, without missing feedback.
        (
            {"each": {"one": A, "two": B}, "errors": THIRD},
            "one two one two one one",
            [A, B, WRONG, B, A, WRONG],
        ),
        ({"each": {"one": A}, "errors": SECOND}, "one nobody one", [A, None, WRONG]),
    ],
)
def test_feedback_follows_its_preparation(prepared, ran, given):
    simulated = SimulatedFeedback(PreparedFeedback(**prepared))
    assert [simulated.next(agent) for agent in ran.split()] == given


def test_random_errors_have_their_share_and_differ():
    errors = FeedbackErrors(space=SPACE, seed=3, share=0.3)
    simulated = SimulatedFeedback(PreparedFeedback(each={"one": A}, errors=errors))
    given = [simulated.next("one") for _ in range(400)]
    wrong = [vector for vector in given if vector != A]
    assert 0.23 < len(wrong) / len(given) < 0.37
    assert len(set(wrong)) == len(wrong)
