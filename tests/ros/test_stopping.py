# SPDX-License-Identifier: Apache-2.0
"""Unplanned ends of runs: a host that is told to stop, a fault of the engine."""

from __future__ import annotations

from functools import partialmethod
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from bt_agents.engine.run import Run as TreeRun
from bt_agents.engine.run import RunLimits
from bt_agents.host.node import HostNode
from bt_agents.host.run_server import _STOP_SETTLE_S
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Run
from bt_agents_ros.spinner import STOP_LIMIT_S
from fake_market import Market, agent_text, folder, never_held_up
from scripted_server import Script, ScriptedServer

pytestmark = pytest.mark.ros

TALKER = agent_text("talker", "say: hello", "on_cancel: {say: good-bye}")
TELLER = TALKER.replace("talker", "teller").replace(
    "say: good-bye", "say: \"${cancel.by else 'nobody'}: ${cancel.reason else 'no reason'}\""
)


@pytest.fixture
def host(ros: Any, market: Market, tmp_path: Path) -> HostNode:
    return never_held_up(market.host(folder(tmp_path, TALKER, TELLER)))


def set_limits(monkeypatch: pytest.MonkeyPatch, limits: RunLimits) -> None:
    """Set the limits of all runs of hosts."""
    monkeypatch.setattr(TreeRun, "__init__", partialmethod(TreeRun.__init__, limits=limits))


@pytest.mark.parametrize("cancelled_before", [False, True])
def test_stopped_host_reports_run_despite_unfinished_goal(
    ros: Any,
    host: HostNode,
    market: Market,
    cancelled_before: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_limits(monkeypatch, RunLimits(settle_s=300.0))
    mouth = ScriptedServer(ros, script=Script(finish_s=None, on_cancel="ignores"))
    [set_to] = host.set_parameters([Parameter("tick_rate", value=1.0)])
    assert set_to.successful
    handle = market.send(market.goal(host, "talker"))
    ros.until(lambda: mouth.goals)
    if cancelled_before:
        handle.cancel_goal_async()
        ros.until(lambda: len(mouth.goals) == 2)
    host.request_stop()
    ros.until(host.stopped)
    assert _STOP_SETTLE_S < STOP_LIMIT_S
    ended = market.result(handle).result
    assert ended.outcome == RunAgent.Result.CANCELLED
    assert "tree" in ended.orphans
    assert len(mouth.goals) == 1 + cancelled_before


def test_run_failing_to_abort_ends_and_next_starts(
    ros: Any, host: HostNode, market: Market, monkeypatch: pytest.MonkeyPatch
) -> None:
    mouth = ScriptedServer(ros, script=Script(finish_s=None))
    handle = market.send(market.goal(host, "talker"))
    ros.until(lambda: mouth.goals)

    def broken(*_arguments: Any) -> None:
        raise RuntimeError("cogwheel")

    run = host._runs.run
    monkeypatch.setattr(run, "tick", broken)
    monkeypatch.setattr(run, "give_up", broken)
    ended = market.result(handle).result
    assert ended.outcome == RunAgent.Result.FAILED
    assert ended.message == "RuntimeError: cogwheel"
    assert not host._runs.busy
    again = market.send(market.goal(host, "talker"))
    ros.until(lambda: len(mouth.goals) == 2)
    mouth.goals[1].finish()
    assert market.result(again).result.outcome == RunAgent.Result.SUCCEEDED


@pytest.mark.parametrize("news_first", [True, False])
def test_clean_up_knows_announced_stop_reason(
    ros: Any, host: HostNode, market: Market, news_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A slow machine needs longer for the news than the clean-up waits for it.
    set_limits(monkeypatch, RunLimits(explain_s=300.0))
    mouth = ScriptedServer(ros, script=Script(finish_s=None))
    handle = market.send(market.goal(host, "teller"))
    ros.until(lambda: mouth.goals)
    news = {"event": Run.CANCELLING, "stopped_by": Run.MOOD_RULE, "stop_reason": "she frowns"}
    if news_first:
        market.announce(1, "teller", **news)
        ros.until(lambda: host._runs._cancellation is not None)
        handle.cancel_goal_async()
    else:
        handle.cancel_goal_async()
        ros.until(lambda: host._runs._stop is not None)
        market.announce(1, "teller", **news)
    ros.until(lambda: len(mouth.goals) == 2)
    assert mouth.goals[1].request.text == "mood rule: she frowns"
    mouth.goals[1].finish()
    assert market.result(handle).result.outcome == RunAgent.Result.CANCELLED


def test_clean_up_starts_without_announced_stop_reason(
    ros: Any, host: HostNode, market: Market
) -> None:
    mouth = ScriptedServer(ros, script=Script(finish_s=None))
    handle = market.send(market.goal(host, "teller"))
    ros.until(lambda: mouth.goals)
    market.announce(2, "teller", Run.CANCELLING, stop_reason="that is another run")
    handle.cancel_goal_async()
    ros.until(lambda: len(mouth.goals) == 2)
    assert mouth.goals[1].request.text == "nobody: no reason"
    mouth.goals[1].finish()
    assert market.result(handle).result.outcome == RunAgent.Result.CANCELLED
