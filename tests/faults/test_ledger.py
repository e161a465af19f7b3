# SPDX-License-Identifier: Apache-2.0
"""A feedback node killed between recording and answering: it applies feedback once."""

from __future__ import annotations

import resource
import sqlite3
from contextlib import closing
from typing import Any

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future

from bt_agents_interfaces.msg import AgentCard, Feedback, HostCard, Profiles
from bt_agents_interfaces.srv import CollectFeedback, GiveFeedback, SetProfile
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from bt_agents_ros.outbox import Outbox
from bt_agents_tools.launcher import components
from feedback_node.ledger import Ledger
from processes import System
from programs import ROOT
from tree_harness import SPACE, scene

pytestmark = pytest.mark.e2e

TIMES = 20
SIMULATED = """
format: 1
title: prepared
rounds: 1
seed: 0
scenes: [{age: 5, familiarity: 3, mood: 3}]
feedback:
  repeat: true
  sequence: [{mood: 5}, {mood: 1}, {age: 5}]
"""


class Host:
    """A host with one agent; while slow, it answers nothing."""

    def __init__(self, ros: Any) -> None:
        self.slow: Future | None = None
        ros.node.create_service(
            SetProfile,
            "/agents/set_profile",
            self._take,
            qos_profile=qos.SERVICE,
            callback_group=ReentrantCallbackGroup(),
        )
        self._cards = ros.node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
        agent = AgentCard(name="mira", profile=[3.0] * 3, learning_rate=0.5)
        self._cards.publish(HostCard(host="/agents", parameters=SPACE.names, agents=[agent]))

    async def _take(self, _request: Any, response: Any) -> Any:
        if self.slow is not None:
            await self.slow
        response.accepted = True
        return response


class Giver:
    """Alternately gives and collects feedback, each through an outbox."""

    def __init__(self, ros: Any) -> None:
        node = ros.node
        give = node.create_client(GiveFeedback, "feedback/give", qos_profile=qos.SERVICE)
        collect = node.create_client(CollectFeedback, "feedback/collect", qos_profile=qos.SERVICE)
        self._give, self._collect = (
            Outbox(node, client, answer_s=0.5) for client in (give, collect)
        )
        self.answers: list[Any] = []

    def put(self, number: int) -> str:
        """Give the feedback of a number; return its id."""
        about = scene_to_msg(scene(f"s{number}", age=5, familiarity=3, mood=3))
        if number % 2:
            request = CollectFeedback.Request(
                epoch="e", round=number, agent="mira", outcome=1, scene=about
            )
            self._collect.put(request, self.answers.append)
            return f"simulated/e/{number}/mira"
        given = GiveFeedback.Request(
            feedback_id=f"tree/{number}", agent="mira", kind=1, source="tree", scene=about
        )
        self._give.put(given, self.answers.append)
        return given.feedback_id


def test_feedback_recorded_before_kill_is_not_applied_again(system: System) -> None:
    simulated = system.folder / "simulated.yaml"
    simulated.write_text(SIMULATED)
    ledger = system.folder / "ledger.sqlite"
    host, giver = Host(system.ros), Giver(system.ros)
    heard: list[Feedback] = system.ros.collect(Feedback, "bt_agents/feedback", qos.HISTORY)
    node = system.start(components.feedback(ROOT / "trees", str(ledger), simulated))
    for number in range(1, TIMES + 1):
        host.slow = Future()
        feedback_id = giver.put(number)
        system.until(
            lambda wanted=feedback_id: wanted in [one.feedback_id for one in heard],
            f"feedback {number} is recorded",
        )
        assert len(giver.answers) == number - 1
        node.kill()
        host.slow.set_result(None)
        host.slow = None
        node.start()
        system.until(lambda wanted=number: len(giver.answers) == wanted, "the answer")
        answer = giver.answers[-1]
        assert answer.accepted
        assert f"recorded before as revision {number}, not applied again" in answer.message
        assert (answer.feedback.feedback_id, answer.feedback.revision) == (feedback_id, number)
    node.kill()
    with Ledger(ledger) as book:
        history = book.history("mira")
    assert [revision.revision for revision in history] == list(range(TIMES + 1))
    assert len({revision.cause.feedback_id for revision in history[1:]}) == TIMES
    # The list continued after each restart.
    collected = [r.cause.target for r in history if r.cause.source == "simulated"]
    assert [list(target) for target in collected] == [
        [name] for name in ("mood", "mood", "age") * 3
    ] + [["mood"]]


def test_full_disk_refuses_feedback_until_space_returns(system: System) -> None:
    ledger = system.folder / "ledger.sqlite"
    with Ledger(ledger) as book:
        book.enter({f"agent{number}": {"age": 3.0} for number in range(1500)})
    Host(system.ros)
    profiles: list[Profiles] = system.ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
    node = system.start(components.feedback(ROOT / "trees", str(ledger)))
    system.until(lambda: profiles and list(profiles[-1].agents) == ["mira"], "the profile")
    client = system.ros.node.create_client(GiveFeedback, "feedback/give")

    def give(number: int) -> Any:
        request = GiveFeedback.Request(
            feedback_id=f"f{number}", agent="mira", kind=3, values=[5.0 - number % 2] * 3
        )
        return system.ros.call(client, request)

    def limit(size: int) -> None:
        resource.prlimit(node.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

    assert give(0).accepted
    # Limit on the size of the node's files, which its log and ledger exceed.
    limit(16 * 1024)
    number, answer = 0, None
    while answer is None or answer.accepted:
        number += 1
        assert number < 50
        answer = give(number)
    assert answer.code == "STORAGE_FULL"
    assert "make room" in answer.message
    assert give(number).code == "STORAGE_FULL"
    kept = 1 + number - 1
    with closing(sqlite3.connect(f"file:{ledger}?mode=ro", uri=True)) as reader:
        where = "SELECT max(revision) FROM revision WHERE agent = 'mira'"
        assert reader.execute(where).fetchone() == (kept,)
    limit(resource.RLIM_INFINITY)
    answer = give(number)
    assert answer.accepted, answer.message
    assert answer.feedback.revision == kept + 1
    assert not node.crashed
    node.kill()
    with Ledger(ledger) as book:
        ids = [row.cause.feedback_id for row in book.history("mira")[1:]]
    assert ids == [f"f{one}" for one in range(number + 1)]
