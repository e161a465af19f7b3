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
"""First part of the paths of a replacement node."""

SPOKEN = ("say", "ask")
"""Skills whose main inputs ``says`` checks."""


class GoalEnd(Enum):
    """End of a skill in a rehearsal; the value is the word in files."""

    SUCCEEDS = "succeeds"
    FAILS = "fails"
    REJECTED = "rejected"
    UNREACHABLE = "unreachable"
    NEVER = "never"


@dataclass(frozen=True, kw_only=True)
class ScriptedAnswer:
    """Answer of the world to one use of a skill.

    Attributes:
        outputs: Values of outputs by name; others get a likely value.
        after_s: Its duration [s]; None for the usual one.
    """

    outputs: Mapping[str, Plain] = field(default_factory=dict)
    end: GoalEnd = GoalEnd.SUCCEEDS
    reason: str = ""
    after_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class AnswerRule:
    """Answers to a skill or to the nodes of a pattern, used in turn; the last one repeats."""

    key: str
    answers: tuple[ScriptedAnswer, ...]


@dataclass(frozen=True, kw_only=True)
class VariantRule:
    """Variants of the nodes of a pattern, from 0, used in turn; the last one repeats."""

    pattern: str
    numbers: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Replacement:
    """Replacement node, with paths below ``REPLACED``, for nodes that match a pattern."""

    pattern: str
    node: NodeSpec


@dataclass(frozen=True, kw_only=True)
class ScriptedEvent:
    """Event during the run of the agent.

    Attributes:
        after_s: Time since the start of the run, or of the first start of the node ``at`` [s].
        at: Path of a node; empty counts from the start of the run.
        person: Whether the person is present from now on; None for unchanged.
        silent: Whether the scene layer is silent from now on; None for unchanged.
        topic: Topic of a message that arrives; empty for none.
        cancel: Who cancels the run and why; None for no cancellation.
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
    """Person who is known by name.

    Attributes:
        visits: Number of visits, including this one.
        remembers: Remembered facts about the person.
    """

    name: str
    visits: int = 1
    remembers: Mapping[str, Fact] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Interaction to rehearse.

    Attributes:
        scene: Values of scene parameters as awarded; the others are unknown.
        known: The person; None if not known by name.
        clock: Local time at the start.
        tunables: Values that differ from the defaults.
        answers: Answers; those for paths precede those for skills, then the first match counts.
        picks: Paths of children of ``random`` nodes; each node takes its own in turn.
        variants: Variant rules; the first match counts, and other nodes take any variant.
        replace: Replacements; the first match counts.
        during: Events, in any order.
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
    """Skill, its main input, and the checked inputs; none accepts any."""

    skill: str
    inputs: Mapping[str, Plain] = field(default_factory=dict)
    main: str | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class _AtPlace:
    """Expectation at its place in the file."""

    position: Position


@dataclass(frozen=True, kw_only=True)
class Says(_AtPlace):
    """Texts of ``say`` and ``ask`` in order; ``exact`` means these and no others."""

    texts: tuple[str, ...]
    exact: bool


@dataclass(frozen=True, kw_only=True)
class Does(_AtPlace):
    """Used skills in order; ``exact`` means these and no others."""

    uses: tuple[SkillUse, ...]
    exact: bool


@dataclass(frozen=True, kw_only=True)
class DoesNot(_AtPlace):
    """Skills that must not be used at all, or not with these inputs."""

    uses: tuple[SkillUse, ...]


@dataclass(frozen=True, kw_only=True)
class Visits(_AtPlace):
    """Whether a node that matches a pattern is ticked at all."""

    pattern: str
    wanted: bool


@dataclass(frozen=True, kw_only=True)
class Ends(_AtPlace):
    """End of the run: ``succeeded``, ``failed`` or ``cancelled``."""

    outcome: str


@dataclass(frozen=True, kw_only=True)
class Because(_AtPlace):
    """Words in the reason of the end."""

    words: str


@dataclass(frozen=True, kw_only=True)
class Within(_AtPlace):
    """Longest allowed duration of the run [s]."""

    seconds: float


@dataclass(frozen=True, kw_only=True)
class Teaches(_AtPlace):
    """Feedback that is given, in order."""

    kinds: tuple[FeedbackKind, ...]


@dataclass(frozen=True, kw_only=True)
class Tells(_AtPlace):
    """Values that the tree puts into the scene, the last of each; empty for none at all."""

    values: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Remembers(_AtPlace):
    """Facts that the tree remembers about the person, the last of each; empty for none at all."""

    values: Mapping[str, Fact]


@dataclass(frozen=True, kw_only=True)
class CancelledBy(_AtPlace):
    """Mood rule, or reason in the test, that cancels the run."""

    cause: str


@dataclass(frozen=True, kw_only=True)
class ExpectedBids(_AtPlace):
    """Whether the agent bids for the scene at all."""

    wanted: bool


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
    """Case of a test file; its agent has the language of the case."""

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
