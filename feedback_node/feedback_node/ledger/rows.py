# SPDX-License-Identifier: Apache-2.0
"""Rows of the ledger: the table, the revision in each row, and its checksum."""

from __future__ import annotations

import hashlib
import json
import math
import sqlite3
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

FORMAT = 3
APPLICATION = 0x62746167  # "btag"

AUTHORED = "authored"
LAYER = "layer"
FEEDBACK = "feedback"
UNDO = "undo"
RESET = "reset"
IMPORT = "import"
FLEET = "fleet"
FORGOTTEN = "forgotten"

FORGOTTEN_LAYER = "forgotten/"
"""Prefix of the layer of erased rows; the number of the first row follows."""

COLUMNS = "number, agent, layer, revision, feedback_id, content, checksum"
INSERT = f"INSERT INTO revision ({COLUMNS}) VALUES (?,?,?,?,?,?,?)"

_SCHEMA = (
    """CREATE TABLE revision (
    number INTEGER PRIMARY KEY,
    agent TEXT NOT NULL,
    layer TEXT NOT NULL,
    revision INTEGER NOT NULL,
    feedback_id TEXT,
    content TEXT,
    checksum INTEGER NOT NULL
)""",
    "CREATE TABLE pending (task TEXT PRIMARY KEY)",
    "CREATE UNIQUE INDEX revision_of_layer ON revision (agent, layer, revision)",
    "CREATE UNIQUE INDEX revision_of_feedback ON revision (feedback_id, layer)",
    """CREATE TRIGGER revision_no_delete BEFORE DELETE ON revision
BEGIN SELECT RAISE(ABORT, 'revisions are never deleted; append a new one'); END""",
    """CREATE TRIGGER revision_no_update BEFORE UPDATE ON revision
WHEN NOT (new.content IS NULL AND new.number IS old.number
    AND new.agent IS old.agent AND new.revision IS old.revision)
BEGIN SELECT RAISE(ABORT, 'revisions are never changed; append a new one'); END""",
)

LONGEST_TEXT = 1000
"""Most characters of a text in feedback."""

_HIDDEN = "sha256:"


@dataclass(frozen=True, kw_only=True)
class RevisionCause:
    """Reason for a revision.

    Attributes:
        cause: ``authored``, ``layer`` (where one begins), ``feedback``, ``undo``, ``reset``,
            ``import`` or ``forgotten``.
        kind: Number of the feedback's kind as in ``Feedback.msg``; 0 for no feedback.
        feedback_id: Unique id of the feedback; None for a change without feedback.
        epoch: Market of the run; may be empty.
        round: Round of the run; 0 for none.
        rate: Learning rate of the agent.
        weight: Weight of the source, multiplied with the rate.
        rates: Parameter → its effective rate, where it differs from ``rate``.
        target: Parameter → value that it moved towards or away from, without parameters without
            an opinion; for an authored revision, the profile in the file.
        retreat: Parameter → value that negative feedback moved it towards, because the profile
            was on the scene.
        scene_id: Scene of the run; may be empty.
        leaf: Path of the node that was running; may be empty.
        cancels: True if the revision stops the run.
        restores: For an undo, the revision whose profile it restores.
        changes: Number of feedbacks that led to it, without those that set a profile.
        step: For ``fleet``, the step of another robot as in
            :meth:`feedback_node.learning.fleet_steps.FleetStep.fields`; empty if only the order of
            the steps has changed. For ``forgotten``, such a step if another robot has forgotten
            it; else the result of :func:`hidden_layer` and the stamp up to which it is forgotten.
    """

    cause: str = FEEDBACK
    kind: int = 0
    source: str = ""
    reason: str = ""
    feedback_id: str | None = None
    epoch: str = ""
    round: int = 0
    rate: float = 0.0
    weight: float = 1.0
    rates: Mapping[str, float] = field(default_factory=dict)
    target: Mapping[str, float] = field(default_factory=dict)
    retreat: Mapping[str, float] = field(default_factory=dict)
    scene_id: str = ""
    leaf: str = ""
    cancels: bool = False
    restores: int | None = None
    changes: int = 0
    step: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ProfileRevision:
    """Profile of an agent or one of its layers, from one change to the next.

    Attributes:
        layer: ``person/anna``, ``place/lobby``; empty for the profile for everybody.
        revision: Counts up from 0 in each layer; 0 is the first profile of the agent's file or of
            the layer.
        profile: Parameter → value; empty if it was forgotten.
        stamp: Wall time of the entry [s].
    """

    agent: str
    layer: str = ""
    revision: int
    profile: Mapping[str, float]
    cause: RevisionCause
    stamp: float


class Row(NamedTuple):
    """Row of the table, in the order of :data:`COLUMNS`.

    Attributes:
        number: Position in the order of entry.
        feedback_id: None without one; its hash if it was forgotten.
        content: The rest as JSON; None if it was forgotten.
    """

    number: int
    agent: str
    layer: str
    revision: int
    feedback_id: str | None
    content: str | None
    checksum: int = 0

    @property
    def name(self) -> str:
        """The revision, for messages."""
        return f"revision {self.revision} of {name_of(self.agent, self.layer)}"

    @property
    def is_intact(self) -> bool:
        """True if the checksum of the row matches its content."""
        try:
            return checksum_of(self) == self.checksum
        except (TypeError, ValueError):
            return False


