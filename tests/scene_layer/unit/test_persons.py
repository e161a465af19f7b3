# SPDX-License-Identifier: Apache-2.0
"""Tracked persons and the addressee of a scene: gaps and short leads change nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy
import pytest

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import Refused
from bt_agents_language.model.scene_specs import (
    AddresseeRule,
    AddresseeSpec,
    PersonsSpec,
    TrackedSpec,
)
from scene_layer.persons import LONGEST_ID, MOST_PERSONS, NOBODY, Persons, check_id

HERE = Position(file="scene.yaml", line=1, column=1)


def persons(rule: str = "first") -> Persons:
    tracked = TrackedSpec(
        topic="tracked",
        type="bt_agents_interfaces/msg/PersonIds",
        field="ids",
        stale_after_s=3.0,
        lost_after_s=0.5,
        position=HERE,
    )
    addressee = AddresseeSpec(rule=AddresseeRule(rule), better_by=0.2, hold_s=1.0)
    return Persons(PersonsSpec(tracked=tracked, addressee=addressee))


def see(crowd: Persons, ids: Iterable[str], ranks: dict[str, float], now: float) -> None:
    """Receive the tracked persons and their ranks of one moment."""
    crowd.receive_ids(ids, now)
    crowd.update(ranks, now)


Step = tuple[float, str | None, dict[str, float], str]
"""Time [s], the persons in a message of that time, ranks, and the addressee after it."""


@pytest.mark.parametrize(
    ("rule", "steps"),
    [
        pytest.param(
            "first",
            [
                (0.0, "", {}, NOBODY),
                (1.0, "a", {}, "a"),
                (2.0, "b a", {}, "a"),
                (3.0, "b c", {}, "a"),
                (3.5, "b c", {}, "b"),
                (9.0, None, {}, NOBODY),
            ],
            id="who came first, then the next one",
        ),
        pytest.param(
            "nearest",
            [
                (0.0, "a b", {"a": 2.0, "b": 1.0}, "b"),
                (1.0, "a b", {"a": 0.9, "b": 1.0}, "b"),
                (5.0, "a b", {"a": 0.5, "b": 1.0}, "b"),
                (5.9, "a b", {"a": 0.5, "b": 1.0}, "b"),
                (6.0, "a b", {"a": 0.5, "b": 1.0}, "a"),
            ],
            id="nearer by enough and for long enough",
        ),
        pytest.param(
            "nearest",
            [
                (0.0, "a b", {"a": 1.0, "b": 2.0}, "a"),
                (2.0, "a b", {"a": 1.0, "b": 0.5}, "a"),
                (2.8, "a b", {"a": 1.0, "b": 0.9}, "a"),
                (3.1, "a b", {"a": 1.0, "b": 0.5}, "a"),
                (4.0, "a b", {"a": 1.0, "b": 0.5}, "a"),
                (4.2, "a b", {"a": 1.0, "b": 0.5}, "b"),
            ],
            id="a moment that is not better begins the time anew",
        ),
        pytest.param(
            "engaged",
            [
                (0.0, "a b", {"a": 0.1, "b": 0.9}, "b"),
                (2.0, "a b", {"a": 0.9, "b": 0.1}, "b"),
                (3.0, "a b", {"a": 0.9, "b": 0.1}, "a"),
            ],
            id="more engaged is more",
        ),
        pytest.param(
            "engaged",
            [
                (0.0, "a b", {}, "a"),
                (2.0, "a b", {"b": 0.1}, "a"),
                (3.0, "a b", {"b": 0.1}, "b"),
                (9.0, "a b", {"b": math.nan}, "b"),
            ],
            id="unknown is the least, and of equals the first",
        ),
        pytest.param(
            "engaged",
            [
                (0.0, "a b", {"a": 0.9, "b": 0.1}, "a"),
                (2.0, "b", {"b": 0.1}, "a"),
                (2.4, "a b", {"a": 0.9}, "a"),
                (3.0, "b", {}, "a"),
                (3.5, "b", {}, "b"),
            ],
            id="a gap in the tracking loses nobody",
        ),
        pytest.param(
            "first",
            [
                (0.0, "a b", {}, "a"),
                (0.1, "b", {}, "a"),
                (0.6, "b", {}, NOBODY),
                (0.9, "b", {}, NOBODY),
                (1.0, "b", {}, "b"),
            ],
            id="somebody else only after the hold time",
        ),
        pytest.param(
            "first",
            [
                (0.0, "a b", {}, "a"),
                (0.1, "b", {}, "a"),
                (0.6, "b", {}, NOBODY),
                (0.7, "a b", {}, "a"),
            ],
            id="who comes back is taken at once",
        ),
        pytest.param(
            "first",
            [
                (0.0, "a", {}, "a"),
                (3.0, None, {}, "a"),
                (3.1, None, {}, NOBODY),
                (3.2, "b", {}, "b"),
            ],
            id="a silent tracker sees nobody",
        ),
        pytest.param(
            "nearest",
            [
                (0.0, "a", {}, "a"),
                (2.0, "a b", {"b": 0.5}, "a"),
                (2.9, "a b c", {"b": 0.5, "c": 0.3}, "a"),
                (3.0, "a b c", {"b": 0.5, "c": 0.3}, "b"),
                (3.2, "a b c", {"b": 0.6, "c": 0.3}, "b"),
                (4.1, "a b c", {"b": 0.6, "c": 0.3}, "b"),
                (4.3, "a b c", {"b": 0.6, "c": 0.3}, "c"),
            ],
            id="a late comer has to be better for as long",
        ),
        pytest.param(
            "nearest",
            [
                (0.0, "a", {}, "a"),
                (2.0, "a b c", {"b": 0.5, "c": 0.5}, "a"),
                (3.0, "a b c", {"b": 0.5, "c": 0.3}, "c"),
            ],
            id="the best of all who have been better for long enough",
        ),
        pytest.param(
            "nearest",
            [
                (0.0, "a b", {"a": 1.0, "b": 2.0}, "a"),
                (2.1, "a b", {"a": 1.0, "b": 0.5}, "a"),
                (3.0, "a b c", {"a": 1.0, "b": 2.0, "c": 0.4}, "a"),
                (3.1, "a b c", {"a": 1.0, "b": 2.0, "c": 0.4}, "a"),
                (4.1, "a b c", {"a": 1.0, "b": 2.0, "c": 0.4}, "c"),
            ],
            id="one person's lead is not another's",
        ),
    ],
)
def test_addressee_follows_the_rule(rule: str, steps: list[Step]) -> None:
    crowd = persons(rule)
    for now, ids, ranks, expected in steps:
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
    crowd = persons(rule)
    see(crowd, ids.split(), ranks, 0.0)
    assert crowd.reason == words


def test_switch_and_loss_have_a_reason():
    crowd = persons("nearest")
    for now in (0.0, 2.0, 3.0):
        see(crowd, ["anna", "ben"], {"anna": 1.0, "ben": 1.5 if now < 1.0 else 0.5}, now)
    assert crowd.reason == "ben has been nearer than anna for 1 s"
    crowd.receive_ids([], 3.5)
    crowd.update({}, 4.0)
    assert (crowd.addressee, crowd.reason) == (NOBODY, "ben is gone")


def test_arrivals_and_departures_are_reported_once():
    crowd = persons()
    told = []
    for now, ids in [(0.0, "a b"), (0.1, "a b"), (0.2, "b"), (0.4, "b c"), (0.7, "b c")]:
        crowd.receive_ids(ids.split(), now)
        came, gone = crowd.update({}, now)
        told.append((" ".join(came), " ".join(gone)))
    assert told == [("a b", ""), ("", ""), ("", ""), ("c", ""), ("", "a")]
    assert crowd.tracked == ("b", "c")


def test_tracker_ids_may_be_numbers():
    assert [check_id(7), check_id(numpy.uint64(2**64 - 1))] == ["7", str(2**64 - 1)]


def test_tracked_persons_take_precedence_over_new_ones():
    crowd = persons()
    see(crowd, ["anna"], {}, 0.0)
    others = [f"p{number}" for number in range(2 * MOST_PERSONS)]
    see(crowd, [*others, "anna"], {}, 1.0)
    crowd.update({}, 1.6)
    assert crowd.addressee == "anna"
    assert len(crowd.tracked) == MOST_PERSONS


@pytest.mark.parametrize(
    ("hostile", "code"),
    [
        ("", "EMPTY"),
        ("x" * 10_000, "TOO_LONG"),
        (7.5, "NOT_A_TEXT"),
        (True, "NOT_A_TEXT"),
        ([], "NOT_A_TEXT"),
        (None, "NOT_A_TEXT"),
        ("a\nb", "BAD_TEXT"),
        ("a\x00b", "BAD_TEXT"),
        (" a", "BAD_TEXT"),
        ("\u202eanna", "BAD_TEXT"),
    ],
)
def test_hostile_id_is_rejected_and_others_count(hostile, code):
    with pytest.raises(Refused) as refused:
        check_id(hostile)
    assert refused.value.code == code
    assert len(refused.value.reason) < 300
    crowd = persons()
    problem = crowd.receive_ids(["anna", hostile, "ben"], 0.0)
    assert problem is not None
    assert problem.code == code
    crowd.update({}, 0.0)
    assert crowd.tracked == ("anna", "ben")


@pytest.mark.parametrize("usual", ["a", "anna/b", "Anna Müller", "42", "x" * LONGEST_ID])
def test_any_other_text_is_an_id(usual):
    assert check_id(usual) == usual


def test_duplicate_id_is_one_person():
    crowd = persons()
    problem = crowd.receive_ids(["a", "b", "a"], 0.0)
    assert problem is not None
    assert problem.code == "DUPLICATE"
    crowd.update({}, 0.0)
    assert crowd.tracked == ("a", "b")


def test_first_of_ten_thousand_persons_are_tracked():
    crowd = persons()
    see(crowd, ["anna"], {}, 0.0)
    many = [f"p{number}" for number in range(10_000)]
    problem = crowd.receive_ids([*many, "anna"], 0.1)
    assert problem is not None
    assert problem.code == "TOO_MANY"
    crowd.update({}, 0.1)
    assert crowd.tracked == ("anna", *many[: MOST_PERSONS - 1])
    see(crowd, reversed([*many, "anna"]), {}, 0.2)
    assert len(crowd.tracked) == MOST_PERSONS
    assert crowd.addressee == "anna"
