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
from bt_agents.host.run_server import _STOP_SETTLE_S
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Run
from bt_agents_ros.spinner import STOP_LIMIT_S
from fake_market import Market, Stage, agent_text, folder, never_held_up
from scripted_server import Script, ScriptedServer

TALKER = agent_text("talker", "say: hello", "on_cancel: {say: good-bye}")
TELLER = TALKER.replace("talker", "teller").replace(
    "say: good-bye", "say: \"${cancel.by else 'nobody'}: ${cancel.reason else 'no reason'}\""
)


@pytest.fixture
def stage(ros: Any, market: Market, mouth: ScriptedServer, tmp_path: Path) -> Stage:
    host = never_held_up(market.host(folder(tmp_path, TALKER, TELLER)))
    return Stage(ros, host, market, mouth)


def set_limits(monkeypatch: pytest.MonkeyPatch, limits: RunLimits) -> None:
    """Set the limits of all runs of hosts."""
    monkeypatch.setattr(TreeRun, "__init__", partialmethod(TreeRun.__init__, limits=limits))


@pytest.mark.parametrize("cancelled_before", [False, True])
def test_stopped_host_reports_run_despite_unfinished_goal(
    stage: Stage, cancelled_before: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_limits(monkeypatch, RunLimits(settle_s=300.0))
    stage.mouth.script = Script(finish_s=None, on_cancel="ignores")
    [set_to] = stage.host.set_parameters([Parameter("tick_rate", value=1.0)])
    assert set_to.successful
    handle = stage.begin()
    if cancelled_before:
        handle.cancel_goal_async()
        stage.until(lambda: len(stage.mouth.goals) == 2)
    stage.host.request_stop()
    stage.until(stage.host.stopped)
    assert _STOP_SETTLE_S < STOP_LIMIT_S
    ended = stage.market.result(handle).result
    assert ended.outcome == RunAgent.Result.CANCELLED
    assert "tree" in ended.orphans
    assert len(stage.mouth.goals) == 1 + cancelled_before
    assert stage.market.refusal(stage.market.goal(stage.host)) == "SHUTTING_DOWN"


@pytest.mark.parametrize("broken", [["tick"], ["tick", "give_up"]])
def test_engine_fault_ends_run_and_next_starts(
    stage: Stage, broken: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    handle = stage.begin()

    def fail(*_arguments: Any) -> None:
        raise RuntimeError("cogwheel")

    for part in broken:
        monkeypatch.setattr(stage.host._runs.run, part, fail)
    ended = stage.market.result(handle).result
    assert (ended.outcome, ended.message) == (RunAgent.Result.FAILED, "RuntimeError: cogwheel")
    assert not stage.host._runs.busy
    again = stage.begin()
    stage.mouth.goals[1].finish()
    assert stage.market.result(again).result.outcome == RunAgent.Result.SUCCEEDED


@pytest.mark.parametrize("news_first", [True, False])
def test_clean_up_knows_announced_stop_reason(
    stage: Stage, news_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A slow machine needs longer for the news than the clean-up waits for it.
    set_limits(monkeypatch, RunLimits(explain_s=300.0))
    handle = stage.begin("teller")
    news = {"event": Run.CANCELLING, "stopped_by": Run.MOOD_RULE, "stop_reason": "she frowns"}
    if news_first:
        stage.market.announce(1, "teller", **news)
        stage.until(lambda: stage.host._runs._cancellation is not None)
        handle.cancel_goal_async()
    else:
        handle.cancel_goal_async()
        stage.until(lambda: stage.host._runs._stop is not None)
        stage.market.announce(1, "teller", **news)
    stage.until(lambda: len(stage.mouth.goals) == 2)
    assert stage.mouth.goals[1].request.text == "mood rule: she frowns"
    stage.mouth.goals[1].finish()
    assert stage.market.result(handle).result.outcome == RunAgent.Result.CANCELLED


def test_clean_up_starts_without_announced_stop_reason(stage: Stage) -> None:
    handle = stage.begin("teller")
    stage.market.announce(2, "teller", Run.CANCELLING, stop_reason="that is another run")
    handle.cancel_goal_async()
    stage.until(lambda: len(stage.mouth.goals) == 2)
    assert stage.mouth.goals[1].request.text == "nobody: no reason"
    stage.mouth.goals[1].finish()
    assert stage.market.result(handle).result.outcome == RunAgent.Result.CANCELLED
