# SPDX-License-Identifier: Apache-2.0
"""Undo and redo: the next step, conflicts, and bounds."""

from __future__ import annotations

import pytest

from bt_agents.host.tuning.history import (
    MOST_CHANGES,
    MOST_REVISIONS,
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
)
from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import Refused


class Desk:
    """Values and their history, as a host keeps them."""

    def __init__(self, **values: Setting) -> None:
        self.values: dict[str, Setting] = {
            name.replace("_", ".", 1): v for name, v in values.items()
        }
        self.history = TuningHistory()
        self.impossible: set[str] = set()

    def set(self, **values: Setting) -> None:
        self._record(_named(values), TuningCause(author="test"))

    def undo(self, *agents: str) -> int:
        found, values = self.history.find(TuningAction.UNDO, agents, self._possible)
        self._record(values, TuningCause(author="test", action=TuningAction.UNDO, of=found.number))
        return found.number

    def redo(self, *agents: str) -> int:
        found, values = self.history.find(TuningAction.REDO, agents, self._possible)
        self._record(values, TuningCause(author="test", action=TuningAction.REDO, of=found.number))
        return found.number

    def _possible(self, name: str, _value: Setting) -> bool:
        return name not in self.impossible

    def _record(self, values: dict[str, Setting], cause: TuningCause) -> None:
        changes = tuple(
            TuningChange(name=name, before=self.values[name], after=value)
            for name, value in values.items()
        )
        number = self.history.revision + 1
        revision = TuningRevision(number=number, stamp=0.0, cause=cause, changes=changes)
        self.history = self.history.with_revision(revision, dict.fromkeys(values, 0))
        self.values |= values


def _named(values: dict[str, Setting]) -> dict[str, Setting]:
    return {name.replace("_", ".", 1): value for name, value in values.items()}


def test_undo_restores_value_as_a_new_revision():
    desk = Desk(a_x=1)
    desk.set(a_x=2)
    assert desk.undo() == 1
    assert desk.values == {"a.x": 1}
    assert desk.history.revision == 2
    assert [(r.number, c.before, c.after) for r in desk.history.shown for c in r.changes] == [
        (1, 1, 2), (2, 2, 1),
    ]  # fmt: skip


def test_new_change_clears_redo():
    desk = Desk(a_x=1, b_x=1)
    desk.set(a_x=2)
    desk.undo()
    desk.set(b_x=2)
    with pytest.raises(Refused, match="NOTHING_TO_REDO: no change to redo"):
        desk.redo()


@pytest.mark.parametrize("word", ["undo", "redo"])
def test_undo_and_redo_refuse_when_empty(word):
    with pytest.raises(Refused, match=f"NOTHING_TO_{word.upper()}: no change of a to {word}"):
        getattr(Desk(a_x=1), word)("a")


def test_change_with_later_dependents_cannot_be_undone():
    desk = Desk(a_x=1, b_x=1)
    desk.set(a_x=2, b_x=2)
    desk.set(b_x=3)
    with pytest.raises(Refused, match=r"revision 1 has to wait: b\.x was changed after it"):
        desk.undo("a")
    desk.undo("b")
    desk.undo("a")
    assert desk.values == {"a.x": 1, "b.x": 1}


def test_impossible_undo_is_skipped_and_named():
    desk = Desk(a_x=1, b_x=1)
    desk.set(b_x=2)
    desk.set(a_x=2)
    desk.impossible = {"a.x"}
    assert desk.undo() == 1
    with pytest.raises(Refused, match=r"revision 2 cannot be: its value of a\.x is not possible"):
        desk.undo()
    desk.impossible = set()
    assert desk.undo() == 2


def test_tick_rate_belongs_to_no_agent():
    change = TuningChange(name="tick_rate", before=20.0, after=30.0)
    history = TuningHistory().with_revision(
        TuningRevision(number=1, stamp=0.0, cause=TuningCause(author="x"), changes=(change,)),
        {"tick_rate": 20.0},
    )
    with pytest.raises(Refused, match="NOTHING_TO_UNDO"):
        history.find(TuningAction.UNDO, ["tick_rate"], lambda _n, _v: True)
    assert history.find(TuningAction.UNDO, [], lambda _n, _v: True)[1] == {"tick_rate": 20.0}


def test_history_of_ten_thousand_changes_is_bounded():
    desk = Desk(a_x=0)
    for value in range(1, 10_001):
        desk.set(a_x=value)
    assert desk.history.revision == 10_000
    assert len(desk.history.undoable) == len(desk.history.shown) == MOST_REVISIONS
    for _ in range(MOST_REVISIONS):
        desk.undo()
    assert desk.values == {"a.x": 10_000 - MOST_REVISIONS}
    with pytest.raises(Refused):
        desk.undo()


def test_large_revisions_are_bounded_except_the_last():
    desk = Desk(**{f"a_x{number}": 0 for number in range(MOST_CHANGES + 1)})
    desk.set(a_x1=1)
    desk.set(**{f"a_x{number}": 2 for number in range(MOST_CHANGES + 1)})
    assert [one.number for one in desk.history.undoable] == [2]
    desk.set(a_x1=3)
    assert [one.number for one in desk.history.undoable] == [3]
