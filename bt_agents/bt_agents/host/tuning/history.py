# SPDX-License-Identifier: Apache-2.0
"""History of tuned values: revisions, undo and redo stacks as in an editor, and overrides."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum

from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import Refused

MOST_UNDONE = 1000
"""Most changes that can be undone; older ones stay in force."""

MOST_SHOWN = 100
"""Most changes of single values that are shown."""


@dataclass(frozen=True, kw_only=True)
class TuningChange:
    """Change of one value."""

    name: str
    before: Setting
    after: Setting


class TuningAction(Enum):
    """Kind of revision."""

    SET = "set"
    UNDO = "undo"
    REDO = "redo"


@dataclass(frozen=True, kw_only=True)
class TuningCause:
    """Author and reason of a revision; an undo or redo is ``of`` another revision."""

    author: str
    reason: str = ""
    action: TuningAction = TuningAction.SET
    of: int = 0


@dataclass(frozen=True, kw_only=True)
class TuningRevision:
    """Changes that come into force together.

    Attributes:
        number: Counts up from 1.
        stamp: Time [s since 1970].
        cause: Author, reason and action.
        changes: The changes, each name once; empty for an undo that had nothing left to change.
    """

    number: int
    stamp: float
    cause: TuningCause
    changes: tuple[TuningChange, ...]


FoundRevision = tuple[TuningRevision, Mapping[str, Setting]]
"""A revision to undo or redo, and the values to set for it."""


@dataclass(frozen=True, kw_only=True)
class Override:
    """Tuned value that survives a restart, and the default in the file when it was tuned."""

    value: Setting
    default: Setting


class TuningHistory:
    """Undo stack, redo stack, last changes to show, and overrides of a host.

    Attributes:
        revision: Number of the last revision; 0 for none.
        undoable: Revisions that can be undone, oldest first.
        redoable: Revisions that can be redone, the one undone first at the front.
        shown: The last changes of single values, oldest first.
        overrides: Name → tuned value that differs from its file, including values of agents that
            are currently absent.
    """

    def __init__(
        self,
        revision: int = 0,
        undoable: Iterable[TuningRevision] = (),
        redoable: Iterable[TuningRevision] = (),
        shown: Iterable[TuningRevision] = (),
    ) -> None:
        self.revision = revision
        self.undoable = deque(undoable, MOST_UNDONE)
        self.redoable = deque(redoable, MOST_UNDONE)
        self.shown: deque[tuple[TuningRevision, TuningChange]] = deque(maxlen=MOST_SHOWN)
        self.overrides: dict[str, Override] = {}
        for one in shown:
            self._show(one)

    def add(self, revision: TuningRevision, defaults: Mapping[str, Setting]) -> None:
        """Add a revision that has come into force.

        Args:
            revision: The changes.
            defaults: Defaults in the files, for each changed value that must survive a restart.

        Raises:
            Refused: ``UNKNOWN_REVISION``; it undoes or redoes an impossible revision. Nothing is
                changed.
        """
        match revision.cause.action:
            case TuningAction.SET:
                self.undoable.append(revision)
                self.redoable.clear()
            case TuningAction.UNDO:
                self.redoable.append(_taken(self.undoable, revision.cause.of))
            case TuningAction.REDO:
                self.undoable.append(_taken(self.redoable, revision.cause.of))
        self.revision = max(self.revision, revision.number)
        self._show(revision)
        for change in revision.changes:
            default = defaults.get(change.name)
            if default == change.after:
                self.overrides.pop(change.name, None)
            elif default is not None:
                self.overrides[change.name] = Override(value=change.after, default=default)

    def _show(self, revision: TuningRevision) -> None:
        self.shown.extend((revision, change) for change in revision.changes)

    def find(
        self,
        action: TuningAction,
        agents: Collection[str],
        possible: Callable[[str, Setting], bool],
    ) -> FoundRevision:
        """Return what to undo or redo next: the last change that no later change depends on.

        A revision is one step. It is skipped if one of its values is impossible now, or if a later
        skipped revision changed the same value.

        Args:
            action: Undo or redo.
            agents: Agents whose last change is wanted; empty for all.
            possible: Returns whether a parameter, given by name, can have a value now.

        Raises:
            Refused: ``NOTHING_TO_UNDO`` or ``NOTHING_TO_REDO``.
        """
        undo = action is TuningAction.UNDO
        passed: set[str] = set()
        obstacle = ""
        for revision in reversed(self.undoable if undo else self.redoable):
            values = {one.name: one.before if undo else one.after for one in revision.changes}
            concerned = not agents or any(agent_of(name) in agents for name in values)
            above = sorted(values.keys() & passed)
            lost = [name for name, value in values.items() if not possible(name, value)]
            if concerned and not above and not lost:
                return revision, values
            if concerned and not obstacle:
                obstacle = (
                    f"; revision {revision.number} cannot be: its value of {lost[0]} is not "
                    "possible any more"
                    if lost
                    else f"; revision {revision.number} has to wait: {above[0]} was changed after "
                    "it"
                )
            passed |= values.keys()
        what = action.value
        whose = f" of {', '.join(sorted(agents))}" if agents else ""
        raise Refused(f"NOTHING_TO_{what.upper()}", f"no change{whose} to {what}{obstacle}")


def agent_of(name: str) -> str:
    """Return the agent of a value; empty for a value of the whole host."""
    agent, dot, _ = name.partition(".")
    return agent if dot else ""


def _taken(revisions: deque[TuningRevision], number: int) -> TuningRevision:
    for revision in reversed(revisions):
        if revision.number == number:
            revisions.remove(revision)
            return revision
    raise Refused("UNKNOWN_REVISION", f"revision {number} cannot be taken back or made again")
