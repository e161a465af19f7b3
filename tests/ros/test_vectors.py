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

from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Auction, Feedback, Run, Scene, SceneValue
from bt_agents_interfaces.srv import Analyze, CollectFeedback, GiveFeedback, SetProfile
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from market_node_harness import MarketNodeHarness
from processes import write_trees
from tree_harness import SPACE, scene
from whole_system import System

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


class Site(System):
    """The whole system with one agent that waits, and publishers of scenes."""

    def __init__(self, ros: Any, folder: Path) -> None:
        self.logs: list[Log] = ros.collect(Log, "/rosout", qos.EVENTS)
        self.scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self.live = ros.node.create_publisher(Scene, "bt_agents/scene/live", qos.SENSOR)
        super().__init__(ros, write_trees(folder / "trees", waiter=(3.0, "wait: 60 s")))
        ros.until(lambda: self.scenes.get_subscription_count() == 1)
        ros.until(lambda: self.live.get_subscription_count() == 2)

    def refuses(self, kind: Any, name: str, code: str, /, **fields: Any) -> None:
        """Check that a service refuses a request with this code."""
        client = self.ros.node.create_client(kind, name, qos_profile=qos.SERVICE)
        answer = self.ros.call(client, kind.Request(**fields))
        assert (answer.accepted, answer.code) == (False, code), fields
        assert answer.message

    def noted(self, node: str, *words: str) -> bool:
        return any(log.name == node and all(w in log.msg for w in words) for log in self.logs)

    def is_as_before(self) -> None:
        self.ros.turns()
        member = self.host.registry.members["waiter"]
        assert (member.profile, member.revision) == ((3.0, 3.0, 3.0), 0)
        assert (self.profiles[-1].revisions[0], self.feedback_given) == (0, [])
        assert (self.auctions, self.runs) == ([], [])


@pytest.fixture
def site(ros: Any, tmp_path: Path) -> Site:
    return Site(ros, tmp_path)


def test_bad_vectors_end_their_scenes_by_name(site: Site) -> None:
    for number, (key, code) in enumerate(AS_SCENE.items()):
        site.scenes.publish(scene_of(BAD[key], f"s{number}"))
        site.ros.until(lambda n=number: len(site.ends) == n + 1)
        assert (key, site.ends[-1].code) == (key, code)
        assert site.ends[-1].message
    site.is_as_before()


def test_bad_vectors_in_analysis_are_refused_by_name(site: Site) -> None:
    names = list(SPACE.names)
    for (key, code), announce in product(AS_VECTOR.items(), (True, False)):
        given = {"names": names, "values": BAD[key], "announce": announce}
        site.refuses(Analyze, "scene_layer/analyze", code, **given)
    site.is_as_before()


def test_bad_profiles_are_refused_by_name(site: Site) -> None:
    for key, code in AS_VECTOR.items():
        profile = {"agent": "waiter", "values": BAD[key], "revision": 9}
        site.refuses(SetProfile, "agents/set_profile", code, **profile)
    site.is_as_before()


def test_bad_values_in_feedback_are_refused_by_name(site: Site) -> None:
    wishes = {**AS_OPINION, "no opinion": "NO_OPINION"}
    for kind, (key, code) in product((Feedback.DIRECT, Feedback.SET), wishes.items()):
        wish = {"agent": "waiter", "kind": kind, "values": BAD.get(key, [NAN] * 3)}
        site.refuses(GiveFeedback, "feedback/give", code, **wish)
    site.is_as_before()


def test_bad_scenes_in_feedback_are_refused_by_name(site: Site) -> None:
    given = {"agent": "waiter", "kind": Feedback.POSITIVE}
    ended = {"epoch": "epoch", "round": 1, "agent": "waiter", "outcome": Run.SUCCEEDED}
    for key, code in AS_SCENE.items():
        bad = scene_of(BAD[key], "s")
        site.refuses(GiveFeedback, "feedback/give", code, scene=bad, **given)
        site.refuses(CollectFeedback, "feedback/collect", code, scene=bad, **ended)
    site.is_as_before()


def test_bad_scenes_in_goals_are_refused_by_name(site: Site) -> None:
    client = ActionClient(site.ros.node, RunAgent, "agents/run")
    try:
        site.ros.until(client.server_is_ready)
        for number, (key, code) in enumerate(AS_SCENE.items(), 1):
            goal = RunAgent.Goal(
                epoch="epoch",
                round=number,
                host_instance=site.host.instance,
                agent="waiter",
                agent_id=site.host.registry.members["waiter"].agent_id,
                token=list(site.host._runs._token),
                scene=scene_of(BAD[key], "s"),
            )
            handle = site.ros.result(client.send_goal_async(goal))
            ended = site.ros.result(handle.get_result_async())
            assert ended.result.code == code, key
            site.ros.until(lambda n=number, c=code: site.noted("agents", f"round {n})", c))
    finally:
        client.destroy()
    site.is_as_before()


def test_bad_live_scenes_are_logged_and_run_continues(site: Site) -> None:
    site.scenes.publish(scene_to_msg(scene("s1", age=3, familiarity=3, mood=3)))
    site.ros.until(lambda: [run.event for run in site.runs] == [Run.STARTED])
    for values in BAD.values():
        site.live.publish(scene_of(values, "s1"))
    site.ros.until(lambda: site.noted("agents", "live scene refused", NOT_FINITE))
    assert [run.event for run in site.runs] == [Run.STARTED]
    assert site.feedback_given == []


def test_bad_bids_are_refused_and_win_nothing(ros: Any) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host(waiter=(3.0, 3.0, 3.0))
    vectors = {**BAD, "flood": [3.0] * 100_000}
    for key, code in {**AS_VECTOR, "flood": WRONG_LENGTH}.items():
        host.distort = lambda bids, key=key: setattr(bids, "vectors", vectors[key])
        harness.scene(key)
        harness.until_over(key)
        auction = harness.auctions[-1]
        assert (key, [bid.code for bid in auction.refused]) == (key, [code])
        assert (auction.outcome, auction.winner) == (Auction.NO_BIDS, "")
    host.distort = lambda _: None
    harness.scene("good")
    assert harness.until_event(Run.STARTED).agent == "waiter"
