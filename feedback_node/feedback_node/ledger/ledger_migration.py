# SPDX-License-Identifier: Apache-2.0
"""Rewrites a ledger of format 1, which had no layers and no chain, as one of format 2."""

from __future__ import annotations

import json
import sqlite3

from feedback_node.ledger.ledger_layout import lay_out
from feedback_node.ledger.ledger_rows import (
    INSERT,
    NO_CHAIN,
    Damaged,
    ProfileRevision,
    RevisionCause,
    row_of,
    rows,
)

_OLD = (
    "agent, revision, profile, cause, kind, source, reason, feedback_id, epoch, round, rate, "
    "target, scene_id, cancels, restores, stamp"
)
_FEEDBACK_KINDS = (0, 1, 2)


def migrate(database: sqlite3.Connection) -> None:
    """Rewrite all rows, inside a transaction of the caller.

    Raises:
        sqlite3.Error: It cannot be read or written.
        Damaged: A row of it makes no sense, or is not read back as it was.
    """
    found = database.execute(f"SELECT {_OLD} FROM revision ORDER BY agent, revision").fetchall()
    for trigger in ("revision_no_UPDATE", "revision_no_DELETE"):
        database.execute(f"DROP TRIGGER IF EXISTS {trigger}")
    database.execute("DROP TABLE revision")
    lay_out(database)
    old = _revisions(found)
    chain = NO_CHAIN
    for number, revision in enumerate(old, start=1):
        row = row_of(number, revision, chain)
        chain = row.chain
        database.execute(INSERT, row)
    if rows(database, "ORDER BY number") != old:
        raise Damaged("a revision was not read back as it was")


def _revisions(found: list[tuple[object, ...]]) -> list[ProfileRevision]:
    revisions: list[ProfileRevision] = []
    try:
        for row in found:
            revision = _revision(row)
            _check_place(revision, revisions)
            changes = _changes(revision, revisions)
            cause = RevisionCause(**{**vars(revision.cause), "changes": changes})
            revisions.append(ProfileRevision(**{**vars(revision), "cause": cause}))
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        raise Damaged(f"row {len(revisions) + 1}: {error}") from error
    return revisions


def _check_place(revision: ProfileRevision, before: list[ProfileRevision]) -> None:
    last = before[-1] if before and before[-1].agent == revision.agent else None
    expected = last.revision + 1 if last else 0
    if revision.revision != expected:
        raise Damaged(f"revision {expected} of {revision.agent} is not there")


def _changes(revision: ProfileRevision, before: list[ProfileRevision]) -> int:
    """Return how many feedbacks have led to a profile; see :class:`RevisionCause`."""
    cause = revision.cause
    if cause.restores is not None:
        return before[cause.restores - revision.revision].cause.changes
    if cause.cause != "feedback" or not revision.revision:
        return 0
    return before[-1].cause.changes + (cause.kind in _FEEDBACK_KINDS)


def _revision(row: tuple[object, ...]) -> ProfileRevision:
    agent, number, profile, cause, kind, source, reason, feedback_id, epoch, round_ = row[:10]
    rate, target, scene_id, cancels, restores, stamp = row[10:]
    return ProfileRevision(
        agent=str(agent),
        revision=int(str(number)),
        profile=_values(profile),
        cause=RevisionCause(
            cause=str(cause),
            kind=int(str(kind)),
            source=str(source),
            reason=str(reason),
            feedback_id=None if feedback_id is None else str(feedback_id),
            epoch=str(epoch),
            round=int(str(round_)),
            rate=float(str(rate)),
            target=_values(target),
            scene_id=str(scene_id),
            cancels=bool(cancels),
            restores=None if restores is None else int(str(restores)),
        ),
        stamp=float(str(stamp)),
    )


def _values(text: object) -> dict[str, float]:
    return {str(name): float(value) for name, value in json.loads(str(text)).items()}
