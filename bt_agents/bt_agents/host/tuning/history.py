# SPDX-License-Identifier: Apache-2.0
"""History of tuned values: revisions, and stacks of undo and redo as in an editor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from bt_agents.host.tuning.tunable import Setting
from bt_agents_core.errors import Refused

MOST_UNDONE = 1000
"""Changes that can be taken back; older ones stay in force."""

MOST_SHOWN = 100
"""Changes of single values that are shown."""


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
    """Author and reason of a revision.

    Attributes:
        author: For people.
        reason: For people; may be empty.
        action: New, or an undo or redo.
        of: Revision that an undo or redo is about; 0 for a new change.
    """

    author: str
    reason: str = ""
    action: TuningAction = TuningAction.SET
    of: int = 0


@dataclass(frozen=True, kw_only=True)
class TuningRevision:
    """Changes that came into force together.

    Attributes:
        number: Counts up from 1.
        stamp: When [s since 1970].
        cause: Who, why and how.
        changes: What; each name once. An undo that found everything done already has none.
    """

    number: int
    stamp: float
    cause: TuningCause
    changes: tuple[TuningChange, ...]

    @property
    def names(self) -> frozenset[str]:
        """Names of what has changed."""
        return frozenset(change.name for change in self.changes)


Possible = Callable[[str, Setting], bool]
"""Returns whether the parameter of this name can have this value now."""


class TuningHistory:
    """Undo stack, redo stack and the last changes to show."""

    def __init__(
        self,
        revision: int = 0,
        undoable: Iterable[TuningRevision] = (),
        redoable: Iterable[TuningRevision] = (),
        shown: Iterable[TuningRevision] = (),
    ) -> None:
        self.revision = revision
        self._undoable: deque[TuningRevision] = deque(undoable, MOST_UNDONE)
        self._redoable: deque[TuningRevision] = deque(redoable, MOST_UNDONE)
        self._shown: deque[tuple[TuningRevision, TuningChange]] = deque(maxlen=MOST_SHOWN)
        for one in shown:
            self._show(one)

    @property
    def undoable(self) -> Sequence[TuningRevision]:
        """What can be undone, the oldest first."""
        return tuple(self._undoable)

    @property
    def redoable(self) -> Sequence[TuningRevision]:
        """What can be redone, the one that was undone first at the front."""
        return tuple(self._redoable)

    @property
    def shown(self) -> Sequence[tuple[TuningRevision, TuningChange]]:
        """The last changes of single values, the oldest first."""
        return tuple(self._shown)

    def add(self, revision: TuningRevision) -> None:
        """Add a revision that has come into force.

        Raises:
            Refused: ``UNKNOWN_REVISION``: it undoes or redoes what cannot be.
        """
        match revision.cause.action:
            case TuningAction.SET:
                self._undoable.append(revision)
                self._redoable.clear()
            case TuningAction.UNDO:
                self._redoable.append(_taken(self._undoable, revision.cause.of))
            case TuningAction.REDO:
                self._undoable.append(_taken(self._redoable, revision.cause.of))
        self.revision = max(self.revision, revision.number)
        self._show(revision)

    def _show(self, revision: TuningRevision) -> None:
        self._shown.extend((revision, change) for change in revision.changes)

    def undo(
        self, agents: Collection[str], possible: Possible
    ) -> tuple[TuningRevision, Mapping[str, Setting]]:
        """Return what to undo next, and the values that it gives back.

        Args:
            agents: The last change of one of these; empty for the last of all.
            possible: Says which values can be given back now.

        Raises:
            Refused: ``NOTHING_TO_UNDO``.
        """
        found = _last(
            self._undoable, agents, lambda change: possible(change.name, change.before), "undo"
        )
        return found, {change.name: change.before for change in found.changes}

    def redo(
        self, agents: Collection[str], possible: Possible
    ) -> tuple[TuningRevision, Mapping[str, Setting]]:
        """Return what to redo next, and the values that it gives again; as :meth:`undo`.

        Raises:
            Refused: ``NOTHING_TO_REDO``.
        """
        found = _last(
            self._redoable, agents, lambda change: possible(change.name, change.after), "redo"
        )
        return found, {change.name: change.after for change in found.changes}


def agent_of(name: str) -> str:
    """Return whose value this is; empty for one of the whole host."""
    agent, dot, _ = name.partition(".")
    return agent if dot else ""


def _taken(revisions: deque[TuningRevision], number: int) -> TuningRevision:
    for revision in reversed(revisions):
        if revision.number == number:
            revisions.remove(revision)
            return revision
    raise Refused("UNKNOWN_REVISION", f"revision {number} cannot be taken back or made again")


def _last(
    revisions: deque[TuningRevision],
    agents: Collection[str],
    possible: Callable[[TuningChange], bool],
    what: str,
) -> TuningRevision:
    """Return the last revision that concerns some agents and that nothing stands upon.

    A revision is one step: it is passed over when one of its values is impossible now, or when a
    later one that is passed over has changed the same value.
    """
    passed: set[str] = set()
    obstacle = ""
    for revision in reversed(revisions):
        concerned = not agents or any(agent_of(name) in agents for name in revision.names)
        above = sorted(revision.names & passed)
        lost = [change.name for change in revision.changes if not possible(change)]
        if concerned and not above and not lost:
            return revision
        if concerned and not obstacle:
            obstacle = (
                f"; revision {revision.number} cannot be: its value of {lost[0]} is not possible "
                "any more"
                if lost
                else f"; revision {revision.number} has to wait: {above[0]} was changed after it"
            )
        passed |= revision.names
    whose = f" of {', '.join(sorted(agents))}" if agents else ""
    raise Refused(f"NOTHING_TO_{what.upper()}", f"no change{whose} to {what}{obstacle}")
