# SPDX-License-Identifier: Apache-2.0
"""Records: the values of all collections of a studio, in the form that the browser receives.

Times are in seconds since 1970 unless stated otherwise. Unknown values are None, never NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Origin
from bt_agents_core.stop_cause import StoppedBy

Json = str | float | int | bool | None

STAMP = "stamp"
"""Marks a time that is the stamp of a message."""

Stamp = Annotated[float, STAMP]


class Names(tuple[str, ...]):
    """Names of the constants of a message field, from 0; a text holds one of them."""

    __slots__ = ()


_FEEDBACK = Names(one.name for one in FeedbackKind)


@dataclass(frozen=True, kw_only=True)
class ParameterRecord:
    """A scene parameter as declared in the scene file; ``labels`` are words for some values."""

    name: str
    minimum: float
    maximum: float
    default: float
    description: str
    labels: Mapping[str, str]
    is_mood: bool


@dataclass(frozen=True, kw_only=True)
class StrategyRecord:
    """One way to rank bids."""

    name: str
    description: str
    options: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ProblemRecord:
    """Why a file is not in force, an agent does not take part, or a rule is ignored."""

    agent: str
    file: str
    line: int
    message: str


@dataclass(frozen=True, kw_only=True)
class MarketRecord:
    """State of the marketplace; ``state`` is the name of a constant of ``MarketStatus``."""

    epoch: str
    state: Annotated[
        str, Names(("IDLE", "BIDDING", "AWARDING", "RUNNING", "CANCELLING", "COLLECTING"))
    ]
    since_s: Stamp
    round: int
    scene_id: str
    scene_label: str
    agent: str
    host: str
    waiting: tuple[str, ...]
    awaited_hosts: tuple[str, ...]
    refused_hosts: tuple[str, ...]
    hosts: int
    agents: int
    strategy: str
    shadow_strategy: str
    strategies: tuple[StrategyRecord, ...]
    pinned: str
    vetoed: tuple[str, ...]
    starved: tuple[str, ...]
    problems: tuple[ProblemRecord, ...]
    message: str


@dataclass(frozen=True, kw_only=True)
class ValueRecord:
    """One scene parameter; ``origin`` is the name of a constant of ``SceneValue``."""

    name: str
    value: float | None
    origin: Annotated[str, Names(one.name for one in Origin)]
    age_s: float | None
    std: float | None
    confidence: float
    source: str


@dataclass(frozen=True, kw_only=True)
class SceneRecord:
    """A scene, awarded or live."""

    at_s: Stamp
    scene_id: str
    label: str
    person: bool
    urgent: bool
    person_id: str
    place: str
    persons: int
    visits: int
    remembered: Mapping[str, Json]
    values: tuple[ValueRecord, ...]


@dataclass(frozen=True, kw_only=True)
class TreeNodeRecord:
    """One node of a tree; ``parent`` is its index in the list, -1 for the root."""

    path: str
    parent: int
    kind: str
    name: str
    file: str
    line: int
    column: int


@dataclass(frozen=True, kw_only=True)
class TreeRecord:
    """Structure of an agent's tree, parents before children."""

    agent: str
    host: str
    nodes: tuple[TreeNodeRecord, ...]


STOPPED, UNKNOWN = "STOPPED", "UNKNOWN"
"""Statuses of nodes that no message contains."""


@dataclass(frozen=True, kw_only=True)
class NodeRecord:
    """Progress of a node in the last run of an agent; by default it has not started.

    Attributes:
        status: Name of a constant of ``StatusChange``; :data:`STOPPED` if it was stopped while it
            was running, :data:`UNKNOWN` if its run was lost meanwhile.
        message: Reason for the status.
        since_s: When it got the status.
        tick: Number of the tick that gave it the status.
        starts: Number of its starts.
        successes: Number of its successes.
        failures: Number of its failures.
        busy_s: Total running time until ``since_s`` [s].
        reason: Reason for its last failure; empty without one.
    """

    status: str = "INVALID"
    message: str = ""
    since_s: float = 0.0
    tick: int = 0
    starts: int = 0
    successes: int = 0
    failures: int = 0
    busy_s: float = 0.0
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class CountdownRecord:
    """Remaining limits of a node.

    Attributes:
        at_s: Time of the message.
        kind: Key of the node: ``timeout``, ``wait``, ``retry``.
        remaining_s: Remaining time from ``at_s`` [s]; None without a time limit.
        remaining: Attempts or rounds after the current one; None without such a limit.
        whole_s: The whole time, as far as observed [s]; None without a time limit.
    """

    at_s: float
    kind: str
    remaining_s: float | None
    remaining: int | None
    whole_s: float | None


