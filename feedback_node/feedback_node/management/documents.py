# SPDX-License-Identifier: Apache-2.0
"""Exports and imports profiles and their history as JSON documents."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeGuard

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.profile_layers import checked_layer
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from feedback_node.ledger import LedgerEntry
from feedback_node.ledger.rows import IMPORT, ProfileRevision, RevisionCause

FORMAT = 1
LONGEST = 4_000_000
"""Most characters of an imported document."""

_MOST = 100_000
_LONGEST_NAME = 200


def to_document(
    profiles: Iterable[Mapping[str, Any]],
    revisions: Iterable[ProfileRevision],
    *,
    document_id: str,
) -> str:
    """Return a document of summaries and their history; its id makes it importable only once."""
    return json.dumps(
        {
            "format": FORMAT,
            "id": document_id,
            "profiles": list(profiles),
            "revisions": [_revision(one) for one in revisions],
        },
        allow_nan=False,
    )


def from_document(
    document: Any, space: SceneSpace, *, source: str, reason: str
) -> tuple[LedgerEntry, ...]:
    """Check a document from :func:`read_json`; return the revisions to record.

    Raises:
        Refused: ``BAD_DOCUMENT``, ``BAD_LAYER``, ``UNKNOWN_PARAMETER``, or as in
            :meth:`SceneSpace.vector`.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise _invalid(f"expected what 'bt-agents profile export' writes, with format {FORMAT}")
    document_id, profiles = document.get("id"), document.get("profiles")
    if not _is_name(document_id):
        raise _invalid(f"its id is not a printable text of 1 to {_LONGEST_NAME} characters")
    if not isinstance(profiles, list) or not 1 <= len(profiles) <= _MOST:
        raise _invalid(f"expected 1 to {_MOST} profiles")
    cause = RevisionCause(cause=IMPORT, kind=FeedbackKind.SET, source=source, reason=reason)
    found: dict[tuple[str, str], LedgerEntry] = {}
    for index, one in enumerate(profiles):
        entry = _entry(one, f"profiles[{index}]", space, f"import/{document_id}", cause)
        if (entry.agent, entry.layer) in found:
            raise _invalid(f"profiles[{index}]: {entry.agent} {entry.layer} stands twice")
        found[entry.agent, entry.layer] = entry
    return tuple(found.values())


def read_json(text: str) -> Any:
    """Return the unchecked content of a document from outside.

    Raises:
        Refused: ``TOO_LONG`` or ``BAD_DOCUMENT``.
    """
    if len(text) > LONGEST:
        raise Refused(
            RefusalCode.TOO_LONG, f"document: {len(text)} characters, expected {LONGEST} at most"
        )
    try:
        return json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise _invalid(f"it is not JSON ({error})") from None


def _entry(
    fields: Any, what: str, space: SceneSpace, prefix: str, cause: RevisionCause
) -> LedgerEntry:
    if not isinstance(fields, dict):
        raise _invalid(f"{what}: expected a mapping")
    agent, layer, values = fields.get("agent"), fields.get("layer", ""), fields.get("values")
    if not _is_name(agent):
        raise _invalid(f"{what}: its agent is not a name")
    changes = fields.get("changes", 0)
    if isinstance(changes, bool) or not isinstance(changes, int) or not 0 <= changes < 2**63:
        raise _invalid(f"{what}: its changes are not a count")
    if not isinstance(layer, str) or not isinstance(values, dict):
        raise _invalid(f"{what}: expected a layer, which may be empty, and values by parameter")
    if any(isinstance(v, bool) or not isinstance(v, int | float) for v in values.values()):
        raise _invalid(f"{what}: a value is not a number")
    layer = checked_layer(layer) if layer else ""
    profile = space.named(space.from_mapping(values, what=f"document: {what}"))
    feedback_id = f"{prefix}/{agent}/{layer}"
    cause = replace(cause, feedback_id=feedback_id, target=profile, changes=changes)
    return LedgerEntry(agent=agent, layer=layer, profile=profile, cause=cause)


def _is_name(value: Any) -> TypeGuard[str]:
    return isinstance(value, str) and 1 <= len(value) <= _LONGEST_NAME and value.isprintable()


def _revision(revision: ProfileRevision) -> dict[str, Any]:
    cause = revision.cause
    fields = {name: value for name, value in vars(cause).items() if value or name == "cause"}
    fields.pop("step", None)  # the other fields have its effect; it is too large
    for name in ("rates", "target"):
        if name in fields:
            fields[name] = dict(fields[name])
    return {
        "agent": revision.agent,
        "layer": revision.layer,
        "revision": revision.revision,
        "stamp": revision.stamp,
        "values": dict(revision.profile),
        **fields,
    }


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _invalid(found: str) -> Refused:
    return Refused(RefusalCode.BAD_DOCUMENT, f"document: {found}; nothing was taken in")
