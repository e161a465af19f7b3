# SPDX-License-Identifier: Apache-2.0
"""Who speaks in whose name: what another process sends in the name of a host or market."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import Trigger

from active_nodes import active_feedback
from bt_agents_interfaces.msg import Auction, Bids, Feedback, Heartbeat, Profiles
from bt_agents_interfaces.srv import GiveFeedback, RegisterHost, SetProfile
from bt_agents_ros import qos
from bt_agents_ros.workarounds.cached_executor import CachedExecutor
from bt_agents_ros.workarounds.sender_identity import (
    PREFIX,
    UNKNOWN,
    create_identified_service,
    create_identified_subscription,
)
from fake_market import Market, folder, make_host
from feedback_node.ledger import Ledger
from market_harness import EXPRESS, GUIDE, SPACE
from market_node_harness import FakeHost, MarketNodeHarness

WAITER = """
format: 1
agent: talker
title: Talker
description: waits
profile: {age: 3, familiarity: 3, mood: 3}
tree: {wait: 60 s}
"""


class Stranger:
    """Node with a participant of its own, as another process has one."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("stranger", context=self.context)
        self.executor = CachedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def publisher(self, ros: Any, kind: Any, topic: str) -> Any:
        publisher = self.node.create_publisher(kind, topic, qos.EVENTS)
        ros.until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def call(self, ros: Any, kind: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(kind, name, qos_profile=qos.SERVICE)
        ros.until(client.service_is_ready)
        answer = client.call_async(request)

        def answered() -> bool:
            self.executor.spin_once(0.0)
            return bool(answer.done())

        ros.until(answered)
        return answer.result()

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def stranger(ros: Any) -> Iterator[Stranger]:
    other = Stranger()
    yield other
    other.close()


def prefix_of(node: Any, topic: str, name: str) -> str:
    ends = node.get_publishers_info_by_topic(topic)
    return next(bytes(e.endpoint_gid[:PREFIX]).hex() for e in ends if e.node_name == name)


@pytest.mark.parametrize("kind", [CachedExecutor, SingleThreadedExecutor])
def test_callback_receives_sender_participant_from_graph(
    ros: Any, stranger: Stranger, kind: Any
) -> None:
    heard: list[tuple[str, str]] = []
    node = rclpy.create_node("listener")
    executor = kind()
    executor.add_node(node)

    def answer(_request: Any, response: Any, sender: str) -> Any:
        heard.append(("request", sender))
        return response

    create_identified_service(node, Trigger, "ask", answer, qos.SERVICE)
    create_identified_subscription(
        node, String, "words", lambda text, sender: heard.append((text.data, sender)), qos.EVENTS
    )
    create_identified_subscription(
        node,
        String,
        "words",
        lambda raw, sender: heard.append((f"{len(raw)} bytes", sender)),
        qos.EVENTS,
        raw=True,
    )
    own = ros.node.create_publisher(String, "words", qos.EVENTS)
    other = stranger.node.create_publisher(String, "words", qos.EVENTS)
    asking = stranger.node.create_client(Trigger, "ask", qos_profile=qos.SERVICE)
    ros.until(
        lambda: (
            own.get_subscription_count() == other.get_subscription_count() == 2
            and asking.service_is_ready()
        )
    )
    ros.until(lambda: len(ros.node.get_publishers_info_by_topic("words")) == 2)
    own.publish(String(data="a"))
    other.publish(String(data="b" * 100))
    asking.call_async(Trigger.Request())

    def all_heard() -> bool:
        executor.spin_once(0.01)
        return len(heard) == 5

    ros.until(all_heard)
    here = prefix_of(ros.node, "words", "probe")
    there = prefix_of(ros.node, "words", "stranger")
    assert UNKNOWN != here != there != UNKNOWN
    assert sorted(heard) == sorted(
        [
            ("a", here),
            ("b" * 100, there),
            ("10 bytes", here),
            ("109 bytes", there),
            ("request", there),
        ]
    )
    executor.shutdown()
    node.destroy_node()


def test_early_forged_bid_wins_no_round(ros: Any, stranger: Stranger) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    forged = stranger.publisher(ros, Bids, "bt_agents/bids")
    host.silent = True
    for number in range(1, 6):
        harness.scene(f"s{number}")
        ros.until(lambda n=number: bool(host.calls) and host.calls[-1].round == n)
        call = host.calls[-1]
        forged.publish(
            Bids(
                epoch=call.epoch,
                round=call.round,
                host=host.host,
                host_instance="first",
                agents=[EXPRESS],
                agent_ids=[host.agent_ids[1]],
                vectors=[5.0, 1.0, 3.0],
            )
        )
        ros.turns()
        host.silent = False
        host.answer(call)
        host.silent = True
        ros.until(lambda n=number: len(harness.auctions) == n)
        ros.until(lambda: host.ended is not None and not host.ended.done())
        host.finish()
        harness.until_over(f"s{number}")

    assert [auction.winner for auction in harness.auctions] == [GUIDE] * 5
    refused = [one for auction in harness.auctions for one in auction.refused]
    assert [(one.host, one.code) for one in refused] == [(host.host, "OTHER_PARTICIPANT")] * 5
    assert all(auction.outcome == Auction.AWARDED for auction in harness.auctions)
    assert "which has registered it" in refused[0].reason


def test_foreign_heartbeats_do_not_keep_host_alive(ros: Any, stranger: Stranger) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    ros.until(lambda: harness.statuses[-1].hosts == 1)
    forged = stranger.publisher(ros, Heartbeat, "/agents/heartbeat")
    name = host.host
    ros.remove(host)

    def is_gone() -> bool:
        forged.publish(Heartbeat(host=name, host_instance="first"))
        return bool(harness.statuses[-1].hosts == 0)

    ros.until(is_gone)


def test_stranger_cannot_register_as_existing_host(ros: Any, stranger: Stranger) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    request = host.request(run_action="/stranger/run", agents=["spy"])
    answer = stranger.call(ros, RegisterHost, "marketplace/register", request)
    assert not answer.accepted
    assert answer.message.startswith("OTHER_PARTICIPANT")
    assert not any(answer.award_key)
    harness.scene()
    assert harness.until_event(1).agent == GUIDE
    assert host.goal.agent == GUIDE


def test_restarted_host_registers_from_its_new_process(ros: Any, stranger: Stranger) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    request = host.request(host_instance="second")
    ros.until(lambda: harness.statuses[-1].hosts == 1)
    ros.remove(host)
    ros.until(lambda: harness.statuses[-1].hosts == 0)
    answer = stranger.call(ros, RegisterHost, "marketplace/register", request)
    assert answer.accepted, answer.message


def test_goals_carry_award_key_of_registration(ros: Any) -> None:
    harness = MarketNodeHarness(ros)
    host: FakeHost = harness.host()
    first = ros.call(harness.registering, host.request())
    again = ros.call(harness.registering, host.request())
    other = ros.call(harness.registering, host.request(host="/b", agents=["b"]))
    harness.scene()
    harness.until_event(1)
    assert bytes(host.goal.award_key) == bytes(first.award_key) == bytes(again.award_key)
    assert bytes(other.award_key) != bytes(first.award_key)
    assert any(other.award_key)


@pytest.mark.parametrize("key", [bytes(16), bytes(range(16))])
def test_goal_without_market_key_is_refused(
    ros: Any, tmp_path: Path, key: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    market = Market(ros)
    host = ros.add(make_host(folder(tmp_path, WAITER)))
    market.open()
    ros.until(lambda: host.registered)
    assert market.refusal(market.goal(host, award_key=list(key))) == "NOT_THE_MARKET"
    assert "NOT_THE_MARKET" in capfd.readouterr().err
    assert market.send(market.goal(host)).accepted


def profile(revision: int, value: float = 5.0) -> SetProfile.Request:
    return SetProfile.Request(agent="talker", values=[value, 3.0, 3.0], revision=revision)


def test_forged_future_revision_does_not_block_later_profiles(
    ros: Any, tmp_path: Path, stranger: Stranger
) -> None:
    market = Market(ros)
    host = ros.add(make_host(folder(tmp_path, WAITER)))
    market.open()
    ros.until(lambda: host.registered)
    # While there is no feedback node, a host cannot tell who may set a profile.
    assert stranger.call(ros, SetProfile, "agents/set_profile", profile(2**32 - 1)).accepted
    member = host.registry.members["talker"]
    assert (member.profile[0], member.revision) == (5.0, 2**32 - 1)

    published: list[Profiles] = ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
    ros.add(active_feedback(SPACE, Ledger(":memory:")))
    ros.until(lambda: (member.profile[0], member.revision) == (3.0, 0))
    ros.until(lambda: published and not published[-1].differing)

    refused = stranger.call(ros, SetProfile, "agents/set_profile", profile(2**32 - 1))
    assert (refused.accepted, refused.code) == (False, "OTHER_PARTICIPANT")
    teaching = ros.node.create_client(GiveFeedback, "feedback/give", qos_profile=qos.SERVICE)
    lesson = GiveFeedback.Request(
        agent="talker", kind=Feedback.DIRECT, values=[5.0, 5.0, 5.0], source="anna"
    )
    answer = ros.call(teaching, lesson)
    assert answer.accepted, answer.message
    ros.until(lambda: member.revision == answer.feedback.revision)
    assert 3.0 < member.profile[0] < 5.0


def test_goals_of_market_without_key_are_refused(ros: Any, tmp_path: Path) -> None:
    market = Market(ros)
    market.key = bytes(16)
    host = ros.add(make_host(folder(tmp_path, WAITER)))
    market.open()
    ros.until(lambda: host.registered)
    assert market.refusal(market.goal(host, award_key=[0] * 16)) == "NOT_THE_MARKET"
