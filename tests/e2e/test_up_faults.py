# SPDX-License-Identifier: Apache-2.0
"""A run under way when a component of a kept system is killed, and the next run after it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from programs import Program, children

pytestmark = pytest.mark.e2e

Start = Callable[..., Program]
Ask = Callable[..., str]
MRS_SMITH = ("trigger", "age=4.5", "familiarity=1", "mood=3")


def kill_component(up: Program, module: str, number: int = signal.SIGKILL) -> None:
    """Kill the process of ``up`` that runs a module, or send it another signal."""
    [pid] = [
        pid
        for pid in children(up.process.pid)
        if module in Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    ]
    os.kill(pid, number)


def up_with_a_run(start: Start, ask: Ask) -> Program:
    up = start("up", "--no-voice")
    up.until("ready")
    assert "attentive_guide" in ask(*MRS_SMITH)
    up.until("says: Hello")
    return up


def cancel_the_next_run(up: Program, ask: Ask) -> None:
    """Wait until a run is under way again, stop it, and end the system."""
    up.until("attentive_guide starts")
    up.until("says: Hello")
    assert ask("cancel") != ""
    up.until("attentive_guide cancelled")
    assert up.stop()[0] == 0, up.output
    assert "Traceback" not in up.output


def test_a_run_whose_host_is_killed_is_lost_and_the_next_trigger_runs(
    start: Start, ask: Ask
) -> None:
    up = up_with_a_run(start, ask)
    kill_component(up, "bt_agents.host.node")
    up.until("attentive_guide lost")
    up.until("agents is back")
    assert "attentive_guide" in ask(*MRS_SMITH)
    cancel_the_next_run(up, ask)


def test_a_run_whose_market_is_killed_is_cut_off_and_asked_for_again_by_the_next_one(
    start: Start, ask: Ask
) -> None:
    up = up_with_a_run(start, ask)
    kill_component(up, "marketplace_node.node")
    up.until("marketplace is back")
    cancel_the_next_run(up, ask)


def test_a_market_and_a_host_that_hang_are_killed_and_the_next_trigger_runs(
    start: Start, ask: Ask
) -> None:
    up = start("up", "--no-voice")
    up.until("ready")
    assert "attentive_guide" in ask("status")  # by then both have been heard
    kill_component(up, "marketplace_node.node", signal.SIGSTOP)
    kill_component(up, "bt_agents.host.node", signal.SIGSTOP)
    up.until(r"hangs \(no heartbeat for \d+ s\): killing it")
    up.until("is back after")
    up.until("is back after")
    for name in ("marketplace", "agents"):
        assert f"{name} hangs (no heartbeat for" in up.output
        assert f"{name} is back after" in up.output
    assert "attentive_guide" in ask(*MRS_SMITH)
    up.until("attentive_guide starts")
    assert up.stop()[0] == 0, up.output
    assert "Traceback" not in up.output
