# SPDX-License-Identifier: Apache-2.0
"""Prepared feedback: given in order, including the first row."""

from __future__ import annotations

from bt_agents_language.model.experiment import FeedbackErrors, PreparedFeedback
from feedback_node.simulated_feedback import SimulatedFeedback
from scene_spaces import AGE_AND_MOOD as SPACE

A, B = (1.0, 1.0), (5.0, 5.0)
C = (3.0, 3.0)
WRONG = (2.0, 2.0)


def test_sequence_is_used_in_order_for_any_agent():
    simulated = SimulatedFeedback(PreparedFeedback(sequence=(A, B)))
    assert [simulated.next(agent) for agent in ("one", "two", "one")] == [A, B, None]


def test_repeated_sequence_starts_again():
    simulated = SimulatedFeedback(PreparedFeedback(sequence=(A, B), repeat=True))
    assert [simulated.next("one") for _ in range(5)] == [A, B, A, B, A]


def test_agent_with_own_vector_uses_no_row():
    simulated = SimulatedFeedback(PreparedFeedback(each={"one": B}, sequence=(A,)))
    assert [simulated.next(agent) for agent in ("one", "one", "two", "one")] == [B, B, A, B]


def test_agent_with_own_list_uses_only_that_list():
    simulated = SimulatedFeedback(PreparedFeedback(sequences={"one": (A, B)}, sequence=(C,)))
    ran = ("one", "two", "one", "one", "two")
    assert [simulated.next(agent) for agent in ran] == [A, C, B, None, None]


def test_repeated_lists_start_again_independently():
    simulated = SimulatedFeedback(
        PreparedFeedback(sequences={"one": (A, B), "two": (C,)}, repeat=True)
    )
    ran = ("one", "two", "one", "two", "one", "three")
    assert [simulated.next(agent) for agent in ran] == [A, C, B, C, A, None]


def test_list_continues_after_restart():
    simulated = SimulatedFeedback(PreparedFeedback(each={"one": B}, sequence=(A, B), repeat=True))
    simulated.resume({"one": 7, "two": 2, "three": 1})
    assert [simulated.next("two") for _ in range(2)] == [B, A]
    ended = SimulatedFeedback(PreparedFeedback(sequence=(A, B)))
    ended.resume({"two": 2})
    assert ended.next("two") is None


def test_empty_preparation_gives_no_feedback_even_when_repeated():
    assert SimulatedFeedback(PreparedFeedback(repeat=True)).next("one") is None


def test_every_third_feedback_is_wrong_for_any_agent():
    errors = FeedbackErrors(space=SPACE, seed=1, every=3, value=WRONG)
    simulated = SimulatedFeedback(PreparedFeedback(each={"one": A, "two": B}, errors=errors))
    given = [simulated.next(agent) for agent in ("one", "two", "one", "two", "one", "one")]
    assert given == [A, B, WRONG, B, A, WRONG]


def test_random_errors_are_reproducible_after_restart():
    def simulated():
        return SimulatedFeedback(
            PreparedFeedback(
                each={"one": A}, errors=FeedbackErrors(space=SPACE, seed=3, share=0.3)
            )
        )

    whole = simulated()
    given = [whole.next("one") for _ in range(400)]
    wrong = [vector for vector in given if vector != A]
    assert 0.23 < len(wrong) / len(given) < 0.37
    assert all(1.0 <= value <= 5.0 for vector in wrong for value in vector)
    assert len(set(wrong)) == len(wrong)
    later = simulated()
    later.resume({"one": 150})
    assert [later.next("one") for _ in range(250)] == given[150:]


def test_missing_feedback_is_not_counted():
    errors = FeedbackErrors(space=SPACE, seed=1, every=2, value=WRONG)
    simulated = SimulatedFeedback(PreparedFeedback(each={"one": A}, errors=errors))
    given = [simulated.next(agent) for agent in ("one", "nobody", "one")]
    assert given == [A, None, WRONG]
