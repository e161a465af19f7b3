# SPDX-License-Identifier: Apache-2.0
"""History of tuned values: revisions, undo and redo stacks as in an editor, and overrides."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

from bt_agents.host.tuning.tunable import Setting, same
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

MOST_REVISIONS = 100
"""Most revisions that can be undone, and most that are shown; older ones stay in force."""

MOST_CHANGES = 10_000
"""Most changes of these revisions, unless the last one has more."""


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


@dataclass(frozen=True, kw_only=True)
class TuningHistory:
    """Undo stack, redo stack, last revisions, and overrides of a host.

    Attributes:
        undoable: Revisions that can be undone, oldest first.
        redoable: Revisions that can be redone, the one undone first at the front.
        shown: The last revisions, oldest first.
        overrides: Name → tuned value that differs from its file, including values of agents that
            are currently absent.
    """

    undoable: tuple[TuningRevision, ...] = ()
    redoable: tuple[TuningRevision, ...] = ()
    shown: tuple[TuningRevision, ...] = ()
    overrides: Mapping[str, Override] = field(default_factory=dict)

    @property
    def revision(self) -> int:
        """Number of the last revision; 0 for none."""
        return self.shown[-1].number if self.shown else 0

    def with_revision(
        self, revision: TuningRevision, defaults: Mapping[str, Setting]
    ) -> TuningHistory:
        """Return the history after a revision that has come into force.

        Args:
            revision: The changes.
            defaults: Default in the file for each changed value.
        """
        undoable, redoable = [*self.undoable], [*self.redoable]
        match revision.cause.action:
            case TuningAction.SET:
                undoable.append(revision)
                redoable.clear()
            case TuningAction.UNDO:
                _move(revision.cause.of, undoable, redoable)
            case TuningAction.REDO:
                _move(revision.cause.of, redoable, undoable)
        overrides = dict(self.overrides)
        for change in revision.changes:
            default = defaults[change.name]
            if same(default, change.after):
                overrides.pop(change.name, None)
            else:
                overrides[change.name] = Override(value=change.after, default=default)
        return TuningHistory(
            undoable=_last(undoable),
            redoable=tuple(redoable),
            shown=_last([*self.shown, revision]),
            overrides=overrides,
        )

    def without_override(self, name: str) -> TuningHistory:
        """Return the history without the override of a value that its file has taken over."""
        overrides = {key: one for key, one in self.overrides.items() if key != name}
        return replace(self, overrides=overrides)

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
        code = RefusalCode.NOTHING_TO_UNDO if undo else RefusalCode.NOTHING_TO_REDO
        raise Refused(code, f"no change{whose} to {what}{obstacle}")


def agent_of(name: str) -> str:
    """Return the agent of a value; empty for a value of the whole host."""
    agent, dot, _ = name.partition(".")
    return agent if dot else ""


def _last(revisions: Sequence[TuningRevision]) -> tuple[TuningRevision, ...]:
    """Return the last revisions, as many as are kept."""
    start, changes = len(revisions), 0
    for revision in reversed(revisions[-MOST_REVISIONS:]):
        changes += len(revision.changes)
        if changes > MOST_CHANGES and start < len(revisions):
            break
        start -= 1
    return tuple(revisions[start:])


def _move(number: int, source: list[TuningRevision], target: list[TuningRevision]) -> None:
    [found] = [revision for revision in source if revision.number == number]
    source.remove(found)
    target.append(found)
