# SPDX-License-Identifier: Apache-2.0
"""Values and the history of their changes, as a host keeps them, without files."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents.host.tuning.history import (
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
)
from bt_agents.host.tuning.tunable import Setting


class Desk:
    """Values that a test sets, and their history.

    Args:
        values: The values at the start, which are also the defaults.
    """

    def __init__(self, values: Mapping[str, Setting]) -> None:
        self.values = dict(values)
        self.history = TuningHistory()
        self.impossible: set[str] = set()
        self._defaults = dict(values)

    def set(self, values: Mapping[str, Setting]) -> None:
        """Set values; those that stay are not a change."""
        if any(self.values[name] != value for name, value in values.items()):
            self._record(values, TuningCause(author="test"))

    def undo(self, *agents: str) -> int:
        """Undo the last change, or that of some agents; return the number of its revision."""
        return self._step(TuningAction.UNDO, agents)

    def redo(self, *agents: str) -> int:
        """Redo the change that was undone last; return the number of its revision."""
        return self._step(TuningAction.REDO, agents)

    def _step(self, action: TuningAction, agents: tuple[str, ...]) -> int:
        found, values = self.history.find(
            action, agents, lambda name, _value: name not in self.impossible
        )
        self._record(values, TuningCause(author="test", action=action, of=found.number))
        return found.number

    def _record(self, values: Mapping[str, Setting], cause: TuningCause) -> None:
        changes = tuple(
            TuningChange(name=name, before=self.values[name], after=value)
            for name, value in values.items()
            if self.values[name] != value
        )
        number = self.history.revision + 1
        revision = TuningRevision(number=number, stamp=1.0, cause=cause, changes=changes)
        defaults = {change.name: self._defaults[change.name] for change in changes}
        self.history = self.history.with_revision(revision, defaults)
        self.values |= values
