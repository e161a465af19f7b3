# SPDX-License-Identifier: Apache-2.0
"""Documents with steps of other robots, as the feedback node imports them."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from feedback_node.learning import profiles as profiles_module
from feedback_node.ledger import Ledger
from feedback_node.management.fleet_documents import MOST_STEPS, refusals_of
from feedback_node.management.management import ManagementAction
from simulated_fleet import Clock, Robot, largest_difference


@pytest.fixture
def robots() -> tuple[Robot, Robot]:
    clock = Clock()
    return Robot("anna", clock), Robot("ben", clock)


def document(**fields: Any) -> str:
    usual = {"format": 1, "kind": "fleet", "robot": "ben", "agents": [], "steps": []}
    return json.dumps({**usual, **fields})


def take(robot: Robot, steps: list[Any]) -> list[str]:
    answer = robot.manage(ManagementAction.IMPORT, document=document(steps=steps))
    return [one["code"] for one in refusals_of(answer.document)]


@pytest.mark.parametrize(
    "fields",
    [
        {"format": 2},
        {"robot": "Ben"},
        {"robot": 7},
        {"agents": "guide"},
        {"agents": [7]},
        {"agents": ["guide"] * 1001},
        {"steps": {}},
        {"steps": [{}] * (MOST_STEPS + 1)},
    ],
)
def test_invalid_document_is_rejected_as_a_whole(robots, fields):
    before = robots[1].ledger.entries()
    with pytest.raises(Refused, match="BAD_DOCUMENT"):
        robots[1].manage(ManagementAction.IMPORT, document=document(**fields))
    assert robots[1].ledger.entries() == before


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"robot": "ben"}, "OWN_STEP"),
        ({"robot": "../anna"}, "BAD_STEP"),
        ({"number": 0}, "BAD_STEP"),
        ({"number": True}, "BAD_STEP"),
        ({"number": 2**63}, "BAD_STEP"),
        ({"agent": "nobody"}, "UNKNOWN_AGENT"),
        ({"agent": "x" * 201}, "BAD_STEP"),
        ({"agent": "a\nb"}, "BAD_STEP"),
        ({"layer": "person/anna"}, "NOT_SHARED"),
        ({"layer": "cellar"}, "BAD_LAYER"),
        ({"base": "0" * 16}, "OTHER_BASE"),
        ({"base": "zz"}, "BAD_STEP"),
        ({"event": "set"}, "BAD_STEP"),
        ({"kind": 7}, "BAD_STEP"),
        ({"target": {}}, "BAD_STEP"),
        ({"target": {"age": "5"}}, "BAD_STEP"),
        ({"target": {"age": 10**400}}, "BAD_STEP"),
        ({"target": {"size": 5}}, "UNKNOWN_PARAMETER"),
        ({"target": {"age": 9}}, "OUT_OF_RANGE"),
        ({"target": dict.fromkeys(map(str, range(101)), 1)}, "BAD_STEP"),
        ({"weight": -1}, "BAD_STEP"),
        ({"weight": 1e9}, "BAD_STEP"),
        ({"changes": -1}, "BAD_STEP"),
        ({"arrival": -1}, "BAD_STEP"),
        ({"stamp": 1e12}, "FROM_THE_FUTURE"),
        ({"reason": "Anna said so"}, "BAD_STEP"),
    ],
)
def test_invalid_step_is_rejected_and_others_are_imported(robots, change, code):
    anna, ben = robots
    anna.teach()
    anna.teach()
    first, second = (one.fields() for one in anna.steps())
    assert take(ben, [{**first, **change}, second]) == [code]
    rows = ben.ledger.history("guide")[1:]
    assert [row.cause.feedback_id for row in rows] == [f"fleet/anna/{second['number']}"]


def test_step_must_be_a_mapping(robots):
    assert take(robots[1], [None, 7, "x", [], {}]) == ["BAD_STEP"] * 5


def test_steps_exceeding_layer_limit_are_rejected(robots, monkeypatch):
    anna, ben = robots
    anna.teach(place="lobby")
    monkeypatch.setattr(profiles_module, "MOST_LAYERS", 0)
    assert set(take(ben, [one.fields() for one in anna.steps()])) == {"TOO_MANY_LAYERS"}
    assert ben.current()[""] == anna.current()[""]


@pytest.mark.parametrize("taught_later", [False, True])
def test_forgotten_layer_loses_only_earlier_steps(robots, taught_later):
    anna, ben = robots
    anna.teach(place="lobby")
    earlier = anna.steps()
    ben.take(earlier)
    anna.forget("place/lobby")
    ben.clock.now += 60.0
    if taught_later:
        ben.teach(place="lobby")
    assert ben.take(anna.steps()) == []
    assert ("place/lobby" in ben.current()) == taught_later
    cleo = Robot("cleo", ben.clock)
    cleo.take(anna.steps())
    assert {one["code"] for one in cleo.take(earlier)} == {"FORGOTTEN"}


def test_imported_steps_survive_restart_in_same_order(tmp_path):
    clock = Clock()
    path = str(tmp_path / "ledger.sqlite")
    anna, ben = Robot("anna", clock), Robot("ben", clock, path=path)
    anna.teach(place="lobby")
    ben.take(anna.steps())
    ben.ledger.close()
    clock.now += 1.0
    anna.teach(place="lobby")
    again = Robot("ben", clock, path=path)
    again.take(anna.steps())
    assert largest_difference([anna, again]) == 0.0
    again.ledger.close()
    Ledger(path).close()  # It checks every row.


def test_document_with_repeated_steps_is_one_update(robots):
    anna, ben = robots
    for _ in range(3):
        anna.teach()
    steps = [one.fields() for one in anna.steps()]
    done = ben.manage(ManagementAction.IMPORT, document=document(steps=steps * 2))
    assert refusals_of(done.document) == []
    assert len(ben.ledger.history("guide")) == 1 + 3
    [change] = done.changes
    assert (change.revision.cause.source, change.text) == ("anna", "age 3 → 4.314")


def test_answer_without_fleet_support_is_rejected():
    for answer in ("", "[]", '{"format": 1}'):
        with pytest.raises(Refused, match="OTHER_VERSION"):
            refusals_of(answer)
