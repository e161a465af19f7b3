# SPDX-License-Identifier: Apache-2.0
"""Open goals: which messages are accepted, and how texts name goals."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import OpenGoal, name_goals
from bt_agents_core.ros_names import LONGEST_NAME

ID = bytes(range(16))


def test_goal_names_its_action_and_node():
    assert str(OpenGoal(path="tree/1.drive", action="/drive", goal_id=ID)) == (
        "/drive (tree/1.drive)"
    )
    assert str(OpenGoal(path="", action="/robot/drive", goal_id=ID)) == "/robot/drive"


def test_only_first_of_many_goals_are_named():
    goals = [OpenGoal(path="", action=f"/a{number}", goal_id=ID) for number in range(8)]
    assert name_goals(goals) == "/a0, /a1, /a2, /a3, /a4 and 3 more"
    assert name_goals(goals[:2]) == "/a0, /a1"


@pytest.mark.parametrize("goal_id", [bytes(16), b"", ID[:15], ID + b"x"])
def test_zero_or_malformed_goal_id_is_refused(goal_id: bytes):
    with pytest.raises(Refused, match="expected 16 bytes that are not all zero"):
        OpenGoal(path="", action="/drive", goal_id=goal_id)


@pytest.mark.parametrize(
    "action",
    ["", "drive", "/", "/drive/", "/9drive", "/a b", "/\x1b[2J", "/" + "a" * LONGEST_NAME],
)
def test_invalid_action_name_is_refused(action: str):
    with pytest.raises(Refused, match="expected a fully qualified name") as found:
        OpenGoal(path="", action=action, goal_id=ID)
    assert str(found.value).isprintable()


def test_external_path_is_one_short_line():
    goal = OpenGoal(path="tree\n\x1b[2J" + "x" * 1000, action="/drive", goal_id=ID)
    assert goal.path.isprintable()
    assert len(goal.path) <= 200
