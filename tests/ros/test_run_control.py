# SPDX-License-Identifier: Apache-2.0
"""Runs that people pause, step and resume: with real goals, deadlines and cancels."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from bt_agents.host.node import HostNode
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import (
    Countdown,
    Heartbeat,
    NodeDetails,
    RunControl,
    StatusChange,
    TreeStatus,
)
from bt_agents_interfaces.srv import ControlRun
from bt_agents_ros import qos
from fake_market import Market, agent_text, folder, never_held_up
from scripted_server import Script, ScriptedServer

pytestmark = pytest.mark.ros

PAUSE, RESUME = ControlRun.Request.PAUSE, ControlRun.Request.RESUME
STEP, BREAKPOINTS = ControlRun.Request.STEP, ControlRun.Request.BREAKPOINTS


TALKER = agent_text("talker", "sequence: [{say: one}, {say: two}]", "on_cancel: {say: good-bye}")
SLEEPER = agent_text("sleeper", "wait: 0.5 s")
DOZER = agent_text("dozer", "wait: 30 s")
FILLED = agent_text(
    "filled", "sequence: [{set: {name: Anna}}, {say: 'Hello ${name}', timeout: 9 s}]"
)


class Host:
    """A host with run control that no stall holds up, and its messages about that."""

    def __init__(self, ros: Any, market: Market, node: HostNode) -> None:
        self.ros, self.market, self.node = ros, market, never_held_up(node)
        self._client = ros.node.create_client(
            ControlRun, "agents/control", qos_profile=qos.SERVICE
        )
        self.controls = ros.collect(RunControl, "agents/run_control", qos.FACT)
        ros.until(lambda: self._client.service_is_ready() and self.controls)

    def ask(self, action: int, **fields: Any) -> Any:
        future = self._client.call_async(ControlRun.Request(action=action, **fields))
        self.ros.until(future.done)
        return future.result()

    def done(self, action: int, **fields: Any) -> str:
        answer = self.ask(action, **fields)
        assert answer.accepted, answer.message
        return str(answer.message)

    def stop_before(self, name: str, *paths: str) -> None:
        self.done(BREAKPOINTS, agent=name, paths=list(paths))

    @property
    def control(self) -> Any:
        return self.controls[-1]

    def paused_at(self, path: str) -> None:
        self.ros.until(lambda: self.control.paused and self.control.paused_at == path)

    def ticks(self) -> int:
        return int(self.node._runs.run.ticks)


@pytest.fixture
def host(ros: Any, market: Market, tmp_path: Path) -> Host:
    node = market.host(folder(tmp_path, TALKER, SLEEPER, DOZER, FILLED))
    return Host(ros, market, node)


def pass_time(ros: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    ros.until(lambda: time.monotonic() >= end)


def test_paused_tree_is_ticked_only_by_steps(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    handle = market.send(market.goal(host.node))
    ros.until(lambda: mouth.goals)
    assert host.done(PAUSE, author="anna") == "talker is paused at tree/0.say"
    ros.until(lambda: host.control.paused)
    assert (host.control.author, host.control.agent, host.control.round) == ("anna", "talker", 1)
    before = host.ticks()
    mouth.goals[0].finish()
    pass_time(ros, 0.3)
    assert (host.ticks(), len(mouth.goals)) == (before, 1)
    assert host.done(STEP) == "talker was ticked once, and is at tree/1.say"
    ros.until(lambda: len(mouth.goals) == 2)
    assert host.ticks() == before + 1
    assert host.done(RESUME) == "talker goes on"
    mouth.goals[1].finish()
    answer = market.result(handle)
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    ros.until(lambda: not host.control.agent)
    assert not host.control.paused


def test_breakpoint_pauses_run_and_step_starts_its_node(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    statuses = ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    ros.until(host.node._runs._status.get_subscription_count)
    host.stop_before("talker", "tree/0.say", "tree/1.say")
    market.send(market.goal(host.node))
    host.paused_at("tree/0.say")
    ros.until(lambda: statuses)
    assert statuses[-1].tip == "tree/0.say"
    last = statuses[-1].changes[0]
    assert (last.path, last.status) == ("tree/0.say", StatusChange.RUNNING)
    pass_time(ros, 0.2)
    assert mouth.goals == []
    assert host.done(STEP) == "talker was ticked once, and is at tree/0.say"
    ros.until(lambda: mouth.goals)
    host.paused_at("")
    mouth.goals[0].finish()
    host.done(RESUME)
    host.paused_at("tree/1.say")
    assert len(mouth.goals) == 1
    host.stop_before("talker")
    host.done(RESUME)
    ros.until(lambda: len(mouth.goals) == 2)


def test_breakpoints_outlive_their_run(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    mouth.script = Script()
    host.stop_before("talker", "tree/0.say")
    for number in (1, 2):
        handle = market.send(market.goal(host.node, round=number))
        host.paused_at("tree/0.say")
        handle.cancel_goal_async()
        assert market.result(handle).result.outcome == RunAgent.Result.CANCELLED
    assert [one.path for one in host.control.breakpoints] == ["tree/0.say"]
    assert [goal.request.text for goal in mouth.goals] == ["good-bye", "good-bye"]


def test_paused_run_still_hears_cancel_and_cleans_up(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    host.node._runs.set_rate(1.0)  # a tick may take a second; the pause is longer
    beats = ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    market.live()
    handle = market.send(market.goal(host.node))
    ros.until(lambda: mouth.goals)
    host.done(PAUSE)
    before = len(beats)
    # Longer than the leases of the market and of the host.
    ros.until(lambda: len(beats) - before > 12)
    assert beats[-1].tip_name == 'say "one"'
    handle.cancel_goal_async()
    ros.until(lambda: len(mouth.goals) == 2)
    assert mouth.goals[1].request.text == "good-bye"
    ros.until(lambda: not host.control.paused)
    mouth.goals[1].finish()
    result = market.result(handle).result
    assert result.outcome == RunAgent.Result.CANCELLED
    assert result.overruns == 0


def test_step_advances_paused_tree_clock_by_one_period(
    ros: Any, host: Host, market: Market
) -> None:
    host.stop_before("sleeper", "tree")
    handle = market.send(market.goal(host.node, agent="sleeper"))
    host.paused_at("tree")
    before_s = host.node._runs.environment.clock() - host.node._runs.run._start
    pass_time(ros, 0.8)
    steps = 0
    while host.node._runs.run is not None and host.node._runs.run.result is None:
        host.done(STEP)
        steps += 1
    # The first begins the wait of ten periods, which rounding may shorten.
    assert steps in (11, 12)
    answer = market.result(handle)
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    assert answer.result.duration_s == pytest.approx(before_s + steps * 0.05)


def test_a_silent_market_ends_a_paused_run(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    host.node.set_parameters([Parameter("market_lease", value=0.5)])
    market.live()
    handle = market.send(market.goal(host.node))
    ros.until(lambda: mouth.goals)
    host.done(PAUSE)
    mouth.script = Script()
    market.fall_silent()
    assert market.result(handle).result.stop_cause == RunAgent.Result.MARKET_LOST


def test_invalid_request_is_refused_by_name(host: Host) -> None:
    for action, fields, code in (
        (PAUSE, {}, "NOT_RUNNING"),
        (9, {}, "NOT_RUNNING"),
        (BREAKPOINTS, {"agent": "nobody"}, "UNKNOWN_AGENT"),
        (BREAKPOINTS, {"agent": "talker", "paths": ["tree/0.sya"]}, "UNKNOWN_NODE"),
        (BREAKPOINTS, {"agent": "talker", "paths": ["on_cancel"]}, "UNKNOWN_NODE"),
    ):
        answer = host.ask(action, **fields)
        assert (answer.accepted, answer.code) == (False, code)
        assert answer.message


def test_repeated_request_or_wrong_round_is_refused(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    market.send(market.goal(host.node))
    ros.until(lambda: mouth.goals)
    assert host.ask(PAUSE, round=7).code == "OTHER_ROUND"
    assert host.ask(PAUSE, epoch="e0").code == "OTHER_ROUND"
    assert host.ask(9).code == "UNKNOWN_ACTION"
    assert host.ask(STEP).code == host.ask(RESUME).code == "NOT_PAUSED"
    assert host.ask(PAUSE, epoch="e1", round=1, author="\x1b[2Janna\n").accepted
    again = host.ask(PAUSE)
    assert (again.code, again.message) == ("ALREADY_PAUSED", "it is paused by [2Janna already")


def values(details: Sequence[Any]) -> list[tuple[str, str, str, bool]]:
    return [(v.path, v.name, v.value, v.written) for one in details for v in one.values]


def test_node_details_are_traced_only_while_subscribed(
    ros: Any, host: Host, market: Market, mouth: ScriptedServer
) -> None:
    handle = market.send(market.goal(host.node, agent="sleeper"))
    ros.until(lambda: host.node._runs.run)
    assert host.node._details._tree is None
    market.result(handle)
    details = ros.collect(NodeDetails, "agents/details", qos.EVENTS)
    ros.until(lambda: host.node._details._wanted)
    handle = market.send(market.goal(host.node, agent="filled", round=2))
    ros.until(lambda: mouth.goals and details)
    assert values(details) == [
        ("tree/0.set", "name", "'Anna'", True),
        ("tree/1.say", "name", "'Anna'", False),
    ]
    [timeout] = details[-1].countdowns
    assert (timeout.path, timeout.kind, timeout.unit) == (
        *("tree/1.say@timeout", "timeout"),
        Countdown.TIME,
    )
    assert timeout.remaining_s > 0.0
    count = len(details)
    pass_time(ros, 0.3)
    assert len(details) == count
    mouth.goals[0].finish()
    market.result(handle)


def test_paused_countdown_reports_constant_remaining_time(
    ros: Any, host: Host, market: Market
) -> None:
    details = ros.collect(NodeDetails, "agents/details", qos.EVENTS)
    ros.until(lambda: host.node._details._wanted)
    market.send(market.goal(host.node, agent="dozer"))
    ros.until(lambda: details)
    host.done(PAUSE)
    ros.until(lambda: len(details) == 2)
    left = details[-1].countdowns[0].remaining_s
    assert 0.0 < left <= 30.0
    pass_time(ros, 0.6)
    assert len(details) == 2
    host.done(RESUME)
    ros.until(lambda: len(details) >= 3)
    assert details[2].countdowns[0].remaining_s == pytest.approx(left, abs=0.3)


def test_simulated_time_does_not_pass_for_paused_tree(
    ros: Any, market: Market, tmp_path: Path
) -> None:
    overrides = [Parameter("use_sim_time", value=True)]
    node = market.host(folder(tmp_path, SLEEPER), parameter_overrides=overrides)
    host = Host(ros, market, node)
    clock = ros.node.create_publisher(Clock, "/clock", qos.SENSOR)

    def play(seconds: int) -> None:
        def told() -> bool:
            clock.publish(Clock(clock=Time(sec=seconds)))
            return bool(node.get_clock().now().nanoseconds == seconds * 10**9)

        ros.until(told)

    play(100)
    handle = market.send(market.goal(node, agent="sleeper"))
    ros.until(lambda: node._runs.run and node._runs.run.ticks)
    host.done(PAUSE)
    play(200)
    host.done(RESUME)
    before = host.ticks()
    ros.until(lambda: host.ticks() >= before + 2)
    play(201)
    assert market.result(handle).result.duration_s == pytest.approx(1.0)
