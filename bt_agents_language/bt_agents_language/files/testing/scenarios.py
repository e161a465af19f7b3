# SPDX-License-Identifier: Apache-2.0
"""Specification of a test file: scenarios and expectations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from bt_agents_core.diagnostic import Position
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import Plain
from bt_agents_core.local_time import NOON, LocalTime
from bt_agents_core.person_facts import Fact
from bt_agents_core.stop_cause import Cancellation
from bt_agents_language.model.specs import AgentSpec, NodeSpec

REPLACED = "replaced"
"""First part of the paths of a node that takes the place of others."""

SPOKEN = ("say", "ask")
"""Skills whose main input ``says`` speaks of."""


class GoalEnd(Enum):
    """How a skill ends in a rehearsal; the value is the word in a file."""

    SUCCEEDS = "succeeds"
    FAILS = "fails"
    REJECTED = "rejected"
    UNREACHABLE = "unreachable"
    NEVER = "never"


@dataclass(frozen=True, kw_only=True)
class ScriptedAnswer:
    """How the world answers one use of a skill.

    Attributes:
        outputs: Values of outputs by name; the others get a likely value.
        after_s: How long it takes [s]; None for as long as it usually does.
    """

    outputs: Mapping[str, Plain] = field(default_factory=dict)
    end: GoalEnd = GoalEnd.SUCCEEDS
    reason: str = ""
    after_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class AnswerRule:
    """The answers to a skill or to the nodes of a pattern, in turn, the last for ever."""

    key: str
    answers: tuple[ScriptedAnswer, ...]


@dataclass(frozen=True, kw_only=True)
class VariantRule:
    """Which of their variants the nodes of a pattern take, from 0, in turn, the last for ever."""

    pattern: str
    numbers: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Replacement:
    """Another node, with paths below ``REPLACED``, in place of those that a pattern fits."""

    pattern: str
    node: NodeSpec


@dataclass(frozen=True, kw_only=True)
class ScriptedEvent:
    """Something that happens to the agent while it runs.

    Attributes:
        after_s: Time since the start of the run, or of the first start of the node ``at`` [s].
        at: Path of a node; empty counts from the start of the run.
        person: Whether the person is there from now on; None for unchanged.
        silent: Whether the scene layer is silent from now on; None for unchanged.
        topic: Where a message arrives; empty for none.
        cancel: Who cancels the run and why; None when nobody does.
    """

    after_s: float
    at: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    person: bool | None = None
    silent: bool | None = None
    tunables: Mapping[str, Plain] = field(default_factory=dict)
    topic: str = ""
    message: Mapping[str, Plain] = field(default_factory=dict)
    cancel: Cancellation | None = None


@dataclass(frozen=True, kw_only=True)
class RehearsedPerson:
    """Somebody who is known by name.

    Attributes:
        visits: How often they have been here, this visit included.
        remembers: What is remembered of them.
    """

    name: str
    visits: int = 1
    remembers: Mapping[str, Fact] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One interaction to rehearse.

    Attributes:
        scene: Values of scene parameters as awarded; the others are not known.
        known: Who the person is; None for somebody who is not known by name.
        clock: Local time at the start.
        tunables: Values that differ from the defaults.
        answers: Those of paths count before those of skills, else the first that fits.
        picks: Paths of children of ``random`` nodes, each node takes its own in turn.
        variants: The first that fits a node counts; the others take any of theirs.
        replace: The first that fits a node counts.
        during: What happens, in any order.
    """

    scene: Mapping[str, float] = field(default_factory=dict)
    person: bool = True
    known: RehearsedPerson | None = None
    clock: LocalTime = NOON
    tunables: Mapping[str, Plain] = field(default_factory=dict)
    seed: int = 0
    picks: tuple[str, ...] = ()
    answers: tuple[AnswerRule, ...] = ()
    variants: tuple[VariantRule, ...] = ()
    replace: tuple[Replacement, ...] = ()
    during: tuple[ScriptedEvent, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SkillUse:
    """A skill, its main input, and the inputs that are looked at; none means any will do."""

    skill: str
    inputs: Mapping[str, Plain] = field(default_factory=dict)
    main: str | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class Says:
    """The texts of ``say`` and ``ask`` in order; ``exact`` means these and no others."""

    texts: tuple[str, ...]
    exact: bool
    position: Position


@dataclass(frozen=True, kw_only=True)
class Does:
    """The skills that are used, in order; ``exact`` means these and no others."""

    uses: tuple[SkillUse, ...]
    exact: bool
    position: Position


@dataclass(frozen=True, kw_only=True)
class DoesNot:
    """Skills that are not used at all, or not with these inputs."""

    uses: tuple[SkillUse, ...]
    position: Position


@dataclass(frozen=True, kw_only=True)
class Visits:
    """Whether a node that a pattern fits is ticked at all."""

    pattern: str
    wanted: bool
    position: Position


@dataclass(frozen=True, kw_only=True)
class Ends:
    """How the run ends: ``succeeded``, ``failed`` or ``cancelled``."""

    outcome: str
    position: Position


@dataclass(frozen=True, kw_only=True)
class Because:
    """Words of the reason why it ended."""

    words: str
    position: Position


@dataclass(frozen=True, kw_only=True)
class Within:
    """The longest time that the run may take [s]."""

    seconds: float
    position: Position


@dataclass(frozen=True, kw_only=True)
class Teaches:
    """The feedback that is given, in order."""

    kinds: tuple[FeedbackKind, ...]
    position: Position


@dataclass(frozen=True, kw_only=True)
class Tells:
    """Values that the tree puts into the scene, the last of each; none for nothing at all."""

    values: Mapping[str, float]
    position: Position


@dataclass(frozen=True, kw_only=True)
class Remembers:
    """What the tree remembers of the person, the last of each; none for nothing at all."""

    values: Mapping[str, Fact]
    position: Position


@dataclass(frozen=True, kw_only=True)
class CancelledBy:
    """The mood rule, or the reason in the test, that cancels the run."""

    cause: str
    position: Position


@dataclass(frozen=True, kw_only=True)
class ExpectedBids:
    """Whether the agent bids for the scene at all."""

    wanted: bool
    position: Position


Expectation = (
    Says
    | Does
    | DoesNot
    | Visits
    | Ends
    | Because
    | Within
    | Teaches
    | Tells
    | Remembers
    | CancelledBy
    | ExpectedBids
)


@dataclass(frozen=True, kw_only=True)
class AgentTestCase:
    """One case of a test file; its agent is as in the language of the case."""

    name: str
    agent: AgentSpec
    scenario: Scenario
    expectations: tuple[Expectation, ...]
    position: Position


@dataclass(frozen=True, kw_only=True)
class AgentTest:
    """A test file."""

    file: str
    agent: AgentSpec
    cases: tuple[AgentTestCase, ...]
