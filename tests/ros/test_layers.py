# SPDX-License-Identifier: Apache-2.0
"""Profiles for a person and a place from the ledger to the bid, over real DDS."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from active_nodes import active_feedback, active_host, active_market
from bt_agents_interfaces.msg import Auction, Bids, Feedback, MarketStatus, Profiles, Run, Scene
from bt_agents_interfaces.srv import GiveFeedback, ManageProfiles
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.messages import scene_to_msg
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.rows import LAYER, RevisionCause
from programs import ROOT
from tree_harness import scene

pytestmark = pytest.mark.ros

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


class Street:
    """Market, feedback node and one host with two agents, of ages 3 and 2.75."""

    def __init__(self, ros: Any, tmp_path: Path, head: str = "") -> None:
        trees = tmp_path / "trees"
        (trees / "agents").mkdir(parents=True)
        shutil.copy(ROOT / "trees" / "scene.yaml", trees)
        for name, age in (("ann", 3.0), ("bob", 2.75)):
            text = AGENT.format(name=name, age=age) + head * (name == "ann")
            (trees / "agents" / f"{name}.yaml").write_text(text)
        self.ros = ros
        self.folder = read_trees(trees, InstalledInterfaces())
        self.ledger = Ledger(tmp_path / "ledger.sqlite")
        space = self.folder.scene.space
        ros.add(active_market(space, "epoch"))
        self.feedback = ros.add(active_feedback(space, self.ledger))
        self.host = ros.add(active_host(self.folder))
        self.auctions: list[Auction] = ros.collect(Auction, "bt_agents/auctions", qos.HISTORY)
        self.runs: list[Run] = ros.collect(Run, "bt_agents/runs", qos.HISTORY)
        self.bids: list[Bids] = ros.collect(Bids, "bt_agents/bids", qos.EVENTS)
        self.profiles: list[Profiles] = ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
        self.changes: list[Feedback] = ros.collect(Feedback, "bt_agents/feedback", qos.HISTORY)
        self.statuses: list[MarketStatus] = ros.collect(MarketStatus, "bt_agents/market", qos.FACT)
        self.scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self._count = 0
        ros.until(lambda: self.host.registered and self.known() >= {("ann", ""), ("bob", "")})
        ros.until(lambda: self.scenes.get_subscription_count() == 1)

    def known(self) -> set[tuple[str, str]]:
        last = self.profiles[-1] if self.profiles else Profiles()
        return set(zip(last.agents, last.layers, strict=True))

    def scene(self, person: str = "", place: str = "") -> Any:
        self._count += 1
        plain = scene(f"s{self._count}", age=1, familiarity=3, mood=3)
        return scene_to_msg(replace(plain, person_id=person, place=place))

    def winner(self, person: str = "", place: str = "") -> tuple[str, int]:
        """Have a scene awarded; return the agent that runs, and the outcome of the run."""
        asked = self.scene(person, place)
        self.scenes.publish(asked)
        self.ros.until(
            lambda: self.statuses and self.statuses[-1].finished_scene_id == asked.scene_id
        )

        def received() -> bool:
            auctions = {auction.scene.scene_id for auction in self.auctions}
            ended = {run.scene.scene_id for run in self.runs if run.event == Run.ENDED}
            return asked.scene_id in auctions & ended

        self.ros.until(received)
        return str(self.auctions[-1].winner), int(self.runs[-1].outcome)

    def teach(self, person: str = "", place: str = "", age: float = 1.0) -> Any:
        client = self.ros.node.create_client(GiveFeedback, "feedback/give")
        request = GiveFeedback.Request(
            agent="ann", kind=0, values=[age, NAN, NAN], scene=self.scene(person, place)
        )
        answer = self.ros.call(client, request)
        assert answer.accepted, answer.message
        return answer

    def manage(self, action: int, **fields: Any) -> Any:
        client = self.ros.node.create_client(ManageProfiles, "feedback/manage")
        return self.ros.call(client, ManageProfiles.Request(action=action, **fields))

    def layers(self) -> set[str]:
        """Return the layers in the bids of the host."""
        return set(self.host.registry.members["ann"].layers)


@pytest.fixture
def ledgers() -> Iterator[ExitStack]:
    """Ledgers; requested before ``ros``, so they are closed after the nodes that write to them."""
    with ExitStack() as ledgers:
        yield ledgers


@pytest.fixture
def make_street(ledgers: ExitStack, ros: Any, tmp_path: Path) -> Callable[..., Street]:
    def make(head: str = "") -> Street:
        made = Street(ros, tmp_path, head)
        ledgers.callback(made.ledger.close)
        return made

    return make


@pytest.fixture
def street(make_street: Callable[..., Street]) -> Street:
    return make_street()


def test_feedback_counts_fully_for_person_partly_for_others(street: Street) -> None:
    assert street.winner("anna") == ("bob", Run.FAILED)
    answer = street.teach("anna")
    assert answer.message == "ann: for person/anna age 3 → 1; for everybody age 3 → 2.5"
    assert (answer.feedback.layer, answer.feedback.weight) == (ANNA, 1.0)
    street.ros.until(lambda: len(street.changes) == 2)
    assert [(one.layer, one.weight) for one in street.changes] == [(ANNA, 1.0), ("", 0.25)]
    # Her tree sees the profile of its bid.
    assert street.winner("anna") == ("ann", Run.SUCCEEDED)
    assert street.winner() == ("ann", Run.FAILED)
    street.teach("anna", age=5.0)
    street.teach(place="lobby")
    assert street.winner("anna", "lobby")[0] == "bob"
    assert street.winner("carl", "lobby") == ("ann", Run.SUCCEEDED)
    assert street.known() == {("ann", ""), ("ann", ANNA), ("ann", "place/lobby"), ("bob", "")}


def test_restarted_host_gets_its_layers_back(street: Street) -> None:
    street.teach("anna")
    street.teach("bea")
    street.ros.remove(street.host)
    street.host = street.ros.add(active_host(street.folder))
    street.ros.until(lambda: street.layers() == {ANNA, "person/bea"})


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
    street.ros.until(lambda: street.changes[-1].source == "eva")
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
    street.ros.until(lambda: ANNA in [one.layer for one in street.changes])
    assert street.manage(ManageProfiles.Request.FORGET, layer=ANNA).accepted
    street.teach("bea")
    late: list[Feedback] = street.ros.collect(Feedback, "bt_agents/feedback", qos.HISTORY)
    street.ros.until(lambda: len(late) == 2)
    assert [one.layer for one in late] == ["person/bea", ""]
    assert [one.layer for one in street.changes][-2:] == ["person/bea", ""]


def test_reset_of_shared_profile_reaches_bids(street: Street) -> None:
    street.teach()
    assert street.winner()[0] == "ann"
    assert street.manage(ManageProfiles.Request.RESET, agent="ann").accepted
    street.ros.until(lambda: street.host.registry.members["ann"].revision == 2)
    assert street.winner()[0] == "bob"


def test_bids_carry_weights_of_their_agent(make_street: Callable[..., Street]) -> None:
    street = make_street("weights: {age: 2}\n")
    street.winner()
    street.ros.until(lambda: street.bids)
    rows = dict(zip(street.bids[-1].agents, (0, 1), strict=True))
    width = len(street.folder.scene.space)
    weights = list(street.bids[-1].weights)
    assert weights[rows["ann"] * width] == 2.0
    assert weights[rows["bob"] * width] == street.folder.scene.space.parameters[0].weight


def test_card_is_stored_once_disk_has_space_again(street: Street, ros: Any) -> None:
    database = street.ledger._database
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    database.execute(f"PRAGMA max_page_count = {pages}")
    client = ros.node.create_client(GiveFeedback, "feedback/give")
    codes = []
    for reason in ["long" * 200] * 20 + [""] * 40:
        request = GiveFeedback.Request(agent="ann", kind=3, values=[2.0] * 3, reason=reason)
        codes.append(ros.call(client, request).code)
    assert codes[-1] == "STORAGE_FULL"
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
