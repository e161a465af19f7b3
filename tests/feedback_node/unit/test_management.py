# SPDX-License-Identifier: Apache-2.0
"""Management of profiles: each order takes effect completely, or is refused with a code."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from feedback_node.management.management import ManagementAction
from ledger_fixture import ManagedLedger

ANNA, LOBBY = "person/anna", "place/lobby"
DAY = 86_400.0


@pytest.fixture
def managed() -> ManagedLedger:
    return ManagedLedger()


def test_undo_and_reset_are_revisions_delivered_to_hosts(managed):
    managed.teach("f1")
    managed.teach("f2")
    why = {"author": "eva", "reason": "wrong button"}
    done = managed.execute(ManagementAction.UNDO, agent="guide", **why)
    assert done.message == "guide: age 4.5 → 4 (revision 3)"
    assert [(c.revision.revision, c.after) for c in done.changes] == [(3, (4.0, 3.0))]
    cause = done.changes[0].revision.cause
    assert (cause.source, cause.reason, cause.kind) == ("eva", "wrong button", FeedbackKind.SET)
    done = managed.execute(ManagementAction.RESET, agent="guide")
    assert done.message == "guide: age 4 → 3 (revision 4)"
    assert managed.current_profiles()["guide", ""] == (3.0, 3.0)


def test_history_lists_every_revision_with_its_cause(managed):
    managed.teach("f1")
    answer = managed.document(ManagementAction.HISTORY, agent="guide")
    found = [(r["revision"], r["cause"], r["values"]["age"]) for r in answer["revisions"]]
    assert found == [(0, "authored", 3.0), (1, "feedback", 4.0)]
    assert answer["profiles"][0]["false_rate"] is None


def test_history_without_agent_lists_all_current_profiles(managed):
    managed.teach_layer(ANNA)
    answer = managed.document(ManagementAction.HISTORY)
    found = [(p["agent"], p["layer"]) for p in answer["profiles"]]
    assert found == [("express", ""), ("guide", ""), ("guide", ANNA)]
    assert answer["revisions"] == []


def test_export_is_imported_once_and_restores_profiles(managed):
    managed.teach("f1")
    managed.teach_layer(ANNA)
    document = managed.execute(ManagementAction.EXPORT).document
    other = ManagedLedger()
    other.teach("f9")
    done = other.execute(ManagementAction.IMPORT, document=document, author="eva")
    assert other.current_profiles() == managed.current_profiles()
    assert len(done.changes) == 3
    before = other.profiles.table()
    again = other.execute(ManagementAction.IMPORT, document=document)
    assert again.message == "this document was taken in before; nothing has changed"
    assert other.profiles.table() == before
    # A layer of the document can be undone to its beginning.
    [undone] = other.execute(ManagementAction.UNDO, agent="guide", layer=ANNA).changes
    assert undone.after == (4.0, 3.0)


def test_export_holds_one_persons_profiles_with_history(managed):
    managed.teach_layer(ANNA)
    managed.teach_layer(ANNA, "express")
    managed.teach_layer(LOBBY)
    answer = managed.document(ManagementAction.EXPORT, layer=ANNA)
    found = {(p["agent"], p["layer"]) for p in answer["profiles"]}
    assert found == {("guide", ANNA), ("express", ANNA)}
    assert {r["layer"] for r in answer["revisions"]} == {ANNA}
    with pytest.raises(Refused, match="UNKNOWN_LAYER: no layer 'person/bob'; there are: pers"):
        managed.execute(ManagementAction.EXPORT, layer="person/bob")


def test_unknown_layer_does_not_list_every_person(managed):
    for number in range(50):
        managed.teach_layer(f"person/p{number:02}")
    with pytest.raises(Refused, match=r"p02, person/p03 and 46 more$"):
        managed.execute(ManagementAction.FORGET, layer="person/bob")


GOOD = {"agent": "guide", "layer": "", "values": {"age": 3.0, "mood": 3.0}}


def document(*profiles: Any, **fields: Any) -> str:
    return json.dumps({"format": 1, "id": "x", "profiles": list(profiles), **fields})


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "BAD_DOCUMENT"),
        ("[" * 100_000, "BAD_DOCUMENT"),
        ("[]", "BAD_DOCUMENT"),
        (document(), "BAD_DOCUMENT"),
        (document(GOOD, format=2), "BAD_DOCUMENT"),
        (document(GOOD, id=""), "BAD_DOCUMENT"),
        (document(GOOD, id=7), "BAD_DOCUMENT"),
        (document(GOOD, GOOD), "BAD_DOCUMENT"),
        (document("guide"), "BAD_DOCUMENT"),
        (document({**GOOD, "agent": 7}), "BAD_DOCUMENT"),
        (document({**GOOD, "values": [3.0, 3.0]}), "BAD_DOCUMENT"),
        (document({**GOOD, "values": {"age": True, "mood": 3.0}}), "BAD_DOCUMENT"),
        (document({**GOOD, "values": {"age": "3", "mood": 3.0}}), "BAD_DOCUMENT"),
        (document({**GOOD, "values": {"age": math.nan, "mood": 3.0}}), "BAD_DOCUMENT"),
        (document({**GOOD, "values": {"age": 10**400, "mood": 3.0}}), "NOT_A_NUMBER"),
        (document({**GOOD, "values": {"age": 9.0, "mood": 3.0}}), "OUT_OF_RANGE"),
        (document({**GOOD, "values": {"age": 3.0}}), "WRONG_LENGTH"),
        (document({**GOOD, "values": {"age": 3.0, "stress": 3.0}}), "UNKNOWN_PARAMETER"),
        (document({**GOOD, "layer": "forgotten/3"}), "BAD_LAYER"),
        (document({**GOOD, "layer": "person/" + "x" * 300}), "BAD_LAYER"),
        (document({**GOOD, "agent": "nobody"}, GOOD), "UNKNOWN_AGENT"),
        (document(GOOD, id="\ud800"), "BAD_DOCUMENT"),
        (document({**GOOD, "layer": "person/\ud800"}), "BAD_LAYER"),
        (document({**GOOD, "changes": -1}), "BAD_DOCUMENT"),
        (document({**GOOD, "changes": True}), "BAD_DOCUMENT"),
        (document({**GOOD, "changes": 1.5}), "BAD_DOCUMENT"),
        (document({**GOOD, "changes": 10**400}), "BAD_DOCUMENT"),
        (" " * 4_000_001, "TOO_LONG"),
    ],
)
def test_invalid_document_is_rejected_and_imports_nothing(managed, text, code):
    before = managed.profiles.table()
    with pytest.raises(Refused, match=f"^{code}:"):
        managed.execute(ManagementAction.IMPORT, document=text)
    assert managed.profiles.table() == before


def test_layers_unchanged_for_given_time_expire(managed):
    managed.teach_layer("person/old")
    managed.teach_layer("place/old")
    managed.now += 50 * DAY
    managed.teach_layer(ANNA)
    done = managed.execute(ManagementAction.EXPIRE, older_s=60 * DAY)
    assert done.message == "nothing to forget"
    done = managed.execute(ManagementAction.EXPIRE, older_s=40 * DAY, layer="person")
    assert done.message == "1 profile forgotten"
    [told] = done.deliveries
    assert (told.agent, told.layer, told.remove) == ("guide", "person/old", True)
    managed.execute(ManagementAction.EXPIRE, older_s=40 * DAY)
    assert {layer for _, layer in managed.current_profiles()} == {"", ANNA}


def test_person_is_forgotten_by_one_or_all_agents(managed):
    for agent in ("guide", "express"):
        managed.teach_layer(ANNA, agent)
        managed.teach_layer(LOBBY, agent)
    managed.execute(ManagementAction.FORGET, agent="express", layer=ANNA)
    assert ("guide", ANNA) in managed.current_profiles()
    done = managed.execute(ManagementAction.FORGET, layer=ANNA)
    assert [(d.agent, d.layer, d.remove) for d in done.deliveries] == [("guide", ANNA, True)]
    assert {layer for _, layer in managed.current_profiles()} == {"", LOBBY}
    with pytest.raises(Refused, match="UNKNOWN_LAYER"):
        managed.execute(ManagementAction.FORGET, layer=ANNA)


@pytest.mark.parametrize(
    ("action", "fields", "code"),
    [
        (9, {}, "UNKNOWN_ACTION"),
        (ManagementAction.HISTORY, {"agent": "nobody"}, "UNKNOWN_AGENT"),
        (ManagementAction.HISTORY, {"agent": "guide", "layer": ANNA}, "UNKNOWN_LAYER"),
        (ManagementAction.UNDO, {}, "UNKNOWN_AGENT"),
        (ManagementAction.UNDO, {"agent": "guide"}, "NOTHING_TO_UNDO"),
        (ManagementAction.UNDO, {"agent": "guide", "expected": (1.0, 3.0)}, "CHANGED_MEANWHILE"),
        (ManagementAction.UNDO, {"agent": "guide", "layer": "anna"}, "BAD_LAYER"),
        (ManagementAction.RESET, {"agent": "guide", "expected": (1.0, 3.0)}, "CHANGED_MEANWHILE"),
        (ManagementAction.RESET, {"agent": "guide", "expected": (3.0,)}, "WRONG_LENGTH"),
        (ManagementAction.RESET, {"agent": "guide", "layer": ANNA}, "UNKNOWN_LAYER"),
        (ManagementAction.RESET, {"agent": "guide", "reason": "x" * 1001}, "TOO_LONG"),
        (ManagementAction.RESET, {"agent": "guide", "reason": "a\x1b[2J"}, "BAD_TEXT"),
        (ManagementAction.RESET, {"agent": "guide", "author": "a\x1b[2J"}, "BAD_TEXT"),
        (ManagementAction.EXPIRE, {"older_s": 0.0}, "BAD_AGE"),
        (ManagementAction.EXPIRE, {"older_s": math.nan}, "BAD_AGE"),
        (ManagementAction.EXPIRE, {"older_s": 1.0, "layer": "all"}, "BAD_LAYER"),
        (ManagementAction.FORGET, {"agent": "guide"}, "BAD_LAYER"),
        (ManagementAction.FORGET, {"layer": "forgotten/1"}, "BAD_LAYER"),
    ],
)
def test_invalid_order_is_rejected_with_code(managed, action, fields, code):
    before = managed.profiles.table()
    with pytest.raises(Refused, match=f"^{code}:"):
        managed.execute(action, **fields)
    assert managed.profiles.table() == before


def test_import_keeps_number_of_changes(managed):
    for number in range(10):
        managed.teach(f"f{number}")
    document_of_ten = managed.execute(ManagementAction.EXPORT, agent="guide").document
    managed.execute(ManagementAction.RESET, agent="guide")
    managed.execute(ManagementAction.IMPORT, document=document_of_ten)
    (answer,) = managed.document(ManagementAction.HISTORY, agent="guide")["profiles"]
    assert answer["changes"] == 10
