# SPDX-License-Identifier: Apache-2.0
"""Rows of the ledger: what they say, how they are written, and the hashes that chain them."""

from __future__ import annotations

import hashlib
import json
import math
import os
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

AUTHORED = "authored"
LAYER = "layer"
FEEDBACK = "feedback"
UNDO = "undo"
RESET = "reset"
IMPORT = "import"
FORGOTTEN = "forgotten"

STARTS = (AUTHORED, LAYER)
"""Causes of revisions behind which no undo goes back."""

FORGOTTEN_LAYER = "forgotten/"
"""Begins the name under which the rows of a forgotten layer stay."""

NO_CHAIN = bytes(32)
"""Chain value before the first row."""

COLUMNS = "number, agent, layer, revision, feedback_id, content, salt, digest, chain"
INSERT = f"INSERT INTO revision ({COLUMNS}) VALUES (?,?,?,?,?,?,?,?,?)"

_HIDDEN = "sha256:"
_SALT_BYTES = 16


@dataclass(frozen=True, kw_only=True)
class RevisionCause:
    """Why a profile has changed.

    Attributes:
        cause: ``authored``, ``layer`` (where one begins), ``feedback``, ``undo``, ``reset``,
            ``import`` or ``forgotten``.
        kind: Number of the feedback's kind as in ``Feedback.msg``; 0 for no feedback.
        source: Who gave it.
        reason: Why, in words.
        feedback_id: Unique among all feedback; None for a change without feedback.
        epoch: Market of the run; may be empty.
        round: Round of the run; 0 for none.
        rate: Learning rate of the agent.
        weight: Of the source; the rate was multiplied by it.
        rates: Parameter → what it has moved by, where that is not ``rate``.
        target: Parameter → value moved towards or away from, without those that had no opinion;
            of an authored revision the profile as its file has it.
        scene_id: Scene of the run; may be empty.
        leaf: Path of the node that was running; may be empty.
        cancels: True when the run is stopped because of it.
        restores: Of an undo, the revision whose profile it brings back.
        changes: How many feedbacks, without those that set a profile, have led to it.
        seal: Of ``forgotten``, the hash of what has stayed of the rows, in hexadecimal digits.
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
    scene_id: str = ""
    leaf: str = ""
    cancels: bool = False
    restores: int | None = None
    changes: int = 0
    seal: str = ""


@dataclass(frozen=True, kw_only=True)
class ProfileRevision:
    """One row of the ledger.

    Attributes:
        agent: Whose profile.
        layer: Empty for everybody's, ``person/anna``, ``place/lobby``.
        revision: Counts up from 0 in each layer; 0 is what the agent's file began with, or what
            the layer began with.
        profile: Parameter → value; empty when it was forgotten.
        cause: Why it was written.
        stamp: Wall time of the entry [s].
    """

    agent: str
    layer: str = ""
    revision: int
    profile: Mapping[str, float]
    cause: RevisionCause
    stamp: float


class Row(NamedTuple):
    """A revision as it is written, in the order of :data:`COLUMNS`.

    Attributes:
        number: Place in the chain, from 1.
        agent: Whose.
        layer: Which.
        revision: Of the layer.
        feedback_id: None without one.
        content: The rest as JSON; None when it was forgotten.
        salt: Random bytes, which keep a forgotten content from being guessed by its digest; None
            when it was forgotten.
        digest: See :func:`digest_of`; stays when the content is forgotten.
        chain: See :func:`chained`.
    """

    number: int
    agent: str
    layer: str
    revision: int
    feedback_id: str | None
    content: str | None
    salt: bytes | None
    digest: bytes
    chain: bytes


class Damaged(ValueError):
    """A row is not what was written."""


_PLAIN = vars(RevisionCause())
_CAUSE_NAMES = _PLAIN.keys() - {"feedback_id"}
_MAPPINGS = ("rates", "target")
_JSON = json.JSONEncoder(allow_nan=False, separators=(",", ":"))


def row_of(number: int, revision: ProfileRevision, chain: bytes) -> Row:
    """Return a revision as a row behind the one whose chain value is given.

    Raises:
        ValueError: A value of it is not finite, or a text is none that can be written.
    """
    cause = revision.cause
    written: dict[str, Any] = {"profile": dict(revision.profile), "stamp": revision.stamp}
    for name, value in vars(cause).items():
        if value != _PLAIN[name]:
            written[name] = dict(value) if name in _MAPPINGS else value
    written.pop("feedback_id", None)
    content = _JSON.encode(written)
    salt = os.urandom(_SALT_BYTES)
    head = (revision.agent, revision.layer, revision.revision, cause.feedback_id)
    digest = digest_of(salt, number, *head, content)
    return Row(number, *head, content, salt, digest, chained(chain, digest))


def check_content(row: Row) -> None:
    """Check the digest of a row that has a content.

    Raises:
        Damaged: It is not what was written.
        TypeError: A value has another type than what was written.
    """
    number, agent, layer, revision, feedback_id, content, salt, digest, _ = row
    if salt is None or content is None:
        raise Damaged("its salt is lost")
    if digest_of(salt, number, agent, layer, revision, feedback_id, content) != digest:
        raise Damaged(f"revision {revision} of {name_of(agent, layer)} is not what was written")


def read_row(row: Row) -> ProfileRevision:
    """Return a row of the table as it was written; a forgotten one without its content.

    Raises:
        Damaged: It is not what was written.
    """
    _, agent, layer, revision, feedback_id, content, _, _, _ = row
    try:
        if content is None:
            cause = RevisionCause(cause=FORGOTTEN, feedback_id=feedback_id)
            return ProfileRevision(
                agent=agent, layer=layer, revision=revision, profile={}, cause=cause, stamp=0.0
            )
        check_content(row)
        told = json.loads(content)
        profile, stamp = _numbers(told.pop("profile")), float(told.pop("stamp"))
        if not told.keys() <= _CAUSE_NAMES:
            raise Damaged(f"revision {revision} of {name_of(agent, layer)} has unknown fields")
        for name in _MAPPINGS:
            told[name] = _numbers(told.get(name, {}))
        return ProfileRevision(
            agent=agent,
            layer=layer,
            revision=revision,
            profile=profile,
            cause=RevisionCause(feedback_id=feedback_id, **told),
            stamp=stamp,
        )
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise Damaged(str(error)) from error


def digest_of(
    salt: bytes,
    number: int,
    agent: str,
    layer: str,
    revision: int,
    feedback_id: str | None,
    content: str,
) -> bytes:
    """Return SHA-256 of the salt and of everything that a row says."""
    id_length = -1 if feedback_id is None else len(feedback_id)
    head = f"{number} {revision} {len(agent)} {len(layer)} {id_length} "
    text = f"{head}{agent}{layer}{feedback_id or ''}{content}"
    return hashlib.sha256(salt + text.encode()).digest()


def chained(chain: bytes, digest: bytes) -> bytes:
    """Return the next value of the chain: ``SHA-256(chain before ‖ digest)``."""
    return hashlib.sha256(chain + digest).digest()


def rest_of(number: int, agent: str, revision: int, feedback_id: str | None) -> bytes:
    """Return what has stayed of a forgotten row as bytes for the seal of its layer."""
    return f"{number} {revision} {len(agent)} {agent} {feedback_id or ''}\n".encode()


def hidden(feedback_id: str) -> str:
    """Return what stays of the id of a forgotten feedback, so that it is not applied again."""
    if feedback_id.startswith(_HIDDEN):
        return feedback_id
    return _HIDDEN + hashlib.sha256(feedback_id.encode()).hexdigest()


def is_hidden(feedback_id: str) -> bool:
    """Return True for what :func:`hidden` returns."""
    return feedback_id.startswith(_HIDDEN)


def name_of(agent: str, layer: str) -> str:
    """Return a profile in words: the agent, and the layer where it is not everybody's."""
    return f"{agent} for {layer}" if layer else agent


def rows(database: sqlite3.Connection, where: str, *values: str | int) -> list[ProfileRevision]:
    """Select revisions.

    Raises:
        Damaged: One of them is not what was written.
        sqlite3.Error: The file cannot be read.
    """
    found = database.execute(f"SELECT {COLUMNS} FROM revision {where}", values)
    return [read_row(Row(*row)) for row in found]


def _numbers(told: Any) -> dict[str, float]:
    values = {str(name): float(value) for name, value in told.items()}
    if not all(map(math.isfinite, values.values())):
        raise Damaged(f"a profile holds a value that is not finite: {told}")
    return values
