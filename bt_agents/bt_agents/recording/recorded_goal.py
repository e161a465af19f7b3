# SPDX-License-Identifier: Apache-2.0
"""Goals that stand still during a step: one that is recorded, and one that is replayed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from bt_agents.engine.environment import GoalRun, GoalState
from bt_agents.recording.format import Entry, initial_goal
from bt_agents.recording.step_log import StepLog
from bt_agents_core.field_types import Plain


class _Fields:
    """The fields of a goal, see :class:`GoalRun`, by their names."""

    def _field(self, name: str) -> Any:
        raise NotImplementedError

    @property
    def state(self) -> GoalState:
        """See :class:`GoalRun`."""
        return cast(GoalState, self._field("state"))

    @property
    def confirmed(self) -> bool:
        """See :class:`GoalRun`."""
        return bool(self._field("confirmed"))

    @property
    def message(self) -> str:
        """See :class:`GoalRun`."""
        return str(self._field("message"))

    @property
    def result(self) -> Mapping[str, Plain]:
        """See :class:`GoalRun`."""
        return cast("Mapping[str, Plain]", self._field("result"))

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        """See :class:`GoalRun`."""
        return cast("Mapping[str, Plain] | None", self._field("feedback"))


class RecordingGoal(_Fields):
    """A goal whose fields are recorded when they are polled; a cancel may change them at once.

    Args:
        run: The goal.
        number: Its number in the order in which goals were sent.
        log: Takes the entries.
    """

    def __init__(self, run: GoalRun, number: int, log: StepLog) -> None:
        self._run = run
        self._number = number
        self._log = log
        self._recorded = initial_goal()
        self._step = -1
        self._polled: dict[str, Any] = {}
        self._cancelled = False

    def cancel(self) -> None:
        """See :class:`GoalRun`."""
        self._run.cancel()
        self._step = self._log.step
        self._polled.clear()
        self._cancelled = True

    def _field(self, name: str) -> Any:
        if self._step != self._log.step:
            self._step = self._log.step
            self._polled.clear()
            self._cancelled = False
        elif name in self._polled:
            return self._polled[name]
        value = self._polled[name] = getattr(self._run, name)
        recorded = self._recorded[name]
        if value is recorded or (name != "feedback" and value == recorded):
            return value
        self._recorded[name] = value
        entry = {
            "goal": self._number,
            "field": name,
            "value": value.name if isinstance(value, GoalState) else value,
        }
        if self._cancelled:
            entry["after_cancel"] = True
        self._log.add("goals", entry)
        return value


class ReplayGoal(_Fields):
    """A goal that has the recorded fields."""

    def __init__(self) -> None:
        self._known = initial_goal()
        self._after_cancel: dict[str, Any] = {}

    def load(self, entry: Entry) -> None:
        """Take an entry; what came out after a cancel comes out with the cancel."""
        name, value = entry["field"], entry["value"]
        if name not in self._known:
            raise ValueError(f"a goal has no '{name}'")
        fields = self._after_cancel if entry.get("after_cancel") else self._known
        fields[name] = GoalState[value] if name == "state" else value

    def cancel(self) -> None:
        """See :class:`GoalRun`."""
        self._known |= self._after_cancel
        self._after_cancel.clear()

    def _field(self, name: str) -> Any:
        return self._known[name]
