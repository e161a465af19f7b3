# SPDX-License-Identifier: Apache-2.0
"""Runs that people pause, step and resume: with real goals, deadlines and cancels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

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
from fake_market import Bag, Market, Stage, agent_text, folder, never_held_up
from scripted_server import Script, ScriptedServer

PAUSE, RESUME = ControlRun.Request.PAUSE, ControlRun.Request.RESUME
STEP, BREAKPOINTS = ControlRun.Request.STEP, ControlRun.Request.BREAKPOINTS


TALKER = agent_text("talker", "sequence: [{say: one}, {say: two}]", "on_cancel: {say: good-bye}")
SLEEPER = agent_text("sleeper", "wait: 0.5 s")
DOZER = agent_text("dozer", "wait: 30 s")
FILLED = agent_text(
    "filled", "sequence: [{set: {name: Anna}}, {say: 'Hello ${name}', timeout: 9 s}]"
)


class Control(Stage):
    """The run control of a host that no stall holds up, and its messages."""

    def __init__(self, ros: Any, host: HostNode, market: Market, mouth: ScriptedServer) -> None:
        super().__init__(ros, never_held_up(host), market, mouth)
        self._client = ros.node.create_client(
            ControlRun, "agents/control", qos_profile=qos.SERVICE
        )
        self.controls = ros.collect(RunControl, "agents/run_control", qos.FACT)
        ros.until(lambda: self._client.service_is_ready() and self.controls)

    def ask(self, action: int, **fields: Any) -> Any:
        return self.ros.call(self._client, ControlRun.Request(action=action, **fields))

    def done(self, action: int, **fields: Any) -> str:
        answer = self.ask(action, **fields)
        assert answer.accepted, answer.message
        return str(answer.message)

    def stop_before(self, name: str, *paths: str) -> None:
        self.done(BREAKPOINTS, agent=name, paths=list(paths))

    @property
    def told(self) -> Any:
        """Its last message."""
        return self.controls[-1]

    def paused_at(self, path: str) -> None:
        self.until(lambda: self.told.paused and self.told.paused_at == path)

    def ticks(self) -> int:
        return int(self.host._runs.run.ticks)


@pytest.fixture
def control(ros: Any, market: Market, mouth: ScriptedServer, tmp_path: Path) -> Control:
    host = market.host(folder(tmp_path, TALKER, SLEEPER, DOZER, FILLED))
    return Control(ros, host, market, mouth)


def test_paused_tree_is_ticked_only_by_steps(control: Control) -> None:
    handle = control.begin()
    assert control.done(PAUSE, author="anna") == "talker is paused at tree/0.say"
    control.until(lambda: control.told.paused)
    assert (control.told.author, control.told.agent, control.told.round) == ("anna", "talker", 1)
    before = control.ticks()
    control.mouth.goals[0].finish()
    control.pass_time(0.3)
    assert (control.ticks(), len(control.mouth.goals)) == (before, 1)
    assert control.done(STEP) == "talker was ticked once, and is at tree/1.say"
    control.until(lambda: len(control.mouth.goals) == 2)
    assert control.ticks() == before + 1
    assert control.done(RESUME) == "talker goes on"
    control.mouth.goals[1].finish()
    answer = control.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    control.until(lambda: not control.told.agent)
    assert not control.told.paused


def test_breakpoint_pauses_run_and_step_starts_its_node(control: Control) -> None:
    statuses = control.ros.collect(TreeStatus, "agents/status", qos.EVENTS)
    control.until(control.host._runs._status.get_subscription_count)
    control.stop_before("talker", "tree/0.say", "tree/1.say")
    control.run("talker")
    control.paused_at("tree/0.say")
    control.until(lambda: statuses)
    assert statuses[-1].tip == "tree/0.say"
    last = statuses[-1].changes[0]
    assert (last.path, last.status) == ("tree/0.say", StatusChange.RUNNING)
    control.pass_time(0.2)
    assert control.mouth.goals == []
    assert control.done(STEP) == "talker was ticked once, and is at tree/0.say"
    control.until(lambda: control.mouth.goals)
    control.paused_at("")
    control.mouth.goals[0].finish()
    control.done(RESUME)
    control.paused_at("tree/1.say")
    assert len(control.mouth.goals) == 1
    control.stop_before("talker")
    control.done(RESUME)
    control.until(lambda: len(control.mouth.goals) == 2)


def test_paused_run_still_hears_cancel_and_cleans_up(control: Control) -> None:
    control.host._runs.set_rate(1.0)  # a tick may take a second; the pause is longer
    beats = control.ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    control.market.live()
    handle = control.begin()
    control.done(PAUSE)
    before = len(beats)
    # Longer than the leases of the market and of the host.
    control.until(lambda: len(beats) - before > 12)
    assert beats[-1].tip_name == 'say "one"'
    handle.cancel_goal_async()
    control.until(lambda: len(control.mouth.goals) == 2)
    assert control.mouth.goals[1].request.text == "good-bye"
    control.until(lambda: not control.told.paused)
    control.mouth.goals[1].finish()
    result = control.market.result(handle).result
    assert result.outcome == RunAgent.Result.CANCELLED
    assert result.overruns == 0


def test_step_advances_paused_tree_clock_by_one_period(control: Control) -> None:
    control.stop_before("sleeper", "tree")
    handle = control.run("sleeper")
    control.paused_at("tree")
    before_s = control.host._runs.environment.clock() - control.host._runs.run._start
    control.pass_time(0.8)
    steps = 0
    while control.host._runs.run is not None and control.host._runs.run.result is None:
        control.done(STEP)
        steps += 1
    # The first begins the wait of ten periods, which rounding may shorten.
    assert steps in (11, 12)
    answer = control.market.result(handle)
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    assert answer.result.duration_s == pytest.approx(before_s + steps * 0.05)


def test_a_silent_market_ends_a_paused_run(control: Control) -> None:
    control.host.set_parameters([Parameter("market_lease", value=0.5)])
    control.market.live()
    handle = control.begin()
    control.done(PAUSE)
    control.mouth.script = Script()
    control.market.fall_silent()
    assert control.market.result(handle).result.stop_cause == RunAgent.Result.MARKET_LOST


def test_invalid_request_is_refused_by_name(control: Control) -> None:
    for action, fields, code in (
        (PAUSE, {}, "NOT_RUNNING"),
        (9, {}, "NOT_RUNNING"),
        (BREAKPOINTS, {"agent": "nobody"}, "UNKNOWN_AGENT"),
        (BREAKPOINTS, {"agent": "talker", "paths": ["tree/0.sya"]}, "UNKNOWN_NODE"),
        (BREAKPOINTS, {"agent": "talker", "paths": ["on_cancel"]}, "UNKNOWN_NODE"),
    ):
        answer = control.ask(action, **fields)
        assert (answer.accepted, answer.code) == (False, code)
        assert answer.message


def test_repeated_request_or_wrong_round_is_refused(control: Control) -> None:
    control.begin()
    assert control.ask(PAUSE, round=7).code == "OTHER_ROUND"
    assert control.ask(PAUSE, epoch="e0").code == "OTHER_ROUND"
    assert control.ask(9).code == "UNKNOWN_ACTION"
    assert control.ask(STEP).code == control.ask(RESUME).code == "NOT_PAUSED"
    assert control.ask(PAUSE, epoch="e1", round=1, author="\x1b[2Janna\n").accepted
    again = control.ask(PAUSE)
    assert (again.code, again.message) == ("ALREADY_PAUSED", "it is paused by [2Janna already")


def values(details: Sequence[Any]) -> list[tuple[str, str, str, bool]]:
    return [(v.path, v.name, v.value, v.written) for one in details for v in one.values]


def test_node_details_are_traced_only_while_subscribed(control: Control) -> None:
    handle = control.run("sleeper")
    control.until(lambda: control.host._runs.run)
    assert control.host._details._tree is None
    control.market.result(handle)
    details = control.ros.collect(NodeDetails, "agents/details", qos.EVENTS)
    control.until(lambda: control.host._details._wanted)
    handle = control.run("filled", round=2)
    control.until(lambda: control.mouth.goals and details)
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
    control.pass_time(0.3)
    assert len(details) == count
    control.mouth.goals[0].finish()
    control.market.result(handle)


def test_paused_countdown_reports_constant_remaining_time(control: Control) -> None:
    details = control.ros.collect(NodeDetails, "agents/details", qos.EVENTS)
    control.until(lambda: control.host._details._wanted)
    control.run("dozer")
    control.until(lambda: details)
    control.done(PAUSE)
    control.until(lambda: len(details) == 2)
    left = details[-1].countdowns[0].remaining_s
    assert 0.0 < left <= 30.0
    control.pass_time(0.6)
    assert len(details) == 2
    control.done(RESUME)
    control.until(lambda: len(details) >= 3)
    assert details[2].countdowns[0].remaining_s == pytest.approx(left, abs=0.3)


def test_simulated_time_does_not_pass_for_paused_tree(
    ros: Any, market: Market, mouth: ScriptedServer, tmp_path: Path
) -> None:
    overrides = [Parameter("use_sim_time", value=True)]
    host = market.host(folder(tmp_path, SLEEPER), parameter_overrides=overrides)
    control, bag = Control(ros, host, market, mouth), Bag(ros)
    bag.play(host, 100)
    handle = control.run("sleeper")
    ros.until(lambda: host._runs.run and host._runs.run.ticks)
    control.done(PAUSE)
    bag.play(host, 200)
    control.done(RESUME)
    before = control.ticks()
    ros.until(lambda: control.ticks() >= before + 2)
    bag.play(host, 201)
    assert market.result(handle).result.duration_s == pytest.approx(1.0)