@dataclass(frozen=True, kw_only=True)
class NodeValueRecord:
    """Value that a node has last read or written under a name, in an author's notation."""

    at_s: float
    tick: int
    name: str
    value: str
    written: bool


@dataclass(frozen=True, kw_only=True)
class NodeValuesRecord:
    """Values that a node has read and written in the last run, newest last."""

    values: tuple[NodeValueRecord, ...]


@dataclass(frozen=True, kw_only=True)
class ControlRecord:
    """Control of a host's runs by people.

    Attributes:
        epoch: Epoch of the current run; empty without one.
        paused_at: Path of the node whose breakpoint paused the run; empty otherwise.
        since_s: When this came into force.
        breakpoints: Agent → paths of the nodes before which its runs pause.
    """

    host: str
    epoch: str
    round: int
    agent: str
    paused: bool
    paused_at: str
    author: str
    since_s: float
    breakpoints: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """The last run of an agent; names are the constants of ``Run``.

    Attributes:
        ended_s: When its end was announced; None while it runs.
        tick: Number of its last tick with a change.
        ticks: Number of all ticks; 0 before the end.
    """

    agent: str
    host: str
    host_instance: str
    epoch: str
    round: int
    scene_id: str
    scene_label: str
    event: Annotated[str, Names(("", "STARTED", "CANCELLING", "ENDED", "REFUSED"))]
    outcome: Annotated[str, Names(("NONE", "SUCCEEDED", "FAILED", "CANCELLED", "LOST"))]
    stopped_by: Annotated[str, Names(one.name for one in StoppedBy)]
    stop_reason: str
    message: str
    began_s: float
    ended_s: float | None
    tick: int
    tip: str
    orphans: tuple[str, ...]
    ticks: int
    overruns: int
    duration_s: float


@dataclass(frozen=True, kw_only=True)
class LogRecord:
    """One line of the log; ``kind`` is the part of the system that it concerns."""

    at_s: float
    kind: str
    agent: str
    path: str
    text: str


@dataclass(frozen=True, kw_only=True)
class EventRecord:
    """A moment or a span on the timeline.

    Attributes:
        lane: ``AGENT``, ``ROBOT``, ``MARKET``, ``FEEDBACK``, ``FAULT`` or ``RECORDING``.
        kind: Outcome of a run, or ``RUNNING`` or ``CANCELLING``; the robot's act; the outcome
            of a round; the kind of feedback; the level of a part's health; ``RECORDING`` or
            ``RECORDED``.
        ended_s: ``began_s`` for a moment; None while a span goes on.
    """

    lane: str
    kind: str
    agent: str
    text: str
    began_s: float
    ended_s: float | None


@dataclass(frozen=True, kw_only=True)
class BidRecord:
    """One accepted and ranked bid."""

    agent: str
    host: str
    vector: tuple[float, ...]
    contributions: tuple[float, ...]
    distance: float | None
    bonus: float
    score: float | None
    runs: int
    calculation: str


@dataclass(frozen=True, kw_only=True)
class RefusedBidRecord:
    """One bid that takes no part in the ranking."""

    agent: str
    host: str
    declined: bool
    code: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class RoundRecord:
    """The outcome of one round; names are the constants of ``Auction``."""

    at_s: Stamp
    epoch: str
    round: int
    follows: int
    scene: SceneRecord
    outcome: Annotated[str, Names(("", "AWARDED", "NO_BIDS", "PREEMPTS", "WAITS"))]
    closed_by: Annotated[str, Names(("", "ALL_ANSWERED", "DEADLINE", "STOPPED"))]
    preview: bool
    duration_s: float
    strategy: str
    options: Mapping[str, float]
    intervention: str
    ranking: tuple[BidRecord, ...]
    refused: tuple[RefusedBidRecord, ...]
    silent_hosts: tuple[str, ...]
    winner: str
    margin: float | None
    shadow_strategy: str
    shadow_winner: str
    change: Mapping[str, float]
    reason: str
    explanation: str


@dataclass(frozen=True, kw_only=True)
class ProfileStepRecord:
    """A change of a profile; ``kind`` is the name of a constant of ``Feedback``."""

    at_s: Stamp
    agent: str
    layer: str
    kind: Annotated[str, _FEEDBACK]
    source: str
    reason: str
    round: int
    leaf: str
    parameters: tuple[str, ...]
    before: tuple[float | None, ...]
    after: tuple[float | None, ...]
    target: tuple[float | None, ...]
    weight: float
    learning_rate: float
    revision: int
    false_rate: float | None
    cancels: bool


@dataclass(frozen=True, kw_only=True)
class ProfileRecord:
    """Current profile of an agent, for everybody or of a layer."""

    agent: str
    layer: str
    revision: int
    values: Mapping[str, float | None]


