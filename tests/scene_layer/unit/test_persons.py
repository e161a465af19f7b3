# SPDX-License-Identifier: Apache-2.0
"""Tracked persons and the addressee of a scene: gaps and short leads change nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy
import pytest

from bt_agents_core.errors import Refused
from bt_agents_language.model.scene_specs import AddresseeRule
from scene_layer.persons import LONGEST_ID, MOST_PERSONS, NOBODY, Persons, check_id
from scene_layer_harness import persons_of


@pytest.fixture
def crowd() -> Persons:
    return persons_of(AddresseeRule.FIRST)


def see(crowd: Persons, ids: Iterable[object], ranks: dict[str, float], now: float) -> str:
    """Receive the tracked persons of one moment and their ranks; return the refusal's code."""
    problem = crowd.receive_ids(ids, now)
    crowd.update(ranks, now)
    return problem.code if problem is not None else ""


Step = tuple[float, str | None, dict[str, float], str]
"""Time [s], the persons in a message of that time, ranks, and the addressee after it."""


STORIES: dict[tuple[str, str], list[Step]] = {
    ("first", "who came first, then the next one"): [
        (0.0, "", {}, NOBODY),
        (1.0, "a", {}, "a"),
        (2.0, "b a", {}, "a"),
        (3.0, "b c", {}, "a"),
        (3.5, "b c", {}, "b"),
        (9.0, None, {}, NOBODY),
    ],
    ("nearest", "nearer by enough and for long enough"): [
        (0.0, "a b", {"a": 2.0, "b": 1.0}, "b"),
        (1.0, "a b", {"a": 0.9, "b": 1.0}, "b"),
        (5.0, "a b", {"a": 0.5, "b": 1.0}, "b"),
        (5.9, "a b", {"a": 0.5, "b": 1.0}, "b"),
        (6.0, "a b", {"a": 0.5, "b": 1.0}, "a"),
    ],
    ("nearest", "a moment that is not better begins the time anew"): [
        (0.0, "a b", {"a": 1.0, "b": 2.0}, "a"),
        (2.0, "a b", {"a": 1.0, "b": 0.5}, "a"),
        (2.8, "a b", {"a": 1.0, "b": 0.9}, "a"),
        (3.1, "a b", {"a": 1.0, "b": 0.5}, "a"),
        (4.0, "a b", {"a": 1.0, "b": 0.5}, "a"),
        (4.2, "a b", {"a": 1.0, "b": 0.5}, "b"),
    ],
    ("engaged", "more engaged is more"): [
        (0.0, "a b", {"a": 0.1, "b": 0.9}, "b"),
        (2.0, "a b", {"a": 0.9, "b": 0.1}, "b"),
        (3.0, "a b", {"a": 0.9, "b": 0.1}, "a"),
    ],
    ("engaged", "unknown is the least, and of equals the first"): [
        (0.0, "a b", {}, "a"),
        (2.0, "a b", {"b": 0.1}, "a"),
        (3.0, "a b", {"b": 0.1}, "b"),
        (9.0, "a b", {"b": math.nan}, "b"),
    ],
    ("engaged", "a gap in the tracking loses nobody"): [
        (0.0, "a b", {"a": 0.9, "b": 0.1}, "a"),
        (2.0, "b", {"b": 0.1}, "a"),
        (2.4, "a b", {"a": 0.9}, "a"),
        (3.0, "b", {}, "a"),
        (3.5, "b", {}, "b"),
    ],
    ("first", "somebody else only after the hold time"): [
        (0.0, "a b", {}, "a"),
        (0.1, "b", {}, "a"),
        (0.6, "b", {}, NOBODY),
        (0.9, "b", {}, NOBODY),
        (1.0, "b", {}, "b"),
    ],
    ("first", "who comes back is taken at once"): [
        (0.0, "a b", {}, "a"),
        (0.1, "b", {}, "a"),
        (0.6, "b", {}, NOBODY),
        (0.7, "a b", {}, "a"),
    ],
    ("first", "a silent tracker sees nobody"): [
        (0.0, "a", {}, "a"),
        (3.0, None, {}, "a"),
        (3.1, None, {}, NOBODY),
        (3.2, "b", {}, "b"),
    ],
    ("nearest", "a late comer has to be better for as long"): [
        (0.0, "a", {}, "a"),
        (2.0, "a b", {"b": 0.5}, "a"),
        (2.9, "a b c", {"b": 0.5, "c": 0.3}, "a"),
        (3.0, "a b c", {"b": 0.5, "c": 0.3}, "b"),
        (3.2, "a b c", {"b": 0.6, "c": 0.3}, "b"),
        (4.1, "a b c", {"b": 0.6, "c": 0.3}, "b"),
        (4.3, "a b c", {"b": 0.6, "c": 0.3}, "c"),
    ],
    ("nearest", "the best of all who have been better for long enough"): [
        (0.0, "a", {}, "a"),
        (2.0, "a b c", {"b": 0.5, "c": 0.5}, "a"),
        (3.0, "a b c", {"b": 0.5, "c": 0.3}, "c"),
    ],
}