class Damaged(ValueError):
    """A row is damaged: its checksum does not fit."""


_DEFAULTS = vars(RevisionCause())
_CAUSE_NAMES = _DEFAULTS.keys() - {"feedback_id"}
_MAPPINGS = ("rates", "target", "retreat")
"""Parameter → number."""

_JSON = json.JSONEncoder(allow_nan=False, separators=(",", ":"))


def create_tables(database: sqlite3.Connection) -> None:
    """Create the tables of an empty ledger, in a transaction of the caller."""
    database.execute(f"PRAGMA application_id = {APPLICATION}")
    database.execute(f"PRAGMA user_version = {FORMAT}")
    for statement in _SCHEMA:
        database.execute(statement)


def has_tables(database: sqlite3.Connection) -> bool:
    """Return whether a file has the tables, indexes and triggers of a ledger."""
    found = database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")
    return sorted(str(sql) for (sql,) in found) == sorted(_SCHEMA)


def checksum_of(row: Row) -> int:
    """Return the CRC-32 of everything before the checksum, as a JSON array.

    Raises:
        TypeError, ValueError: A value has the wrong type for a row.
    """
    return zlib.crc32(_JSON.encode(row[:-1]).encode())


def with_checksum(row: Row) -> Row:
    """Return a row with the checksum of its content."""
    return row._replace(checksum=checksum_of(row))


def row_of(number: int, revision: ProfileRevision) -> Row:
    """Return a revision as a row.

    Raises:
        ValueError: One of its values is not finite.
    """
    cause = revision.cause
    content: dict[str, Any] = {"profile": dict(revision.profile), "stamp": revision.stamp}
    for name, value in vars(cause).items():
        if value != _DEFAULTS[name]:
            content[name] = dict(value) if isinstance(value, Mapping) else value
    content.pop("feedback_id", None)
    key = (revision.agent, revision.layer, revision.revision, cause.feedback_id)
    return with_checksum(Row(number, *key, _JSON.encode(content)))


def read_row(row: Row) -> ProfileRevision:
    """Return the revision of a row; a forgotten one without its content.

    Raises:
        Damaged: The checksum of the row does not fit.
    """
    if not row.is_intact:
        raise Damaged(f"{row.name} (row {row.number}) is damaged")
    number, agent, layer, revision, feedback_id, content, _ = row
    if content is None:
        cause = RevisionCause(cause=FORGOTTEN, feedback_id=feedback_id)
        return ProfileRevision(
            agent=agent, layer=layer, revision=revision, profile={}, cause=cause, stamp=0.0
        )
    try:
        fields = json.loads(content)
        profile, stamp = _numbers(fields.pop("profile")), float(fields.pop("stamp"))
        if not fields.keys() <= _CAUSE_NAMES:
            raise Damaged(f"{row.name} (row {number}) has unknown fields")
        for name in _MAPPINGS:
            fields[name] = _numbers(fields.get(name, {}))
        return ProfileRevision(
            agent=agent,
            layer=layer,
            revision=revision,
            profile=profile,
            cause=RevisionCause(feedback_id=feedback_id, **fields),
            stamp=stamp,
        )
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise Damaged(str(error)) from error


def hidden(feedback_id: str) -> str:
    """Return the hash that replaces the id of forgotten feedback, so it is not applied again."""
    if is_hidden(feedback_id):
        return feedback_id
    return _HIDDEN + hashlib.sha256(feedback_id.encode()).hexdigest()


def hidden_layer(layer: str) -> str:
    """Return the hash that replaces the name of a forgotten layer and identifies it in a fleet."""
    kind, _, _ = layer.partition("/")
    return f"{kind}/{hidden(layer)}"


def is_hidden(feedback_id: str) -> bool:
    """Return whether an id is a result of :func:`hidden`."""
    return feedback_id.startswith(_HIDDEN)


def name_of(agent: str, layer: str) -> str:
    """Return the name of a profile: the agent, and the layer if there is one."""
    return f"{agent} for {layer}" if layer else agent


def _numbers(values: Any) -> dict[str, float]:
    numbers = {str(name): float(value) for name, value in values.items()}
    if not all(map(math.isfinite, numbers.values())):
        raise Damaged(f"a profile holds a value that is not finite: {values}")
    return numbers


def check_texts(**texts: str) -> None:
    """Check the texts of a feedback, given by field name.

    Raises:
        Refused: ``TOO_LONG``, ``BAD_TEXT`` or ``RESERVED_ID``.
    """
    for name, text in texts.items():
        if len(text) > LONGEST_TEXT:
            raise Refused(
                RefusalCode.TOO_LONG,
                f"feedback: {name} has {len(text)} characters, expected {LONGEST_TEXT} at most",
            )
        if not text.isprintable():
            raise Refused(
                RefusalCode.BAD_TEXT,
                f"feedback: {name} is {text[:80]!a}, expected no control characters",
            )
    if is_hidden(texts.get("feedback_id", "")):
        raise Refused(
            RefusalCode.RESERVED_ID,
            "feedback: ids that begin with 'sha256:' stand for forgotten ones; take a UUID",
        )
