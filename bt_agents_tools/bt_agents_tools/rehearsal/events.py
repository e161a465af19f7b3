# SPDX-License-Identifier: Apache-2.0
"""Events of a rehearsal, as data that can be shown, compared and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from bt_agents.engine.run import StatusChange, TreeOutcome
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_language.files.testing.scenarios import SPOKEN
from bt_agents_language.model.specs import NodeSpec
from bt_agents_tools.rehearsal.coverage import Marks


class EventKind(Enum):
    """What an event is about."""

    BEGINS = auto()
    SUCCEEDS = auto()
    FAILS = auto()
    STOPS = auto()
    SENDS = auto()
    LOGS = auto()
    WAITS = auto()
    GIVES_UP = auto()
    SCENE = auto()
    TUNES = auto()
    ARRIVES = auto()
    FEEDBACK = auto()
    CANCELS = auto()
    TICK = auto()
    ENDS = auto()


@dataclass(frozen=True, kw_only=True)
class Event:
    """Event of a rehearsal.

    Attributes:
        at_s: Time since the start [s].
        kind: What it is about.
        node: The node that it is about.
        inputs: What a skill was given.
        outputs: What it gave back.
        takes_s: How long what begins will take [s]; infinite for ever.
        text: The rest, for people.
        outcome: How the run ended; None when it did not, or for any other event.
        change: The node's new status, of a ``TICK``.
    """

    at_s: float
    kind: EventKind
    node: NodeSpec | None = None
    inputs: Mapping[str, Plain] = field(default_factory=dict)
    outputs: Mapping[str, Plain] = field(default_factory=dict)
    takes_s: float = 0.0
    text: str = ""
    outcome: TreeOutcome | None = None
    change: StatusChange | None = None


@dataclass(frozen=True, kw_only=True)
class Use:
    """A skill in use: the node, what it was given and how long it takes [s]."""

    node: NodeSpec
    inputs: Mapping[str, Plain]

    @property
    def skill(self) -> str:
        """Name of the skill."""
        return self.node.kind

    @property
    def main(self) -> Plain:
        """Value of the main input; None when there is none."""
        skill = self.node.skill
        return self.inputs.get(skill.main) if skill is not None and skill.main else None

    @property
    def spoken(self) -> bool:
        """Whether it is something that the robot says."""
        return self.skill in SPOKEN


@dataclass(frozen=True, kw_only=True)
class Rehearsed:
    """Result of a rehearsal.

    Attributes:
        outcome: How the run ended; None when it did not end, or was not awarded.
        message: The reason.
        duration_s: How long it took [s].
        ticks: Ticks of the tree and of its clean-up.
        events: Everything that happened, in order.
        uses: The skills that were used, in order.
        feedback: The feedback that was given, in order.
        cancelled_by: Mood rule or reason that cancelled it; empty when nothing did.
        declined: Why the agent does not bid for the scene; empty when it does.
        marks: Which nodes were ticked, and to what end.
    """

    outcome: TreeOutcome | None
    message: str
    duration_s: float
    ticks: int
    events: tuple[Event, ...]
    uses: tuple[Use, ...]
    feedback: tuple[FeedbackKind, ...]
    cancelled_by: str
    declined: str
    marks: Marks