@pytest.mark.parametrize(("rule", "story"), STORIES)
def test_addressee_follows_the_rule(rule: str, story: str) -> None:
    crowd = persons_of(AddresseeRule(rule))
    for now, ids, ranks, expected in STORIES[rule, story]:
        if ids is not None:
            crowd.receive_ids(ids.split(), now)
        crowd.update(ranks, now)
        assert (now, crowd.addressee) == (now, expected)


@pytest.mark.parametrize(
    ("rule", "ids", "ranks", "words"),
    [
        ("first", "anna ben", {}, "anna came first"),
        ("nearest", "anna", {"anna": 1.0}, "anna is the only one"),
        ("nearest", "anna ben", {"anna": 2.0, "ben": 0.8}, "ben is nearest: 0.8 m"),
        ("engaged", "anna ben", {"anna": 0.4, "ben": 0.75}, "ben is most engaged: 0.75"),
        ("engaged", "", {}, "nobody is there"),
    ],
)
def test_addressee_reason_is_readable(rule, ids, ranks, words):
    crowd = persons_of(AddresseeRule(rule))
    see(crowd, ids.split(), ranks, 0.0)
    assert crowd.reason == words


def test_switch_and_loss_have_a_reason():
    crowd = persons_of(AddresseeRule.NEAREST)
    for now in (0.0, 2.0, 3.0):
        see(crowd, ["anna", "ben"], {"anna": 1.0, "ben": 1.5 if now < 1.0 else 0.5}, now)
    assert crowd.reason == "ben has been nearer than anna for 1 s"
    crowd.receive_ids([], 3.5)
    crowd.update({}, 4.0)
    assert (crowd.addressee, crowd.reason) == (NOBODY, "ben is gone")


def test_arrivals_and_departures_are_reported_once(crowd):
    told = []
    for now, ids in [(0.0, "a b"), (0.1, "a b"), (0.2, "b"), (0.4, "b c"), (0.7, "b c")]:
        crowd.receive_ids(ids.split(), now)
        came, gone = crowd.update({}, now)
        told.append((" ".join(came), " ".join(gone)))
    assert told == [("a b", ""), ("", ""), ("", ""), ("c", ""), ("", "a")]
    assert crowd.tracked == ("b", "c")


@pytest.mark.parametrize(
    ("hostile", "code"),
    [
        ("", "EMPTY"),
        ("x" * 10_000, "TOO_LONG"),
        (7.5, "NOT_A_TEXT"),
        (True, "NOT_A_TEXT"),
        ([], "NOT_A_TEXT"),
        ("a\nb", "BAD_TEXT"),
        ("a\x00b", "BAD_TEXT"),
        (" a", "BAD_TEXT"),
        ("\u202eanna", "BAD_TEXT"),
    ],
)
def test_hostile_id_is_rejected_and_others_count(crowd, hostile, code):
    with pytest.raises(Refused) as refused:
        check_id(hostile)
    assert refused.value.code == code
    assert len(refused.value.reason) < 300
    assert see(crowd, ["anna", hostile, "ben"], {}, 0.0) == code
    assert crowd.tracked == ("anna", "ben")


def test_duplicate_id_is_one_person(crowd):
    assert see(crowd, ["a", "b", "a"], {}, 0.0) == "DUPLICATE"
    assert crowd.tracked == ("a", "b")


@pytest.mark.parametrize(
    "usual", ["a", "anna/b", "Anna Müller", "42", "x" * LONGEST_ID, 7, numpy.uint64(2**64 - 1)]
)
def test_any_other_text_or_number_is_an_id(usual):
    assert check_id(usual) == str(usual)


def test_first_of_ten_thousand_persons_are_tracked(crowd):
    see(crowd, ["anna"], {}, 0.0)
    many = [f"p{number}" for number in range(10_000)]
    assert see(crowd, [*many, "anna"], {}, 0.1) == "TOO_MANY"
    assert crowd.tracked == ("anna", *many[: MOST_PERSONS - 1])
    see(crowd, reversed([*many, "anna"]), {}, 0.2)
    assert (len(crowd.tracked), crowd.addressee) == (MOST_PERSONS, "anna")
