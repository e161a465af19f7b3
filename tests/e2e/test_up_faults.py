# SPDX-License-Identifier: Apache-2.0
"""A run during which a component of the system is killed, and the next run."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from bt_agents_core.liveness import LONGEST_PAUSE_S
from programs import HANG_S, ROOT, Ask, Program, Start, children, node_of, nodes, wait_for

pytestmark = pytest.mark.e2e

MRS_SMITH = ("trigger", "age=4.5", "familiarity=1", "mood=3")
HOST = "bt_agents.host.node"


def kill_component(up: Program, module: str, number: int = signal.SIGKILL) -> None:
    """Kill the process of ``up`` that runs a module, or send it another signal."""
    os.kill(node_of(up.process.pid, module), number)


def up_with_a_run(start_up: Start, ask: Ask) -> Program:
    up = start_up()
    assert "attentive_guide" in ask(*MRS_SMITH)
    up.until("says: Hello")
    return up


def until_all(up: Program, *said: str) -> None:
    """Read lines until all of these have come, in any order: several processes print them."""
    missing = set(said)
    while missing:
        line = up.until("|".join(missing))
        missing = {one for one in missing if one not in line}


def cancel_the_run(up: Program, ask: Ask) -> None:
    """Stop the current run."""
    assert ask("cancel") != ""
    up.until("attentive_guide cancelled")


def test_killed_host_ends_no_service(start_up: Start, ask: Ask) -> None:
    up = up_with_a_run(start_up, ask)
    kill_component(up, HOST)
    until_all(up, "attentive_guide lost", "agents is back")
    assert "attentive_guide" in ask(*MRS_SMITH)
    until_all(up, "attentive_guide starts", "says: Hello")
    cancel_the_run(up, ask)


def test_hanging_nodes_are_killed_and_replaced(start_up: Start, ask: Ask) -> None:
    up = start_up()
    assert "attentive_guide" in ask("status")  # by then all have been received
    for module in ("marketplace_node.node", HOST, "scene_layer.node", "feedback_node.node"):
        kill_component(up, module, signal.SIGSTOP)
    names = ("marketplace", "agents", "scene_layer", "feedback")
    until_all(up, *(f"{name} is back after" for name in names))
    for name in names:
        assert f"{name} hangs (not heard for" in up.output
    assert "attentive_guide" in ask(*MRS_SMITH)
    up.until("attentive_guide starts")


def test_next_scene_runs_after_long_pause(start_up: Start, ask: Ask) -> None:
    up = up_with_a_run(start_up, ask)
    paused = [up.process.pid, *children(up.process.pid)]
    try:
        for pid in paused:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(LONGEST_PAUSE_S + 2.0)
    finally:
        for pid in paused:
            os.kill(pid, signal.SIGCONT)
    until_all(up, *(f"{name} is back" for name in ("marketplace", "agents", "robot", "feedback")))
    assert "attentive_guide" in ask(*MRS_SMITH)
    until_all(up, "attentive_guide starts", "says: Hello")
    assert "hangs" not in up.output
    cancel_the_run(up, ask)


def test_unread_terminal_delays_neither_supervision_nor_shutdown(
    environment: dict[str, str], ask: Ask
) -> None:
    reading, writing = os.pipe()
    os.write(writing, b"x" * fcntl.fcntl(writing, fcntl.F_GETPIPE_SZ))
    up = subprocess.Popen(
        [sys.executable, "-m", "bt_agents_tools.cli", "up", "--no-voice", "--no-studio"],
        stdout=writing,
        cwd=ROOT,
        env=environment,
    )
    os.close(writing)
    try:
        wait_for(lambda: "attentive_guide" in ask("status", code=None))
        host = node_of(up.pid, HOST)
        os.kill(host, signal.SIGKILL)
        wait_for(lambda: [pid for name, pid in nodes(up.pid) if name == HOST] not in ([], [host]))
        up.terminate()
        assert up.wait(HANG_S) == 0
    finally:
        for pid in [*children(up.pid), up.pid]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        up.wait()
        os.close(reading)
