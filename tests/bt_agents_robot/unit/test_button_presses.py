# SPDX-License-Identifier: Apache-2.0
"""Button presses of a simulated visitor: when they happen, and which are missed."""

from __future__ import annotations

from bt_agents_robot.change_effects import ButtonPresses


def test_due_button_is_pressed_once_someone_listens() -> None:
    listening: set[str] = set()
    presses = ButtonPresses()
    presses.plan("ok", 1.0)
    presses.plan("stop", 1.0)
    assert presses.due(2.0, listening.__contains__) == []
    listening.add("ok")
    assert presses.due(0.9, listening.__contains__) == []
    assert presses.due(2.5, listening.__contains__) == ["ok"]
    assert presses.due(3.0, listening.__contains__) == []
    assert presses.give_up(3.0) == ["stop"]
    assert presses.give_up(3.0) == []


def test_button_planned_twice_is_pressed_once() -> None:
    presses = ButtonPresses()
    presses.plan("ok", 1.0)
    presses.plan("ok", 1.2)
    assert presses.due(1.1, lambda _: True) == ["ok"]
    assert presses.due(9.0, lambda _: True) == []
    presses.plan("ok", 10.0)
    assert presses.due(10.0, lambda _: True) == ["ok"]


def test_button_not_yet_due_is_not_missed() -> None:
    presses = ButtonPresses()
    presses.plan("ok", 1.0)
    assert presses.give_up(0.5) == []
    assert presses.due(2.0, lambda _: True) == []
