# SPDX-License-Identifier: Apache-2.0
"""Profiles for a person and a place from the ledger to the bid, over real DDS."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from active_nodes import active_feedback
from bt_agents_interfaces.msg import Feedback, Run, Scene
from bt_agents_interfaces.srv import GiveFeedback, ManageProfiles
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from feedback_node.ledger import LedgerEntry
from feedback_node.ledger.rows import LAYER, RevisionCause
from tree_harness import TREES, scene
from whole_system import System

NAN = math.nan
ANNA = "person/anna"
AGENT = """
format: 1
agent: {name}
title: {name}
description: d
profile: {{age: {age}, familiarity: 3, mood: 3}}
learning: {{rate: 1, layers: [person, place], general: 0.25}}
tree: {{check: profile.age <= 2}}
"""


class Street(System):
    """The system with two agents, of ages 3 and 2.75."""

    def __init__(self, ros: Any, tmp_path: Path) -> None:
        trees = tmp_path / "trees"
        (trees / "agents").mkdir(parents=True)
        shutil.copy(TREES / "scene.yaml", trees)
        for name, age in (("ann", 3.0), ("bob", 2.75)):
            (trees / "agents" / f"{name}.yaml").write_text(AGENT.format(name=name, age=age))
        super().__init__(ros, trees)
        self.ledger = self.feedback._ledger
        self.scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self._count = 0
        ros.until(lambda: self.scenes.get_subscription_count() == 1)

    def known(self) -> set[tuple[str, str]]:
        return set(zip(self.profiles[-1].agents, self.profiles[-1].layers, strict=True))

    def scene(self, person: str = "", place: str = "") -> Any:
        self._count += 1
        plain = scene(f"s{self._count}", age=1, familiarity=3, mood=3)
        return scene_to_msg(replace(plain, person_id=person, place=place))

    def winner(self, person: str = "", place: str = "") -> tuple[str, int]:
        """Have a scene awarded; return the agent that runs, and the outcome of the run."""
        asked = self.scene(person, place)
        self.scenes.publish(asked)
        ended = (asked.scene_id, Run.ENDED)
        self.ros.until(lambda: ended in [(run.scene.scene_id, run.event) for run in self.runs])
        self.ros.until(lambda: self.finished(asked.scene_id))
        return str(self.auctions[-1].winner), int(self.runs[-1].outcome)

    def teach(self, person: str = "", place: str = "", age: float = 1.0) -> Any:
        given = {"agent": "ann", "values": [age, NAN, NAN], "scene": self.scene(person, place)}
        answer = self.ros.ask(GiveFeedback, "feedback/give", **given)
        assert answer.accepted, answer.message
        return answer

    def manage(self, action: int, **fields: Any) -> Any:
        return self.ros.ask(ManageProfiles, "feedback/manage", action=action, **fields)

    def layers(self) -> set[str]:
        """Return the layers in the bids of the host."""
        return set(self.host.registry.members["ann"].layers)


@pytest.fixture
def street(ros: Any, tmp_path: Path) -> Street:
    return Street(ros, tmp_path)


def test_feedback_counts_fully_for_person_partly_for_others(street: Street) -> None:
    assert street.winner("anna") == ("bob", Run.FAILED)
    answer = street.teach("anna")
    assert answer.message == "ann: for person/anna age 3 → 1; for everybody age 3 → 2.5"
    assert (answer.feedback.layer, answer.feedback.weight) == (ANNA, 1.0)
    street.ros.until(lambda: len(street.feedback_given) == 2)
    assert [(one.layer, one.weight) for one in street.feedback_given] == [(ANNA, 1.0), ("", 0.25)]
    # Her tree sees the profile of its bid.
    assert street.winner("anna") == ("ann", Run.SUCCEEDED)
    assert street.winner() == ("ann", Run.FAILED)
    street.teach("anna", age=5.0)
    street.teach(place="lobby")
    assert street.winner("anna", "lobby")[0] == "bob"
    assert street.winner("carl", "lobby") == ("ann", Run.SUCCEEDED)
    assert street.known() == {("ann", ""), ("ann", ANNA), ("ann", "place/lobby"), ("bob", "")}


def test_host_learns_later_of_missed_forgetting(street: Street) -> None:
    street.teach("anna")
    street.teach("bea")
    assert street.layers() == {ANNA, "person/bea"}
    street.ros.remove(street.feedback)
    street.ledger.forget([("ann", ANNA)])
    street.ros.add(active_feedback(street.folder.scene.space, street.ledger))
    street.ros.until(lambda: street.layers() == {"person/bea"})


def test_many_layers_all_reach_their_host(street: Street) -> None:
    street.ros.remove(street.feedback)
    profile = street.ledger.authored("ann")
    entries = [
        LedgerEntry(
            agent="ann",
            layer=f"person/{number}",
            profile=profile,
            cause=RevisionCause(cause=LAYER),
        )
        for number in range(500)
    ]
    street.ledger.record(entries)
    street.ros.add(active_feedback(street.folder.scene.space, street.ledger))
    street.ros.until(lambda: len(street.layers()) == 500)


def test_profile_service_shows_undoes_exports_and_forgets(street: Street) -> None:
    street.teach("anna")
    street.teach("anna", age=2.0)
    asked = ManageProfiles.Request
    told = json.loads(street.manage(asked.HISTORY, agent="ann", layer=ANNA).document)
    assert [r["values"]["age"] for r in told["revisions"]] == [3.0, 1.0, 2.0]
    undone = street.manage(asked.UNDO, agent="ann", layer=ANNA, author="eva")
    assert undone.message == "ann: for person/anna age 2 → 1 (revision 3)"
    street.ros.until(lambda: street.host.registry.members["ann"].layers[ANNA][1] == 3)
    street.ros.until(lambda: street.feedback_given[-1].source == "eva")
    document = street.manage(asked.EXPORT, layer=ANNA).document
    assert street.manage(asked.FORGET, layer=ANNA).accepted
    street.ros.until(lambda: not street.layers() and ("ann", ANNA) not in street.known())
    assert street.manage(asked.IMPORT, document=document).accepted
    street.ros.until(lambda: street.layers() == {ANNA})
    refused = street.manage(asked.UNDO, agent="nobody")
    assert (refused.accepted, refused.code) == (False, "UNKNOWN_AGENT")
    assert street.manage(99).code == "UNKNOWN_ACTION"


def test_late_subscriber_receives_no_forgotten_feedback(street: Street) -> None:
    street.teach("anna")
    street.ros.until(lambda: ANNA in [one.layer for one in street.feedback_given])
    assert street.manage(ManageProfiles.Request.FORGET, layer=ANNA).accepted
    street.teach("bea")
    late: list[Feedback] = street.ros.collect(Feedback, "bt_agents/feedback", qos.HISTORY)
    street.ros.until(lambda: len(late) == 2)
    assert [one.layer for one in late] == ["person/bea", ""]
    assert [one.layer for one in street.feedback_given][-2:] == ["person/bea", ""]


def test_card_is_stored_once_disk_has_space_again(street: Street, ros: Any) -> None:
    database = street.ledger._database
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    database.execute(f"PRAGMA max_page_count = {pages}")
    client = ros.node.create_client(GiveFeedback, "feedback/give")
    for reason in ["long" * 200] * 20 + [""] * 40:
        request = GiveFeedback.Request(agent="ann", kind=3, values=[2.0] * 3, reason=reason)
        code = ros.call(client, request).code
    assert code == "STORAGE_FULL"
    revision = street.ledger.current("ann").revision
    # Agents that are new meanwhile are added as soon as there is room.
    street.host.registry.members["ann"].spec = replace(
        street.host.registry.members["ann"].spec, profile=(1.0, 1.0, 1.0)
    )
    street.host._host_card.card()
    ros.turns(50)
    assert street.ledger.current("ann").revision == revision
    database.execute("PRAGMA max_page_count = 1000000")
    ros.until(lambda: street.ledger.current("ann").revision == revision + 1)
    assert dict(street.ledger.current("ann").profile)["age"] == 1.0
