# SPDX-License-Identifier: Apache-2.0
"""Every interface that accepts vectors: invalid ones are refused with a code."""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Log
from rclpy.action import ActionClient
from rclpy.clock import Clock, ClockType

from active_nodes import active_feedback, active_host, active_market, active_scene_layer
from bt_agents.host.node import HostNode
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import (
    Auction,
    Bids,
    CallForBids,
    Feedback,
    Heartbeat,
    Profiles,
    Run,
    Scene,
    SceneEnd,
    SceneValue,
)
from bt_agents_interfaces.srv import (
    Analyze,
    CollectFeedback,
    GiveFeedback,
    RegisterHost,
    SetProfile,
)
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.messages import scene_to_msg
from feedback_node.ledger import Ledger
from processes import write_trees
from tree_harness import SPACE, TREES, scene

pytestmark = pytest.mark.ros

NAN, INF = math.nan, math.inf

BAD = {
    "NaN": [3.0, NAN, 3.0],
    "infinite": [3.0, 3.0, INF],
    "minus infinite": [-INF, 3.0, 3.0],
    "empty": [],
    "too short": [3.0, 3.0],
    "too long": [3.0, 3.0, 3.0, 3.0],
    "endless": [3.0] * 150,
    "too large": [3.0, 3.0, 99.0],
    "too small": [0.0, 3.0, 3.0],
    "huge": [1e308, 3.0, 3.0],
}
NOT_FINITE, WRONG_LENGTH, OUT_OF_RANGE = "NOT_FINITE", "WRONG_LENGTH", "OUT_OF_RANGE"
AS_VECTOR = dict(zip(BAD, [NOT_FINITE] * 3 + [WRONG_LENGTH] * 4 + [OUT_OF_RANGE] * 3, strict=True))
AS_SCENE = {
    **AS_VECTOR,
    "empty": "EMPTY",
    "too long": "UNKNOWN_PARAMETER",
    "endless": "UNKNOWN_PARAMETER",
}
AS_OPINION = {key: code for key, code in AS_VECTOR.items() if key != "NaN"}
"""In direct feedback, NaN means no opinion."""


def scene_of(values: list[float], scene_id: str) -> Scene:
    names = [*SPACE.names, *(f"more{i}" for i in range(len(values)))]
    return Scene(
        scene_id=scene_id,
        person=True,
        values=[
            SceneValue(name=name, value=value, origin=SceneValue.GIVEN)
            for name, value in zip(names, values, strict=False)
        ],
    )


class System:
    """All nodes, with one agent that waits, and their messages and decisions."""

    def __init__(self, ros: Any, folder: Path) -> None:
        self.ros = ros
        trees = read_trees(
            write_trees(folder / "trees", waiter=(3.0, "wait: 60 s")), InstalledInterfaces()
        )
        self.logs: list[Log] = ros.collect(Log, "/rosout", qos.EVENTS)
        self.ends: list[SceneEnd] = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.HISTORY)
        self.auctions: list[Auction] = ros.collect(Auction, "bt_agents/auctions", qos.HISTORY)
        self.runs: list[Run] = ros.collect(Run, "bt_agents/runs", qos.HISTORY)
        self.feedback: list[Feedback] = ros.collect(Feedback, "bt_agents/feedback", qos.EVENTS)
        self.profiles: list[Profiles] = ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
        self.scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self.live = ros.node.create_publisher(Scene, "bt_agents/scene/live", qos.SENSOR)
        ros.add(active_market(SPACE, "epoch"))
        ros.add(active_scene_layer(read_scene(TREES / "scene.yaml")))
        ros.add(active_feedback(SPACE, Ledger(":memory:")))
        self.host: HostNode = ros.add(active_host(trees))
        ros.until(lambda: self.host.registered)
        ros.until(lambda: self.profiles and list(self.profiles[-1].agents) == ["waiter"])
        ros.until(lambda: self.scenes.get_subscription_count() == 1)
        ros.until(lambda: self.live.get_subscription_count() == 2)

    def ask(self, kind: Any, name: str, /, **fields: Any) -> Any:
        client = self.ros.node.create_client(kind, name, qos_profile=qos.SERVICE)
        return self.ros.call(client, kind.Request(**fields))

    def noted(self, node: str, *words: str) -> bool:
        return any(log.name == node and all(w in log.msg for w in words) for log in self.logs)

    def is_as_before(self) -> None:
        self.ros.turns()
        member = self.host.registry.members["waiter"]
        assert (member.profile, member.revision) == ((3.0, 3.0, 3.0), 0)
        assert (self.profiles[-1].revisions[0], self.feedback) == (0, [])
        assert self.auctions == []
        assert self.runs == []


@pytest.fixture
def system(ros: Any, tmp_path: Path) -> System:
    return System(ros, tmp_path)


def test_bad_vectors_end_their_scenes_by_name(system: System) -> None:
    for number, (key, code) in enumerate(AS_SCENE.items()):
        system.scenes.publish(scene_of(BAD[key], f"s{number}"))
        system.ros.until(lambda n=number: len(system.ends) == n + 1)
        assert (key, system.ends[-1].code) == (key, code)
        assert system.ends[-1].message
    system.is_as_before()


def test_bad_vectors_in_analysis_are_refused_by_name(system: System) -> None:
    for key, code in AS_VECTOR.items():
        for announce in (True, False):
            answer = system.ask(
                Analyze,
                "scene_layer/analyze",
                names=list(SPACE.names),
                values=BAD[key],
                announce=announce,
            )
            assert (key, answer.accepted, answer.code) == (key, False, code)
            assert answer.message
    system.is_as_before()


