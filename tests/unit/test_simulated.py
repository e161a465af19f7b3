# SPDX-License-Identifier: Apache-2.0
"""Prepared feedback is handed out in order, the first row too."""

from __future__ import annotations

from bt_agents.simulated import SimulatedFeedback

A, B = (1.0, 1.0), (5.0, 5.0)


def test_the_sequence_is_used_in_order_from_its_first_row_for_whoever_ran():
    simulated = SimulatedFeedback(sequence=(A, B))
    assert [simulated.next(agent) for agent in ("one", "two", "one")] == [A, B, None]


def test_a_repeated_sequence_starts_again():
    simulated = SimulatedFeedback(sequence=(A, B), repeat=True)
    assert [simulated.next("one") for _ in range(5)] == [A, B, A, B, A]


def test_an_agent_with_its_own_vector_always_gets_it_and_uses_up_no_row():
    simulated = SimulatedFeedback(each={"one": B}, sequence=(A,))
    assert [simulated.next(agent) for agent in ("one", "one", "two", "one")] == [B, B, A, B]


def test_a_list_goes_on_after_what_was_given_before_a_restart():
    simulated = SimulatedFeedback(each={"one": B}, sequence=(A, B), repeat=True)
    simulated.resume({"one": 7, "two": 2, "three": 1})
    assert [simulated.next("two") for _ in range(2)] == [B, A]
    ended = SimulatedFeedback(sequence=(A, B))
    ended.resume({"two": 2})
    assert ended.next("two") is None


def test_nothing_prepared_is_no_feedback_even_when_repeated():
    assert SimulatedFeedback(repeat=True).next("one") is None
