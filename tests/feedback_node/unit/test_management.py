# SPDX-License-Identifier: Apache-2.0
"""Orders of people about what was learned: each happens as a whole, or is refused by name."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from feedback_node.management.management import ManagementAction
from ledger_fixture import Desk

ANNA, LOBBY = "person/anna", "place/lobby"
DAY = 86_400.0


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_an_undo_and_a_reset_are_revisions_that_hosts_are_told(desk):
    desk.teach("f1")
    desk.teach("f2")
    done = desk.do(ManagementAction.UNDO, agent="guide", author="eva", reason="wrong button")
    assert done.message == "guide: age 4.5 → 4 (revision 3)"
    assert [(c.revision.revision, c.after) for c in done.changes] == [(3, (4.0, 3.0))]
    cause = done.changes[0].revision.cause
    assert (cause.source, cause.reason, cause.kind) == ("eva", "wrong button", FeedbackKind.SET)
    assert (
        desk.do(ManagementAction.RESET, agent="guide").message == "guide: age 4 → 3 (revision 4)"
    )
    assert desk.profiles_now()["guide", ""] == (3.0, 3.0)


def test_the_history_of_a_profile_tells_every_revision_and_its_cause(desk):
    desk.teach("f1")
    told = desk.told(ManagementAction.HISTORY, agent="guide")
    assert [(r["revision"], r["cause"], r["values"]["age"]) for r in told["revisions"]] == [
        (0, "authored", 3.0),
        (1, "feedback", 4.0),
    ]
    assert told["profiles"][0]["false_rate"] is None


def test_without_an_agent_the_history_is_the_current_profile_of_each(desk):
    desk.layer(ANNA)
    told = desk.told(ManagementAction.HISTORY)
    assert [(p["agent"], p["layer"]) for p in told["profiles"]] == [
        ("express", ""),
        ("guide", ""),
        ("guide", ANNA),
    ]
    assert told["revisions"] == []


def test_what_was_exported_is_taken_in_once_and_gives_the_same_profiles(desk):
    desk.teach("f1")
    desk.layer(ANNA)
    document = desk.do(ManagementAction.EXPORT).document
    other = Desk()
    other.teach("f9")
    done = other.do(ManagementAction.IMPORT, document=document, author="eva")
    assert other.profiles_now() == desk.profiles_now()
    assert len(done.changes) == 3
    before = other.profiles.table()
    again = other.do(ManagementAction.IMPORT, document=document)
    assert again.message == "this document was taken in before; nothing has changed"
    assert other.profiles.table() == before
    # A layer that came with it can be undone to where it begins.
    assert other.do(ManagementAction.UNDO, agent="guide", layer=ANNA).changes[0].after == (
        4.0,
        3.0,
    )


def test_an_export_holds_what_concerns_one_person_with_its_history(desk):
    desk.layer(ANNA)
    desk.layer(ANNA, "express")
    desk.layer(LOBBY)
    told = desk.told(ManagementAction.EXPORT, layer=ANNA)
    assert {(p["agent"], p["layer"]) for p in told["profiles"]} == {
        ("guide", ANNA),
        ("express", ANNA),
    }
    assert {r["layer"] for r in told["revisions"]} == {ANNA}
    with pytest.raises(Refused, match="UNKNOWN_LAYER: no layer 'person/bob'; there are: pers"):
        desk.do(ManagementAction.EXPORT, layer="person/bob")


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
        (document({**GOOD, "layer": "anna"}), "BAD_LAYER"),
        (document({**GOOD, "layer": "forgotten/3"}), "BAD_LAYER"),
        (document({**GOOD, "layer": "person/" + "x" * 300}), "BAD_LAYER"),
        (document({**GOOD, "agent": "nobody"}, GOOD), "UNKNOWN_AGENT"),
        (document({**GOOD, "agent": "\ud800"}), "BAD_DOCUMENT"),
        (document(GOOD, id="\ud800"), "BAD_DOCUMENT"),
        (document(GOOD, id="a\nb"), "BAD_DOCUMENT"),
        (document({**GOOD, "layer": "person/\ud800"}), "BAD_LAYER"),
        (document({**GOOD, "layer": "person/a\0b"}), "BAD_LAYER"),
        (document({**GOOD, "changes": -1}), "BAD_DOCUMENT"),
        (document({**GOOD, "changes": True}), "BAD_DOCUMENT"),
        (document({**GOOD, "changes": 1.5}), "BAD_DOCUMENT"),
        (document({**GOOD, "changes": 10**400}), "BAD_DOCUMENT"),
        (" " * 4_000_001, "TOO_LONG"),
    ],
)
def test_a_document_that_is_none_is_refused_and_nothing_is_taken_in(desk, text, code):
    before = desk.profiles.table()
    with pytest.raises(Refused) as refused:
        desk.do(ManagementAction.IMPORT, document=text)
    assert refused.value.code == code
    assert desk.profiles.table() == before


def test_layers_expire_that_have_not_changed_for_so_long(desk):
    desk.layer("person/old")
    desk.layer("place/old")
    desk.now += 50 * DAY
    desk.layer(ANNA)
    assert desk.do(ManagementAction.EXPIRE, older_s=60 * DAY).message == "nothing to forget"
    done = desk.do(ManagementAction.EXPIRE, older_s=40 * DAY, layer="person")
    assert done.message == "1 profile forgotten"
    assert [(d.agent, d.layer, d.remove) for d in done.deliveries] == [
        ("guide", "person/old", True)
    ]
    desk.do(ManagementAction.EXPIRE, older_s=40 * DAY)
    assert {layer for _, layer in desk.profiles_now()} == {"", ANNA}


def test_a_person_is_forgotten_by_all_agents_or_by_one(desk):
    for agent in ("guide", "express"):
        desk.layer(ANNA, agent)
        desk.layer(LOBBY, agent)
    desk.do(ManagementAction.FORGET, agent="express", layer=ANNA)
    assert ("guide", ANNA) in desk.profiles_now()
    done = desk.do(ManagementAction.FORGET, layer=ANNA)
    assert [(d.agent, d.layer, d.remove) for d in done.deliveries] == [("guide", ANNA, True)]
    assert {layer for _, layer in desk.profiles_now()} == {"", LOBBY}
    with pytest.raises(Refused, match="UNKNOWN_LAYER"):
        desk.do(ManagementAction.FORGET, layer=ANNA)


@pytest.mark.parametrize(
    ("action", "fields", "code"),
    [
        (9, {}, "UNKNOWN_ACTION"),
        (ManagementAction.HISTORY, {"agent": "nobody"}, "UNKNOWN_AGENT"),
        (ManagementAction.HISTORY, {"agent": "guide", "layer": ANNA}, "UNKNOWN_LAYER"),
        (ManagementAction.UNDO, {}, "UNKNOWN_AGENT"),
        (ManagementAction.UNDO, {"agent": "guide"}, "NOTHING_TO_UNDO"),
        (ManagementAction.UNDO, {"agent": "guide", "layer": "anna"}, "BAD_LAYER"),
        (ManagementAction.RESET, {"agent": "nobody"}, "UNKNOWN_AGENT"),
        (ManagementAction.RESET, {"agent": "guide", "layer": ANNA}, "UNKNOWN_LAYER"),
        (ManagementAction.RESET, {"agent": "guide", "reason": "x" * 1001}, "TOO_LONG"),
        (ManagementAction.EXPIRE, {"older_s": 0.0}, "BAD_AGE"),
        (ManagementAction.EXPIRE, {"older_s": math.nan}, "BAD_AGE"),
        (ManagementAction.EXPIRE, {"older_s": 1.0, "layer": "all"}, "BAD_LAYER"),
        (ManagementAction.FORGET, {"agent": "guide"}, "BAD_LAYER"),
        (ManagementAction.FORGET, {"layer": "forgotten/1"}, "BAD_LAYER"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused_by_name(desk, action, fields, code):
    before = desk.profiles.table()
    with pytest.raises(Refused) as refused:
        desk.do(action, **fields)
    assert refused.value.code == code
    assert desk.profiles.table() == before


def test_an_import_keeps_how_much_has_been_taught(desk):
    for number in range(10):
        desk.teach(f"f{number}")
    document_of_ten = desk.do(ManagementAction.EXPORT, agent="guide").document
    desk.do(ManagementAction.RESET, agent="guide")
    desk.do(ManagementAction.IMPORT, document=document_of_ten)
    (told,) = desk.told(ManagementAction.HISTORY, agent="guide")["profiles"]
    assert told["changes"] == 10


def test_texts_of_an_order_with_control_characters_are_refused(desk):
    for field in ("reason", "author"):
        with pytest.raises(Refused, match="BAD_TEXT"):
            desk.do(ManagementAction.RESET, agent="guide", **{field: "a\x1b[2J"})
    with pytest.raises(Refused, match="BAD_LAYER"):
        desk.do(ManagementAction.HISTORY, agent="guide", layer="person/a\nb")
