# SPDX-License-Identifier: Apache-2.0
"""Ends of runs that are nobody's plan: a host told to stop, a fault of the engine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from bt_agents.host.node import HostNode
from bt_agents_interfaces.action import RunAgent
from bt_agents_ros.spinner import STOP_LIMIT_S
from fake_market import Market, folder, make_host
from scripted_server import Script, ScriptedServer

pytestmark = pytest.mark.ros

TALKER = (
    "format: 1\nagent: talker\ntitle: t\ndescription: t\n"
    "profile: {age: 3, familiarity: 3, mood: 3}\ntree: {say: hello}\non_cancel: {say: good-bye}\n"
)


@pytest.fixture
def market(ros: Any) -> Market:
    return Market(ros)


@pytest.fixture
def host(ros: Any, market: Market, tmp_path: Path) -> HostNode:
    node: HostNode = ros.add(make_host(folder(tmp_path, TALKER)))
    market.open()
    ros.until(lambda: node.registered)
    return node


def result(ros: Any, handle: Any) -> Any:
    future = handle.get_result_async()
    ros.until(future.done)
    return future.result().result


@pytest.mark.parametrize("cancelled_before", [False, True])
def test_a_host_that_is_stopped_says_in_time_how_its_run_ended_though_a_goal_goes_on(
    ros: Any, host: HostNode, market: Market, cancelled_before: bool
) -> None:
    mouth = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="ignores"))
    [set_to] = host.set_parameters([Parameter("tick_rate", value=1.0)])
    assert set_to.successful
    handle = market.send(market.goal(host, "talker"))
    ros.until(lambda: mouth.goals)
    if cancelled_before:
        handle.cancel_goal_async()
        ros.until(lambda: len(mouth.goals) == 2)
    began = time.monotonic()
    host.request_stop()
    ros.until(host.stopped)
    assert time.monotonic() - began < STOP_LIMIT_S
    ended = result(ros, handle)
    assert ended.outcome == RunAgent.Result.CANCELLED
    assert "tree" in ended.orphans
    assert len(mouth.goals) == 1 + cancelled_before


def test_a_run_that_cannot_even_be_given_up_ends_and_the_next_one_runs(
    ros: Any, host: HostNode, market: Market, monkeypatch: pytest.MonkeyPatch
) -> None:
    mouth = ScriptedServer(ros, script=Script(finish_s=None))
    handle = market.send(market.goal(host, "talker"))
    ros.until(lambda: mouth.goals)

    def broken(*_arguments: Any) -> None:
        raise RuntimeError("cogwheel")

    run = host._runs._run
    monkeypatch.setattr(run, "tick", broken)
    monkeypatch.setattr(run, "give_up", broken)
    ended = result(ros, handle)
    assert ended.outcome == RunAgent.Result.FAILED
    assert ended.message == "RuntimeError: cogwheel"
    assert not host._runs.busy
    again = market.send(market.goal(host, "talker"))
    ros.until(lambda: len(mouth.goals) == 2)
    mouth.goals[1].finish()
    assert result(ros, again).outcome == RunAgent.Result.SUCCEEDED