@dataclass(frozen=True, kw_only=True)
class MoodRuleRecord:
    """Feedback of an agent's mood rule for a change of mood during a run.

    Attributes:
        changes: Smallest changes of the mood, down and up, that make ``when`` true; empty
            if it depends on anything else.
    """

    when: str
    changes: tuple[float, ...]
    hold_s: float
    give: Annotated[str, _FEEDBACK]
    cancels: bool


@dataclass(frozen=True, kw_only=True)
class AgentRecord:
    """Published description of an agent."""

    name: str
    title: str
    description: str
    tags: tuple[str, ...]
    host: str
    profile: Mapping[str, float | None]
    current: Mapping[str, float | None]
    revision: int
    learning_rate: float
    rules: tuple[MoodRuleRecord, ...]
    version: int
    waiting: bool
    degraded: bool
    problems: tuple[ProblemRecord, ...]


@dataclass(frozen=True, kw_only=True)
class HostRecord:
    """A host of agents."""

    host: str
    instance: str
    trees: str
    agents: tuple[str, ...]
    broken_files: tuple[str, ...]
    problems: tuple[ProblemRecord, ...]


@dataclass(frozen=True, kw_only=True)
class HealthRecord:
    """Health of a part of a node, as reported by this system or another one."""

    level: str
    message: str
    values: Mapping[str, str]
    since_s: float


@dataclass(frozen=True, kw_only=True)
class TunableRecord:
    """A value that may be changed at run time; names as in ``TunableInfo``."""

    name: str
    host: str
    agent: str
    key: str
    kind: Annotated[str, Names(("TUNABLE", "LEARNING_RATE", "TICK_RATE"))]
    type: Annotated[
        str, Names(("NUMBER", "DURATION", "LENGTH", "ANGLE", "INTEGER", "BOOLEAN", "TEXT"))
    ]
    unit: str
    default: Json
    value: Json
    minimum: float | None
    maximum: float | None
    step: float
    description: str


@dataclass(frozen=True, kw_only=True)
class TuningRecord:
    """One change of a value."""

    at_s: Stamp
    revision: int
    author: str
    reason: str
    name: str
    before: str
    after: str
    undoable: bool


@dataclass(frozen=True, kw_only=True)
class PresetRecord:
    """Values that are applied together under a name.

    Attributes:
        values: Values in an author's notation.
        settings: The same as numbers in SI units, Booleans and texts.
    """

    name: str
    values: Mapping[str, str]
    settings: Mapping[str, Json]


@dataclass(frozen=True, kw_only=True)
class TuningsRecord:
    """Tunings of a host."""

    revision: int
    tunings: tuple[TuningRecord, ...]
    undo: str
    redo: str
    presets: tuple[PresetRecord, ...]


@dataclass(frozen=True, kw_only=True)
class QuestionRecord:
    """A question that waits for an answer; without choices, it accepts any answer."""

    at_s: Stamp
    text: str
    choices: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class QuestionsRecord:
    """All questions that wait for an answer, in order."""

    questions: tuple[QuestionRecord, ...]


@dataclass(frozen=True, kw_only=True)
class RobotActRecord:
    """A current act of the robot; ``kind`` is SAY, ASK, SHOW or DRIVE.

    Attributes:
        number: Number of the act since the start of the robot.
        waiting: Whether an answer is expected now.
    """

    at_s: Stamp
    number: int
    kind: Annotated[str, Names(("", "SAY", "ASK", "SHOW", "DRIVE"))]
    text: str
    clip: str
    choices: tuple[str, ...]
    rate: float
    waiting: bool


@dataclass(frozen=True, kw_only=True)
class RobotRecord:
    """Current state of the robot, as a person perceives it."""

    acts: tuple[RobotActRecord, ...]
    light: str
    light_blinks: bool
    sound: str
    sounds: int


@dataclass(frozen=True, kw_only=True)
class MoodRecord:
    """The mood of the person at one moment of a run."""

    at_s: float
    mood: float


@dataclass(frozen=True, kw_only=True)
class FileRecord:
    """Text of a file that agents are read from."""

    text: str


@dataclass(frozen=True, kw_only=True)
class PartRecord:
    """A part of the system, known by its heartbeat or its latched messages.

    Attributes:
        alive: False if its silence exceeds the limit for its heartbeat.
        seen_s: Time of its last message.
    """

    alive: bool
    seen_s: float


@dataclass(frozen=True, kw_only=True)
class RecordingRecord:
    """Whether everything is recorded, and the current or last recording."""

    since_s: Stamp
    recording: bool
    folder: str
    file: str
    label: str
    notes: str
    author: str
    bookmarks: int


@dataclass(frozen=True, kw_only=True)
class BookmarkRecord:
    """A bookmark in a recording."""

    at_s: Stamp
    label: str
    notes: str
    author: str


