# SPDX-License-Identifier: Apache-2.0
"""Events of a rehearsal as data for display, comparison and counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from bt_agents.engine.run import StatusChange, TreeOutcome
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.person_facts import Fact
from bt_agents_language.files.testing.scenarios import SPOKEN
from bt_agents_language.model.specs import NodeSpec
from bt_agents_tools.rehearsal.coverage import Marks


class EventKind(Enum):
    """Kind of an event of a rehearsal."""

    BEGINS = auto()
    SUCCEEDS = auto()
    FAILS = auto()
    STOPS = auto()
    SENDS = auto()
    LOGS = auto()
    WAITS = auto()
    GIVES_UP = auto()
    NOT_TAKEN = auto()
    SCENE = auto()
    TUNES = auto()
    ARRIVES = auto()
    LOST = auto()
    FEEDBACK = auto()
    CANCELS = auto()
    TICK = auto()
    ENDS = auto()


@dataclass(frozen=True, kw_only=True)
class Event:
    """Event of a rehearsal.

    Attributes:
        at_s: Time since the start [s].
        inputs: Inputs of a skill, or fields of a message.
        takes_s: Duration of a skill that begins [s]; infinite if it never ends.
        text: Further details for people.
        outcome: Outcome of the run, for ``ENDS``; None if it did not end.
        change: New status of the node, for a ``TICK``.
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
    """Use of a skill: its node and its inputs."""

    node: NodeSpec
    inputs: Mapping[str, Plain]

    @property
    def skill(self) -> str:
        """Name of the skill."""
        return self.node.kind

    @property
    def main(self) -> Plain:
        """Value of the main input; None if there is none."""
        skill = self.node.skill
        return self.inputs.get(skill.main) if skill is not None and skill.main else None

    @property
    def spoken(self) -> bool:
        """True for a text that the robot speaks."""
        return self.skill in SPOKEN


@dataclass(frozen=True, kw_only=True)
class Rehearsed:
    """Result of a rehearsal.

    Attributes:
        outcome: Outcome of the run; None if it did not end or was not awarded.
        message: Reason of the outcome.
        duration_s: Virtual duration [s].
        ticks: Ticks of the tree and of its clean-up.
        cancelled_by: Mood rule or reason that cancelled it; empty if nothing did.
        declined: Why the agent does not bid for the scene; empty if it does.
        told: Values that the tree has put into the scene, the latest of each.
        remembered: Facts that it has remembered about the person, the latest of each.
        undecided: Undecidable conditions, each with its reason.
        marks: Marks of each node for coverage, by path.
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
    told: Mapping[str, float]
    remembered: Mapping[str, Fact]
    undecided: tuple[str, ...]
    marks: Marks
