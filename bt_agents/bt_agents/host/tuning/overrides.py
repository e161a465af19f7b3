# SPDX-License-Identifier: Apache-2.0
"""Overrides: values that were tuned and differ from their files, with the history of changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bt_agents.host.tuning.history import TuningHistory, TuningRevision
from bt_agents.host.tuning.tunable import Setting


@dataclass(frozen=True, kw_only=True)
class Override:
    """Tuned value that outlives a restart.

    Attributes:
        value: In force.
        default: What the file said when it was tuned.
    """

    value: Setting
    default: Setting


@dataclass(kw_only=True)
class Overrides:
    """History and overrides of a host, also those of agents that are not here now.

    Attributes:
        history: The changes so far.
        by_name: Name → tuned value, for each that differs from its file.
    """

    history: TuningHistory = field(default_factory=TuningHistory)
    by_name: dict[str, Override] = field(default_factory=dict)

    def add(self, revision: TuningRevision, defaults: Mapping[str, Setting]) -> None:
        """Add a revision that has come into force.

        Args:
            revision: The changes.
            defaults: What the files say, for each changed value that is to outlive a restart.

        Raises:
            Refused: As in :meth:`TuningHistory.add`; then nothing is changed.
        """
        self.history.add(revision)
        for change in revision.changes:
            if change.name in defaults:
                self.override(change.name, change.after, defaults[change.name])

    def override(self, name: str, value: Setting, default: Setting) -> None:
        """Set the override of a value, or clear it when the file says the same."""
        if value == default:
            self.clear(name)
        else:
            self.by_name[name] = Override(value=value, default=default)

    def clear(self, name: str) -> None:
        """Remove the override of a value that has become the default of its file."""
        self.by_name.pop(name, None)
