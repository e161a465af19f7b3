# SPDX-License-Identifier: Apache-2.0
"""What is known of all tuning so far: the history, and which values differ from their files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bt_agents.host.tuning.history import TuningHistory, TuningRevision
from bt_agents.host.tuning.tunable import Setting


@dataclass(frozen=True, kw_only=True)
class Override:
    """A tuned value.

    Attributes:
        value: In force.
        default: What the file said when it was tuned.
    """

    value: Setting
    default: Setting


@dataclass(kw_only=True)
class Overrides:
    """The history, and the tuned values, also of agents that are not here now.

    Attributes:
        history: The changes so far.
        kept: Name → tuned value, for each that differs from its file.
    """

    history: TuningHistory = field(default_factory=TuningHistory)
    kept: dict[str, Override] = field(default_factory=dict)

    def take(self, revision: TuningRevision, defaults: Mapping[str, Setting]) -> None:
        """Take in what has come into force.

        Args:
            revision: The changes.
            defaults: What the files say, for each changed value that is to be kept.

        Raises:
            Refused: As in :meth:`TuningHistory.add`; then nothing is changed.
        """
        self.history.add(revision)
        for change in revision.changes:
            if change.name in defaults:
                self.keep(change.name, change.after, defaults[change.name])

    def keep(self, name: str, value: Setting, default: Setting) -> None:
        """Keep a value over a restart, unless it is what the file says anyway."""
        if value == default:
            self.agree(name)
        else:
            self.kept[name] = Override(value=value, default=default)

    def agree(self, name: str) -> None:
        """Note that the file says what was tuned, so that there is nothing to keep."""
        self.kept.pop(name, None)