@dataclass(frozen=True, kw_only=True)
class ListeningRecord:
    """A topic that a tree subscribes to, with the fields of its messages and their types."""

    type: str
    fields: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class JournalRecord:
    """A file of the journal, or a bag beside them, as an entry of their list."""

    name: str
    bytes: int
    label: str


@dataclass(frozen=True, kw_only=True)
class SceneMapRecord:
    """Winners over two scene parameters.

    Attributes:
        xs: Values of the parameter ``across``.
        ys: Values of the parameter ``up``.
        agents: Agents that win anywhere; empty for none.
        winners: Index into ``agents`` of the winner at each point, row by row, lowest row first.
        is_asked: Whether the market was asked for each point; else it is computed from the bids.
    """

    across: str
    up: str
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    agents: tuple[str, ...]
    winners: tuple[int, ...]
    is_asked: bool


@dataclass(frozen=True, kw_only=True)
class DryRunRecord:
    """Predicted decision for a scene and, if requested, for the scenes around it."""

    round: RoundRecord
    map: SceneMapRecord | None


@dataclass(frozen=True, kw_only=True)
class PersonLinkRecord:
    """Address of the page Person; a phone can open it unless only this machine can reach it."""

    address: str
    is_local: bool


@dataclass(frozen=True, kw_only=True)
class StrategyOptionRecord:
    """An option of a strategy, and its value in force."""

    name: str
    value: float
    minimum: float
    maximum: float
    description: str


@dataclass(frozen=True, kw_only=True)
class StrategiesRecord:
    """The options of each strategy of the market."""

    options: Mapping[str, tuple[StrategyOptionRecord, ...]]


@dataclass(frozen=True, kw_only=True)
class KeepRecord:
    """Changes of the agents' files if tuned values are kept.

    Attributes:
        diff: Differences of all files as text; empty without a change.
        tests: Results of the agents' tests as lines.
        breaks: Whether a test that passes now would fail.
        digest: Identifies exactly this change in its confirmation.
    """

    diff: str
    tests: tuple[str, ...]
    breaks: bool
    digest: str


COLLECTIONS: Mapping[str, type] = {
    "agents": AgentRecord,
    "controls": ControlRecord,
    "countdowns": CountdownRecord,
    "bookmarks": BookmarkRecord,
    "events": EventRecord,
    "feedback": ProfileStepRecord,
    "files": FileRecord,
    "health": HealthRecord,
    "hosts": HostRecord,
    "listening": ListeningRecord,
    "live": SceneRecord,
    "log": LogRecord,
    "market": MarketRecord,
    "moods": MoodRecord,
    "nodes": NodeRecord,
    "parts": PartRecord,
    "profiles": ProfileRecord,
    "questions": QuestionsRecord,
    "robot": RobotRecord,
    "recording": RecordingRecord,
    "rounds": RoundRecord,
    "runs": RunRecord,
    "scene": SceneRecord,
    "trees": TreeRecord,
    "tunables": TunableRecord,
    "tunings": TuningsRecord,
    "values": NodeValuesRecord,
}
"""Collection → the type of its values.

Keys: agents, runs and trees by agent; controls, hosts, tunings and parts by name; health by the
part of a node, as ``/diagnostics`` names it; countdowns, nodes and values by ``agent|path``;
profiles by ``agent|layer``; feedback by ``agent|layer|revision``; files by ``host|path``; tunables
by ``host|parameter``; rounds by ``epoch/round``; listening by topic; log and moods by number;
bookmarks by their time; events by their subject; the others have one entry, of key "".
"""

MOST_ENTRIES: Mapping[str, int] = {
    "bookmarks": 1000,
    "events": 1000,
    "feedback": 500,
    "files": 500,
    "health": 500,
    "log": 1000,
    "moods": 1200,
    "rounds": 100,
}
"""Collection → maximum number of entries, if it differs from the default."""

ROLLING = frozenset({"bookmarks", "events", "feedback", "log", "moods", "rounds"})
"""Collections that always drop their oldest entries."""

OF_AN_AGENT = frozenset({"agents", "profiles", "runs", "trees"})
"""Collections whose keys begin with an agent, shown as long as the agent's host exists."""

OF_A_RUN = frozenset({"countdowns", "nodes", "values"})
"""Collections whose keys begin with an agent, about its last run."""

OF_A_HOST = frozenset({"controls", "hosts", "parts", "tunables", "tunings"})
"""Collections whose keys begin with a host or another part of the system."""

OF_A_PERSON = frozenset({"live", "parts", "robot"})
"""Collections that a session of a person may see."""

OF_THE_PRESENT = frozenset(
    {"agents", "bookmarks", "events", "live", "market", "parts", "recording", "runs", "trees"}
)
"""Collections that a page shows as of now, even while it shows an earlier moment."""