def test_bad_profiles_are_refused_by_name(system: System) -> None:
    for key, code in AS_VECTOR.items():
        answer = system.ask(
            SetProfile, "agents/set_profile", agent="waiter", values=BAD[key], revision=9
        )
        assert (key, answer.accepted, answer.code) == (key, False, code)
        assert answer.message
    system.is_as_before()


def test_bad_values_in_feedback_are_refused_by_name(system: System) -> None:
    wishes = {**AS_OPINION, "no opinion": "NO_OPINION"}
    for kind, (key, code) in product((Feedback.DIRECT, Feedback.SET), wishes.items()):
        values = BAD.get(key, [NAN] * 3)
        answer = system.ask(
            GiveFeedback, "feedback/give", agent="waiter", kind=kind, values=values
        )
        assert (key, answer.accepted, answer.code) == (key, False, code)
        assert answer.message
    system.is_as_before()


def test_bad_scenes_in_feedback_are_refused_by_name(system: System) -> None:
    for key, code in AS_SCENE.items():
        answer = system.ask(
            GiveFeedback,
            "feedback/give",
            agent="waiter",
            kind=Feedback.POSITIVE,
            scene=scene_of(BAD[key], "s"),
        )
        assert (key, answer.accepted, answer.code) == (key, False, code)
        collected = system.ask(
            CollectFeedback,
            "feedback/collect",
            epoch="epoch",
            round=1,
            agent="waiter",
            outcome=Run.SUCCEEDED,
            scene=scene_of(BAD[key], "s"),
        )
        assert (key, collected.accepted, collected.code) == (key, False, code)
    system.is_as_before()


def test_bad_scenes_in_goals_are_refused_by_name(system: System) -> None:
    client = ActionClient(system.ros.node, RunAgent, "agents/run")
    try:
        system.ros.until(client.server_is_ready)
        for number, (key, code) in enumerate(AS_SCENE.items(), 1):
            goal = RunAgent.Goal(
                epoch="epoch",
                round=number,
                host_instance=system.host.instance,
                agent="waiter",
                agent_id=system.host.registry.members["waiter"].agent_id,
                token=list(system.host._runs._token),
                scene=scene_of(BAD[key], "s"),
            )
            future = client.send_goal_async(goal)
            system.ros.until(future.done)
            ended = future.result().get_result_async()
            system.ros.until(ended.done)
            assert ended.result().result.code == code, key
            system.ros.until(lambda n=number, c=code: system.noted("agents", f"round {n})", c))
    finally:
        client.destroy()
    system.is_as_before()


def test_bad_live_scenes_are_logged_and_run_continues(system: System) -> None:
    system.scenes.publish(scene_to_msg(scene("s1", age=3, familiarity=3, mood=3)))
    system.ros.until(lambda: [run.event for run in system.runs] == [Run.STARTED])
    for values in BAD.values():
        system.live.publish(scene_of(values, "s1"))
    system.ros.until(lambda: system.noted("agents", "live scene refused", NOT_FINITE))
    assert [run.event for run in system.runs] == [Run.STARTED]
    assert system.feedback == []


class Bidder:
    """A host under the control of the test, with arbitrary bids."""

    def __init__(self, ros: Any) -> None:
        self.vector: list[float] = []
        self._token: Any = [0] * 16
        self._bids = ros.node.create_publisher(Bids, "bt_agents/bids", qos.EVENTS)
        self._beats = ros.node.create_publisher(Heartbeat, "/bidder/heartbeat", qos.EVENTS)
        ros.node.create_timer(0.1, self._beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        ros.node.create_subscription(CallForBids, "bt_agents/calls", self._bid, qos.EVENTS)
        register = ros.node.create_client(
            RegisterHost, "marketplace/register", qos_profile=qos.SERVICE
        )
        answer = ros.call(
            register,
            RegisterHost.Request(
                host="/bidder",
                host_instance="i",
                run_action="/bidder/run",
                heartbeat="/bidder/heartbeat",
                parameters=list(SPACE.names),
                agents=["waiter"],
            ),
        )
        assert answer.accepted
        self._token = answer.token
        [self._agent_id] = answer.agent_ids
        ros.until(lambda: self._beats.get_subscription_count() == 1)

    def _beat(self) -> None:
        self._beats.publish(Heartbeat(host="/bidder", host_instance="i", token=self._token))

    def _bid(self, call: CallForBids) -> None:
        self._bids.publish(
            Bids(
                epoch=call.epoch,
                round=call.round,
                host="/bidder",
                host_instance="i",
                token=self._token,
                agents=["waiter"],
                agent_ids=[self._agent_id],
                vectors=self.vector,
            )
        )


def test_bad_bids_are_refused_and_win_nothing(ros: Any) -> None:
    auctions: list[Auction] = ros.collect(Auction, "bt_agents/auctions", qos.HISTORY)
    scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
    ros.add(active_market(SPACE, "epoch"))
    bidder = Bidder(ros)
    ros.until(lambda: scenes.get_subscription_count() == 1)
    for number, (key, code) in enumerate(AS_VECTOR.items()):
        bidder.vector = BAD[key]
        scenes.publish(scene_to_msg(scene(f"s{number}", age=3, familiarity=3, mood=3)))
        ros.until(lambda n=number: len(auctions) == n + 1)
        auction = auctions[-1]
        assert (key, [bid.code for bid in auction.refused]) == (key, [code])
        assert (auction.outcome, auction.winner) == (Auction.NO_BIDS, "")
