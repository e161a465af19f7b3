# SPDX-License-Identifier: Apache-2.0
"""The live scene over real DDS: staleness, and a thousand messages a second."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from active_nodes import active_feedback, active_scene_layer
from bt_agents.host.node import LiveScene
from bt_agents_core.scene import Scene
from bt_agents_interfaces.msg import AgentCard, HostCard, MoodRule, Run
from bt_agents_interfaces.msg import Scene as SceneMsg
from bt_agents_interfaces.srv import CancelRun, GiveFeedback, SetProfile
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from feedback_node.ledger import Ledger
from scene_layer.node import SHORTEST_S
from scene_spaces import source
from tree_harness import SPACE, scene

AWARDED = scene(age=3, familiarity=3, mood=3)
MOOD = source("mood")


class Host:
    """The parts of a host for the live scene, and a scene layer played by the test."""

    def __init__(self, ros: Any) -> None:
        self.ros = ros
        self.node = ros.add(rclpy.create_node("agents"))
        self.live = LiveScene(self.node, SPACE)
        self.layer = ros.node.create_publisher(SceneMsg, "bt_agents/scene/live", qos.SENSOR)
        ros.until(lambda: self.layer.get_subscription_count())

    def publish(self, live: Scene) -> None:
        self.layer.publish(scene_to_msg(live))

    def set_lease(self, seconds: float) -> Any:
        lease = Parameter("live_lease", value=seconds).to_parameter_msg()
        return self.ros.ask(SetParameters, "/agents/set_parameters", parameters=[lease]).results[0]


def mood(live: Scene) -> float:
    return live.get("mood")


def test_live_scene_turns_stale_after_scene_layer_lease(ros):
    host = Host(ros)
    now = host.live.begin_run(AWARDED)
    assert now() == AWARDED
    host.publish(replace(AWARDED, values=scene(mood=5).values))
    ros.until(lambda: mood(now()) == 5)
    heard_at = time.monotonic()
    assert not now().stale_s
    ros.until(lambda: now().stale_s)
    assert now().stale_s > 1.0
    assert time.monotonic() - heard_at > 0.9
    assert mood(now()) == 5
    host.publish(replace(AWARDED, values=scene(mood=4).values))
    ros.until(lambda: not now().stale_s)
    assert mood(now()) == 4


def test_malformed_or_foreign_scenes_do_not_renew_lease(ros):
    host = Host(ros)
    now = host.live.begin_run(AWARDED)
    wrong = scene_to_msg(AWARDED)
    wrong.values[0].value = math.inf
    end = time.monotonic() + 10.0
    while not now().stale_s and time.monotonic() < end:
        host.layer.publish(wrong)
        host.publish(replace(AWARDED, scene_id="another"))
        ros.turns(5)
    assert now().stale_s
    assert now().values == AWARDED.values


def test_lease_is_ranged_parameter_with_immediate_effect(ros):
    host = Host(ros)
    now = host.live.begin_run(AWARDED)
    ros.until(lambda: now().stale_s)
    assert host.set_lease(60.0).successful
    assert not now().stale_s
    assert not host.set_lease(0.0).successful
    assert not now().stale_s


def test_running_scene_layer_keeps_live_scene_fresh(ros):
    host = Host(ros)
    runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
    layer = ros.add(active_scene_layer(SceneSpec(space=SPACE, sources=(), person=None)))
    now = host.live.begin_run(AWARDED)
    runs.publish(Run(epoch="e", round=1, event=Run.STARTED, scene=scene_to_msg(AWARDED)))
    assert host.set_lease(2.0).successful
    stale = []
    end = time.monotonic() + 4.5
    while time.monotonic() < end:
        ros.turns(1)
        stale.append(bool(now().stale_s))
    assert not any(stale)
    ros.remove(layer)
    ros.until(lambda: now().stale_s)
    # The history of its topic still has the run, so a new subscriber receives it.
    ros.add(active_scene_layer(SceneSpec(space=SPACE, sources=(), person=None)))
    ros.until(lambda: not now().stale_s)


# --- a thousand a second --------------------------------------------------------------------


@contextmanager
def flood(ros: Any, publish: Callable[[int], None]) -> Iterator[list[int]]:
    """Publish a thousand times a second in a thread; the list holds the number so far."""
    sent = [0]
    stop = threading.Event()

    def run() -> None:
        begun = time.monotonic()
        while not stop.is_set():
            due = int((time.monotonic() - begun) * 1000)
            while sent[0] < due:
                publish(sent[0])
                sent[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield sent
    finally:
        stop.set()
        thread.join()


class Learning:
    """The feedback node with one running agent, whose rules are evaluated."""

    def __init__(self, ros: Any, ledger: Ledger, *rules: MoodRule) -> None:
        self.ros = ros
        self.cancels: list[CancelRun.Request] = []
        ros.node.create_service(
            CancelRun, "marketplace/cancel", self._cancel, qos_profile=qos.SERVICE
        )
        ros.node.create_service(
            SetProfile, "/agents/set_profile", self._take, qos_profile=qos.SERVICE
        )
        cards = ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
        runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
        self.live = ros.node.create_publisher(SceneMsg, "bt_agents/scene/live", qos.SENSOR)
        self.client = ros.node.create_client(GiveFeedback, "feedback/give")
        self.node = ros.add(active_feedback(SPACE, ledger))
        # A live scene that is published once counts until its rule fires.
        [done] = self.node.set_parameters([Parameter("live_lease", value=60.0)])
        assert done.successful, done.reason
        self.looks: list[float] = []
        self._count_looks()
        agent = AgentCard(name="mira", profile=[3.0] * 3, learning_rate=0.5, rules=rules)
        cards.publish(HostCard(host="/agents", parameters=SPACE.names, agents=[agent]))
        ros.until(lambda: self.node._profiles.knows("mira"))
        awarded = scene_to_msg(AWARDED)
        runs.publish(Run(epoch="e", round=1, event=Run.STARTED, agent="mira", scene=awarded))
        ros.until(lambda: self.node._controller.watching)
        ros.until(self.live.get_subscription_count)

    def _count_looks(self) -> None:
        receive = self.node._controller.receive

        def counted(live: Scene) -> Any:
            self.looks.append(mood(live))
            return receive(live)

        self.node._controller.receive = counted

    def _cancel(self, request: Any, response: Any) -> Any:
        self.cancels.append(request)
        return self._take(request, response)

    def _take(self, _request: Any, response: Any) -> Any:
        response.accepted = True
        return response

    def publish(self, value: float) -> None:
        self.live.publish(scene_to_msg(replace(AWARDED, values=scene(mood=value).values)))


@pytest.fixture
def ledger() -> Iterator[Ledger]:
    """A ledger; requested before ``ros``, so it is closed after the node that writes to it."""
    with Ledger(":memory:") as ledger:
        yield ledger


def test_feedback_is_accepted_during_flood_of_live_scenes(ledger, ros):
    never = MoodRule(
        when="live.mood < 0", hold_s=1.0, give=MoodRule.NEGATIVE, action=MoodRule.CANCEL
    )
    room = Learning(ros, ledger, never)
    begun = time.monotonic()
    answers, took = [], []
    with flood(ros, lambda number: room.publish(2.0 + number % 2)) as sent:
        for number in range(10):
            ros.until(lambda number=number: sent[0] >= 200 * number)
            asked = time.monotonic()
            request = GiveFeedback.Request(agent="mira", kind=3, values=[1.0 + number % 2] * 3)
            answers.append(ros.call(room.client, request))
            took.append(time.monotonic() - asked)
    passed = time.monotonic() - begun
    assert [answer.accepted for answer in answers] == [True] * 10
    assert ledger.current("mira").revision == 10
    assert max(took) < 10.0
    # One evaluation per tick, however many scenes arrived.
    assert room.looks
    assert len(room.looks) <= passed / 0.025 + 5
    assert room.cancels == []


def test_rules_are_evaluated_only_on_scenes_and_deadlines(ledger, ros):
    worse = MoodRule(
        when="mood.change <= -1", hold_s=0.4, give=MoodRule.NEGATIVE, action=MoodRule.CANCEL
    )
    room = Learning(ros, ledger, worse)
    passed = []
    tick = room.node._controller.tick
    room.node._controller.tick = lambda: passed.append(tick()) or passed[-1]
    room.publish(1.0)
    ros.until(lambda: room.cancels)
    assert room.looks == [1.0]
    fired = [lessons for lessons in passed if lessons]
    assert len(fired) == 1
    # A timer may fire a little early, and is set again.
    assert len(passed) <= 3


def test_live_scene_rate_stays_limited_under_reading_flood(ros):
    runs = ros.node.create_publisher(Run, "bt_agents/runs", qos.HISTORY)
    readings = ros.node.create_publisher(Float64, MOOD.topic, qos.SENSOR)
    live = ros.collect(SceneMsg, "bt_agents/scene/live", qos.SENSOR)
    layer = ros.add(active_scene_layer(SceneSpec(space=SPACE, sources=(MOOD,), person=None)))
    runs.publish(Run(epoch="e", round=1, event=Run.STARTED, scene=scene_to_msg(AWARDED)))
    ros.until(lambda: live and readings.get_subscription_count())
    live.clear()
    begun = time.monotonic()
    with flood(ros, lambda number: readings.publish(Float64(data=1.0 + number % 4))) as sent:
        ros.until(lambda: sent[0] > 2000)
    passed = time.monotonic() - begun
    assert 0 < len(live) <= passed / SHORTEST_S + 5
    readings.publish(Float64(data=4.5))
    ros.until(lambda: layer._sources.latest("mood", time.monotonic()).value == 4.5)
    ros.until(lambda: any(v.value == 4.5 for v in live[-1].values))
