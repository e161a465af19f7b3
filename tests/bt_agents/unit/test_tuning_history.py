# SPDX-License-Identifier: Apache-2.0
"""Undo and redo: the next step, conflicts, and bounds."""

from __future__ import annotations

import pytest

from bt_agents.host.tuning.history import MOST_CHANGES, MOST_REVISIONS
from bt_agents_core.errors import Refused
from tuning_desk import Desk


def test_new_change_clears_redo():
    desk = Desk({"a.x": 1, "b.x": 1})
    desk.set({"a.x": 2})
    desk.undo()
    desk.set({"b.x": 2})
    with pytest.raises(Refused, match="NOTHING_TO_REDO: no change to redo"):
        desk.redo()


@pytest.mark.parametrize("word", ["undo", "redo"])
def test_undo_and_redo_refuse_when_empty(word):
    with pytest.raises(Refused, match=f"NOTHING_TO_{word.upper()}: no change of a to {word}"):
        getattr(Desk({"a.x": 1}), word)("a")


def test_change_with_later_dependents_cannot_be_undone():
    desk = Desk({"a.x": 1, "b.x": 1})
    desk.set({"a.x": 2, "b.x": 2})
    desk.set({"b.x": 3})
    with pytest.raises(Refused, match=r"revision 1 has to wait: b\.x was changed after it"):
        desk.undo("a")
    desk.undo("b")
    desk.undo("a")
    assert desk.values == {"a.x": 1, "b.x": 1}


def test_impossible_undo_is_skipped_and_named():
    desk = Desk({"a.x": 1, "b.x": 1})
    desk.set({"b.x": 2})
    desk.set({"a.x": 2})
    desk.impossible = {"a.x"}
    assert desk.undo() == 1
    with pytest.raises(Refused, match=r"revision 2 cannot be: its value of a\.x is not possible"):
        desk.undo()
    desk.impossible = set()
    assert desk.undo() == 2


def test_tick_rate_belongs_to_no_agent():
    desk = Desk({"tick_rate": 20.0})
    desk.set({"tick_rate": 30.0})
    with pytest.raises(Refused, match="NOTHING_TO_UNDO"):
        desk.undo("tick_rate")
    assert (desk.undo(), desk.values) == (1, {"tick_rate": 20.0})


def test_history_of_ten_thousand_changes_is_bounded():
    desk = Desk({"a.x": 0})
    for value in range(1, 10_001):
        desk.set({"a.x": value})
    assert desk.history.revision == 10_000
    assert len(desk.history.undoable) == len(desk.history.shown) == MOST_REVISIONS
    for _ in range(MOST_REVISIONS):
        desk.undo()
    assert desk.values == {"a.x": 10_000 - MOST_REVISIONS}
    with pytest.raises(Refused):
        desk.undo()


def test_large_revisions_are_bounded_except_the_last():
    desk = Desk({f"a.x{number}": 0 for number in range(MOST_CHANGES + 1)})
    desk.set({"a.x1": 1})
    desk.set({f"a.x{number}": 2 for number in range(MOST_CHANGES + 1)})
    assert [one.number for one in desk.history.undoable] == [2]
    desk.set({"a.x1": 3})
    assert [one.number for one in desk.history.undoable] == [3]
