# SPDX-License-Identifier: Apache-2.0
"""The host node: registration, bids, runs, cancels and tuning, with a probe as market."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from bt_agents.host import market_registration
from bt_agents.host.node import HostNode
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Heartbeat, HostCard, Scene, StatusChange, Trees, TreeStatus
from bt_agents_interfaces.srv import GiveFeedback, RegisterHost
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from fake_market import Market, agent_text, folder, make_host
from scripted_server import ScriptedServer
from tree_harness import scene

NAN = math.nan

TALKER = agent_text(
    "talker",
    "say: hello\n  timeout: ${patience}",
    """requires: scene.person
tunables:
  patience: {default: 8 s, min: 1 s, max: 60 s, description: how long it may take}
on_cancel:
  wait: 0 s""",
)

QUICK = agent_text("quick", "wait: 0 s")
CRITIC = agent_text(
    "critic",
    """sequence:
    - log: {message: "The person is ${scene.age}.", level: warning}
    - give_feedback: {kind: direct, values: {mood: 4}, reason: they smiled}""",
)


@pytest.fixture
def host(ros: Any, market: Market, tmp_path: Path) -> HostNode:
    return market.host(folder(tmp_path, TALKER, QUICK))


def test_early_call_is_answered_after_registration(
    ros: Any, market: Market, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # After a stall of the machine it would register, and be called, once more.
    monkeypatch.setattr(market_registration, "STALL_S", 300.0)
    host = ros.add(make_host(folder(tmp_path, TALKER)))
    market.on_register = market.call
    market.open()
    ros.until(lambda: host.registered and market.bids)
    assert [(bids.round, list(bids.agent_ids)) for bids in market.bids] == [(1, [1])]


def test_excluded_agents_and_foreign_calls_get_no_bid(
    ros: Any, host: HostNode, market: Market
) -> None:
    market.call(round_number=1, epoch="e0")
    market.call(round_number=2, parameters=["size"])
    market.call(round_number=2, scene=Scene())
    market.call(round_number=3, excluded=["talker"])
    ros.until(lambda: market.bids)
    assert [bids.round for bids in market.bids] == [3]
    assert list(market.bids[0].agents) == ["quick"]


def test_refused_agent_does_not_bid_and_shows_reason(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    market.refuse["quick"] = "already registered by /other"
    cards = ros.collect(HostCard, "bt_agents/cards", qos.FACTS)
    ros.add(make_host(folder(tmp_path, TALKER, QUICK)))
    market.open()
    ros.until(lambda: cards and cards[-1].problems)
    [problem] = cards[-1].problems
    assert problem.agent == "quick"
    assert "already registered" in problem.message
    market.call()
    ros.until(lambda: market.bids)
    assert list(market.bids[0].agents) == ["talker"]


def test_agent_with_undecidable_requirement_does_not_bid(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    cards = ros.collect(HostCard, "bt_agents/cards", qos.FACTS)
    unsure = TALKER.replace("requires: scene.person", "requires: 1 / (scene.age - 3) > 0")
    market.host(folder(tmp_path, unsure, QUICK))
    market.call(scene=scene_to_msg(scene(age=3)))
    ros.until(lambda: market.bids and cards and cards[-1].problems)
    reason = "needs what cannot be decided: 1 / (scene.age - 3) > 0 ('/' by zero)"
    assert list(market.bids[0].decline_reasons) == [reason]
    [problem] = cards[-1].problems
    assert (problem.agent, problem.message) == ("talker", f"does not bid: it {reason}")
    market.call(round_number=2, scene=scene_to_msg(scene(age=2)))
    ros.until(lambda: not cards[-1].problems)


def test_host_publishes_card_only_while_registered(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    market.refuses_host = "HOST_EXISTS: another /agents is alive"
    cards = ros.collect(HostCard, "bt_agents/cards", qos.FACTS)
    host = ros.add(make_host(folder(tmp_path, TALKER)))
    market.open()
    ros.until(lambda: len(market.requests) >= 2)
    ros.turns(20)
    assert cards == []
    market.refuses_host = ""
    ros.until(lambda: cards)
    assert [card.name for card in cards[0].agents] == ["talker"]
    market.refuses_host = "OTHER_PARAMETERS: both must read the same scene.yaml"
    market.epoch = "e2"
    market.open()
    ros.until(lambda: not host._registration.accepted)
    late = ros.collect(HostCard, "bt_agents/cards", qos.FACTS)
    ros.turns(20)
    assert (len(cards), late) == (1, [])


def test_run_publishes_heartbeats_and_status_changes(
    ros: Any, host: HostNode, market: Market, mouth: ScriptedServer
) -> None:
    statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    beats = ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    ros.until(lambda: beats)
    assert beats[-1].agent == ""
    handle = market.send(market.goal(host))
    ros.until(lambda: mouth.goals and beats[-1].tip == "tree")
    assert (beats[-1].agent, beats[-1].round) == ("talker", 1)
    mouth.goals[0].finish()
    answer = market.result(handle)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    assert [goal.request.text for goal in mouth.goals] == ["hello"]
    changes = [(c.path, c.status) for s in statuses for c in s.changes]
    assert changes == [
        ("tree", StatusChange.RUNNING),
        ("tree@timeout", StatusChange.RUNNING),
        ("tree", StatusChange.SUCCESS),
        ("tree@timeout", StatusChange.SUCCESS),
    ]


def test_tree_logs_and_gives_feedback_as_its_agent(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    requests: list[GiveFeedback.Request] = []

    def take(request: Any, response: Any) -> Any:
        requests.append(request)
        response.accepted = True
        return response

    ros.node.create_service(GiveFeedback, "feedback/give", take, qos_profile=qos.SERVICE)
    lines = ros.collect(Log, "/rosout", qos.HISTORY)
    statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    host = market.host(folder(tmp_path, CRITIC))
    answer = market.result(market.send(market.goal(host, agent="critic")))
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    [request] = requests
    assert (request.agent, request.source, request.reason) == ("critic", "tree", "they smiled")
    assert str(list(request.values)) == "[nan, nan, 4.0]"
    ros.until(lambda: any(line.name == "agents.critic" for line in lines))
    ros.until(lambda: any(s.changes[-1].path == "tree" for s in statuses))
    told = [(c.path, c.message) for s in statuses for c in s.changes]
    assert ("tree/0.log", "The person is 3.") in told
    assert ("tree/1.give_feedback", "direct feedback given") in told


def test_mismatched_goal_is_refused_by_name(host: HostNode, market: Market) -> None:
    for wrong, code in (
        ({"host_instance": "another"}, "WRONG_INSTANCE"),
        ({"agent": "nobody"}, "UNKNOWN_AGENT"),
        ({"agent_id": 99}, "WRONG_ID"),
    ):
        assert market.refusal(market.goal(host, **wrong)) == code


def test_learning_rate_is_parameter_and_appears_on_card(ros: Any, host: HostNode) -> None:
    cards = ros.collect(HostCard, "bt_agents/cards", qos.FACTS)
    rates = [Parameter("talker.learning_rate", value=value) for value in (1.5, NAN, 0.5)]
    asked = [rate.to_parameter_msg() for rate in rates]
    answer = ros.ask(SetParameters, "agents/set_parameters", parameters=asked)
    assert [one.successful for one in answer.results] == [False, False, True]
    ros.until(lambda: cards and cards[-1].agents[1].learning_rate == 0.5)


def test_late_subscriber_receives_structure_of_every_tree(ros: Any, host: HostNode) -> None:
    trees = ros.collect(Trees, "agents/trees", qos.FACT)
    ros.until(lambda: trees)
    talker = next(tree for tree in trees[-1].trees if tree.agent == "talker")
    assert [(n.path, n.kind, n.parent) for n in talker.nodes] == [
        ("tree@timeout", "timeout", -1),
        ("tree", "say", 0),
        ("on_cancel", "wait", -1),
    ]
    assert talker.nodes[1].line == 7


def test_unanswered_registration_gets_a_new_client(
    ros: Any, host: HostNode, market: Market
) -> None:
    first = host._registration._client
    ros.node.destroy_service(market.registration)
    known = len(market.requests)
    market.epoch = "e2"
    market.open()
    ros.until(lambda: host._registration._client is not first)
    assert len(market.requests) == known
    ros.node.create_service(
        RegisterHost, "marketplace/register", market._register, qos_profile=qos.SERVICE
    )
    ros.until(lambda: len(market.requests) > known)
