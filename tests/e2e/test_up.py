# SPDX-License-Identifier: Apache-2.0
"""A system that keeps running, used from other processes."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from pathlib import Path

import pytest

from processes import write_trees
from programs import HANG_S, Ask, Program, Start, alive, children, node_of, nodes, wait_for

pytestmark = pytest.mark.e2e

RESTART = r"starting it again (in 0\.5 s|at once)"
"""How a killed process starts again: at once if a slow machine has let it live for ten seconds."""


@pytest.mark.parametrize("layout", [(), ("--one-process",)], ids=["processes", "one process"])
def test_system_runs_explains_learns_cancels_and_remembers(
    start: Start, start_up: Start, ask: Ask, layout: tuple[str, ...]
) -> None:
    up = start("up", "--no-voice", *layout)
    up.until("ready")
    check_that_errors_take_one_line(ask)
    assert "sources: no reading so far: person/age" in ask("scene")
    decision = ask("trigger", "age=4.5", "familiarity=1", "mood=3", "--label", "Mrs Smith")
    assert "attentive_guide" in decision
    up.until("attentive_guide starts")
    assert "running since " in ask("status")
    assert re.search(
        r"Mrs Smith, somebody is there.*\n(.*\n)*age +4.5 \(an older adult\) +given", ask("scene")
    )
    up.until("says: Hello")
    assert ask("cancel") != ""
    up.until("attentive_guide cancelled")
    why = ask("why")
    assert "Mrs Smith" in why
    assert "attentive_guide was stopped (operator): " in why
    assert ask("why", "1") == why
    assert "no decision of round 7" in ask("why", "7", code=1)
    assert re.search(r"attentive_guide +1\.0 = ", why)
    assert re.search(r"Hello.* s  +3 .*tree/", ask("moods", "attentive_guide"))
    moved = ask("feedback", "positive", "--reason", "kind")
    assert re.search(r"attentive_guide: age 4 → 4\.1.*\(revision 1\)", moved)
    assert "age 4.1" in ask("status")
    assert re.search(r"^attentive_guide,/agents,4\.1,", ask("status", "--csv"), re.M)
    assert json.loads(ask("status", "--json"))["market"]["round"] == 1
    assert re.search(r"^1,attentive_guide,/agents,1\.0,", ask("why", "--csv"), re.M)
    assert re.search(r",attentive_guide\.patience,8\.0,8\.0,", ask("tune", "--csv"))
    assert up.stop()[0] == 0, up.output
    assert "Traceback" not in up.output

    start_up(*layout)
    assert re.search(r"attentive_guide +age 4\.1,.*revision 1", ask("status"))


def check_that_errors_take_one_line(ask: Ask) -> None:
    assert "name=number" in ask("trigger", "age=nan", code=2)
    assert "OUT_OF_RANGE" in ask("trigger", "age=9", code=1)
    assert "UNKNOWN_PARAMETER" in ask("trigger", "size=3", code=1)
    assert "name=number" in ask("trigger", "age:3", code=2)
    assert "no decision yet" in ask("why", code=1)
    assert "error" in ask("cancel", code=1)
    assert "error" in ask("feedback", "positive", code=1)
    assert "idle" in ask("status")


def test_broken_agent_file_is_reported_while_others_run(
    start_up: Start, ask: Ask, trees: Path
) -> None:
    broken, untyped = (
        trees / "agents" / f"{name}.yaml" for name in ("playful_companion", "silent_text")
    )
    text = broken.read_text()
    broken.write_text(text.replace("sequence:", "sequenze:").replace("profile:", "profle:"))
    untyped.write_text(untyped.read_text().replace("std_msgs/msg/Bool", "nav9_msgs/msg/Bool"))
    up = start_up(str(trees))
    assert re.search(r"playful_companion\.yaml:\d+:\d+: error\[", up.output)
    assert up.output.count("error[") >= 2
    assert "winner" not in ask("trigger", "age=1", "familiarity=1", "mood=4")
    status = ask("status")
    assert "attentive_guide" in status
    assert "problem: " in status
    assert up.stop()[0] == 0
    logs = "".join(
        path.read_text() for path in Path(trees).parent.glob("state/bt-agents/logs/*/agents.log")
    )
    assert re.search(r"silent_text\.yaml:\d+:\d+: error\[.*nav9_msgs/msg/Bool", logs)


AT_ONCE_S = 6.0
"""Shorter than the time limit before a kill, on a machine busy with other tests [s]."""

COMPONENTS = {
    "marketplace": "marketplace_node.node",
    "scene_layer": "scene_layer.node",
    "agents": "bt_agents.host.node",
    "feedback": "feedback_node.node",
    "robot": "bt_agents_robot.robot",
    "studio": "bt_agents_studio.process",
}


def process_of(up: Program, component: str) -> int:
    """Return the pid of a running component."""
    return node_of(up.process.pid, COMPONENTS[component])


def only_the_greeter(folder: Path) -> Path:
    return write_trees(folder / "trees", greeter=(3, "say: Hello."))


def until_the_greeter_succeeds(up: Program, ask: Ask) -> None:
    end = time.monotonic() + HANG_S
    while "greeter succeeded" not in up.seen(1.0):
        assert time.monotonic() < end, up.output
        ask("trigger", "age=3", code=None)


def test_agent_completes_run_after_killed_components_restart(
    start: Start, ask: Ask, tmp_path: Path
) -> None:
    up = start("up", str(only_the_greeter(tmp_path)), "--no-voice")
    up.until("ready after")
    for component in COMPONENTS:
        pid = process_of(up, component)
        os.kill(pid, signal.SIGKILL)
        ended = up.until(rf"^{component} ended \(killed by signal 9\): {RESTART}")
        assert Path(ended.partition("(log: ")[2].rstrip(")\n")).is_file()
        up.until(rf"^{component} is back after \d+\.\d s")
        assert process_of(up, component) != pid
    until_the_greeter_succeeds(up, ask)
    assert len(nodes(up.process.pid)) == len(COMPONENTS)
    pids = children(up.process.pid)
    code, seconds = up.stop()
    assert code == 0
    assert seconds < AT_ONCE_S
    assert "Traceback" not in up.output
    assert not [pid for pid in pids if alive(pid)]


def test_single_process_restarts_like_a_component(
    start_up: Start, ask: Ask, tmp_path: Path
) -> None:
    up = start_up(str(only_the_greeter(tmp_path)), "--one-process")
    os.kill(node_of(up.process.pid, "bt_agents_ros.one_process"), signal.SIGKILL)
    up.until(rf"^system ended \(killed by signal 9\): {RESTART}")
    up.until(r"^system is back after \d+\.\d s")
    until_the_greeter_succeeds(up, ask)
    assert len(nodes(up.process.pid)) == 1
    code, seconds = up.stop()
    assert code == 0
    assert seconds < AT_ONCE_S


def test_ctrl_c_during_restart_delay_ends_everything(start_up: Start) -> None:
    up = start_up()
    for _ in range(3):  # until the wait is a whole second
        os.kill(process_of(up, "robot"), signal.SIGKILL)
        up.until("robot ended")
        if "in 1 s" in up.output:
            break
        up.until("robot is back")
    backs = up.output.count("robot is back")
    code, seconds = up.stop()
    assert code == 0
    assert seconds < AT_ONCE_S
    assert "stopped" in up.output
    assert up.output.count("robot is back") == backs
    assert "Traceback" not in up.output


def test_up_exits_with_error_of_unstartable_component(start: Start, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ledger = str(tmp_path / "file" / "ledger.sqlite")
    up = start("up", "--no-voice", "--no-studio", "--ledger", ledger)
    assert up.wait() == 1
    assert "feedback ended with exit code 1; the end of its log:" in up.output
    assert "ledger.sqlite" in up.output


def test_second_concurrent_system_exits_and_names_first(start: Start, start_up: Start) -> None:
    both = [start("up", "--no-voice", "--no-studio") for _ in range(2)]
    wait_for(lambda: any(up.process.poll() is not None for up in both))
    [loser] = [up for up in both if up.process.poll() is not None]
    [winner] = [up for up in both if up is not loser]
    assert loser.wait() == 1
    assert re.search(
        rf"already runs on ROS domain \d+: 'bt-agents up' of /.* \(process {winner.process.pid}\)",
        loser.output,
    )
    winner.until("ready after")
    assert start("demo", "--no-voice").wait() == 1
    assert winner.stop()[0] == 0
    start_up()


def test_system_of_another_user_is_noticed(
    start: Start, start_up: Start, environment: dict[str, str], tmp_path: Path
) -> None:
    start_up()
    locks = tmp_path / "locks"
    locks.mkdir(mode=0o700)
    environment["XDG_RUNTIME_DIR"] = str(locks)
    second = start("demo", "--no-voice")
    assert second.wait() == 1
    # On a busy machine, only the markets notice each other.
    noticed = r"a system already runs on ROS domain \d+; end it|another marketplace is alive"
    assert re.search(noticed, second.output)
