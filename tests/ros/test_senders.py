# SPDX-License-Identifier: Apache-2.0
"""Proof of the sender: messages that another process sends as a host or market."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import serialize_message

from active_nodes import active_feedback
from bt_agents_core.errors import Refused
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Auction, Bids, Heartbeat, Profiles, Run
from bt_agents_interfaces.srv import GiveFeedback, RegisterHost, SetProfile
from bt_agents_ros import qos
from fake_market import Market, agent_text, folder, make_host
from feedback_node.ledger import Ledger
from market_harness import EXPRESS, GUIDE, SPACE
from market_node_harness import FakeHost, MarketNodeHarness
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.node.messages import heartbeat_of
from stranger import Stranger

TOKEN = bytes(range(1, 17))

WAITER = agent_text("talker", "wait: 60 s")


def test_early_forged_bid_does_not_win(ros: Any, stranger: Stranger) -> None:
    # No round ends before the host answers.
    harness = MarketNodeHarness(ros, bid_deadline=30.0)
    heard: list[Bids] = ros.collect(Bids, "bt_agents/bids", qos.EVENTS)
    host = harness.host()
    forged = stranger.publisher(Bids, "bt_agents/bids")
    ros.until(lambda: forged.get_subscription_count() == 2)
    host.silent = True
    harness.scene()
    ros.until(lambda: host.calls)
    [call] = host.calls
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
    ros.until(lambda: heard)
    ros.turns()
    host.silent = False
    host.answer(call)
    ros.until(lambda: harness.auctions)

    [auction] = harness.auctions
    assert (auction.outcome, auction.winner) == (Auction.AWARDED, GUIDE)
    [refused] = auction.refused
    assert (refused.host, refused.code) == (host.host, "WRONG_TOKEN")
    assert "without the token of its registration" in refused.reason


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        (lambda whole: b"", "WRONG_TOKEN"),
        (lambda whole: whole[:19], "WRONG_TOKEN"),
        (lambda whole: whole.replace(TOKEN, TOKEN[::-1]), "WRONG_TOKEN"),
        (lambda whole: whole[:20], "MALFORMED"),
        (lambda whole: whole[:30], "MALFORMED"),
    ],
    ids=["empty", "cut in token", "other token", "cut after token", "cut later"],
)
def test_false_or_malformed_heartbeat_is_refused(
    changed: Callable[[bytes], bytes], code: str
) -> None:
    entry = HostEntry(
        host="/agents", instance="first", run_action="", heartbeat="", agents={}, token=TOKEN
    )
    sent = Heartbeat(token=list(TOKEN), host="/agents", round=7)
    whole = serialize_message(sent)
    assert heartbeat_of(entry, whole) == sent
    with pytest.raises(Refused, match=code):
        heartbeat_of(entry, changed(whole))


def test_forged_result_does_not_end_run(ros: Any) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.busy_host()
    own, host.token = host.token, [0] * 16
    host.finish()
    ros.until(lambda: host.goal is None)
    host.token = own
    assert harness.until_event(Run.ENDED).outcome == Run.LOST
    assert harness.market._hosts._goals == {}


def test_results_without_run_do_not_pile_up(ros: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answered = []

    async def claim_end(_host: FakeHost, handle: Any) -> RunAgent.Result:
        answered.append(handle.request.round)
        handle.abort()
        return RunAgent.Result(outcome=RunAgent.Result.FAILED)

    monkeypatch.setattr(FakeHost, "execute", claim_end)
    harness = MarketNodeHarness(ros, goal_deadline=0.1)
    harness.host().explains = {GUIDE, EXPRESS}
    harness.scene()
    ros.until(lambda: len(answered) == 10)
    assert len(harness.market._hosts._goals) < 5


def test_foreign_heartbeats_do_not_keep_host_alive(
    ros: Any, stranger: Stranger, capfd: pytest.CaptureFixture[str]
) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    ros.until(lambda: harness.statuses[-1].hosts == 1)
    forged = stranger.publisher(Heartbeat, "/agents/heartbeat")
    name = host.host
    ros.remove(host)

    def is_gone() -> bool:
        forged.publish(Heartbeat(host=name, host_instance="first"))
        return bool(harness.statuses[-1].hosts == 0)

    ros.until(is_gone)
    assert "WRONG_TOKEN: /agents/heartbeat: in the name of /agents" in capfd.readouterr().err


def test_stranger_cannot_register_as_existing_host(ros: Any, stranger: Stranger) -> None:
    harness = MarketNodeHarness(ros)
    host = harness.host()
    ros.until(lambda: harness.statuses[-1].hosts == 1)
    request = host.request(run_action="/stranger/run", agents=["spy"], token=[0] * 16)
    answer = stranger.call(RegisterHost, "marketplace/register", request)
    assert not answer.accepted
    assert answer.message.startswith("WRONG_TOKEN")
    assert not any(answer.token)
    harness.scene()
    assert harness.until_event(Run.STARTED).agent == GUIDE
    assert host.goal.agent == GUIDE


def test_host_proves_itself_in_bids_heartbeats_results(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    heartbeats: list[Heartbeat] = ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    host = ros.add(make_host(folder(tmp_path, WAITER)))
    ros.until(lambda: heartbeats)
    assert not any(heartbeats[0].token)
    market.open()
    ros.until(lambda: host.registered)
    market.call()
    ros.until(lambda: market.bids)
    handle = market.send(market.goal(host))
    ros.until(lambda: heartbeats[-1].round == 1)
    handle.cancel_goal_async()
    result = market.result(handle).result
    assert result.outcome == RunAgent.Result.CANCELLED
    assert [bytes(one.token) for one in (market.bids[-1], heartbeats[-1], result)] == [TOKEN] * 3


def test_goal_without_market_token_is_refused(
    ros: Any, market: Market, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    host = market.host(folder(tmp_path, WAITER))
    for token in (bytes(16), bytes(range(16))):
        assert market.refusal(market.goal(host, token=list(token))) == "NOT_THE_MARKET"
        assert "NOT_THE_MARKET" in capfd.readouterr().err
    assert market.send(market.goal(host)).accepted


def profile(revision: int, value: float = 5.0) -> SetProfile.Request:
    return SetProfile.Request(agent="talker", values=[value, 3.0, 3.0], revision=revision)


def test_forged_future_revision_does_not_block_later_profiles(
    ros: Any, market: Market, tmp_path: Path, stranger: Stranger
) -> None:
    host = market.host(folder(tmp_path, WAITER))
    # A host cannot know who sets a profile.
    assert stranger.call(SetProfile, "agents/set_profile", profile(2**32 - 1)).accepted
    member = host.registry.members["talker"]
    assert (member.profile[0], member.revision) == (5.0, 2**32 - 1)

    published: list[Profiles] = ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
    ros.add(active_feedback(SPACE, Ledger(":memory:")))
    ros.until(lambda: (member.profile[0], member.revision) == (3.0, 0))
    ros.until(lambda: published and not published[-1].differing)

    assert stranger.call(SetProfile, "agents/set_profile", profile(2**32 - 1)).accepted
    ros.until(lambda: (member.profile[0], member.revision) == (3.0, 0))
    lesson = {"agent": "talker", "values": [5.0, 5.0, 5.0], "source": "anna"}
    answer = ros.ask(GiveFeedback, "feedback/give", **lesson)
    assert answer.accepted, answer.message
    ros.until(lambda: member.revision == answer.feedback.revision)
    assert 3.0 < member.profile[0] < 5.0


def test_goals_of_market_without_token_are_refused(market: Market, tmp_path: Path) -> None:
    market.token = bytes(16)
    host = market.host(folder(tmp_path, WAITER))
    assert market.refusal(market.goal(host, token=[0] * 16)) == "NOT_THE_MARKET"
    assert market.refusal(market.goal(host, host_instance="")) == "NOT_THE_MARKET"
