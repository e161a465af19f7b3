# SPDX-License-Identifier: Apache-2.0
"""All nodes in one process: simulated time, remapped names, plug-ins, and the launch file."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock

from bt_agents_interfaces.msg import CallForBids, Run
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.supervisor import Component
from graph import fresh_graph
from processes import NodeProcess, System, write_trees
from programs import ROOT

pytestmark = pytest.mark.e2e

LAUNCH = ROOT / "bt_agents_bringup" / "launch" / "system.launch.yaml"


@dataclass(frozen=True, kw_only=True)
class Launched(Component):
    """Component with additional ROS arguments."""

    ros_arguments: tuple[str, ...] = ()

    def command(self) -> list[str]:
        return [*super().command(), *self.ros_arguments]


@pytest.fixture
def system(tmp_path: Path) -> Iterator[System]:
    with fresh_graph() as ros, closing(System(ros, tmp_path)) as processes:
        yield processes


def start_together(system: System, trees: Path, *ros_arguments: str) -> NodeProcess:
    """Start market, host and feedback node in one process."""
    parts = [components.market(trees), components.host(trees)]
    parts += [components.feedback(trees, ":memory:")]
    shared = components.one_process(parts)
    return system.start(Launched(**vars(shared), ros_arguments=ros_arguments))


def test_single_process_tree_waits_on_simulated_time(system: System, tmp_path: Path) -> None:
    tree = "sequence: [{say: first}, {wait: 5 s}, {say: second}]"
    start_together(system, write_trees(tmp_path / "a", leo=(5, tree)), "-p", "use_sim_time:=true")
    system.say_server.let_go()
    clock = system.ros.node.create_publisher(Clock, "/clock", qos.SENSOR)
    system.until_ready(hosts=1, agents=1)
    # Each node of the process has a clock of its own.
    system.until(lambda: clock.get_subscription_count() >= 3, "all hear the clock")

    def play(seconds: int) -> None:
        clock.publish(Clock(clock=Time(sec=seconds)))

    scenes: list[str] = []

    def bids() -> bool:
        play(100)
        # No host bids for a scene before the clock starts.
        if not scenes or system.ends_of(scenes[-1]):
            scenes.append(f"s{len(scenes)}")
            system.scene(scenes[-1], age=5, familiarity=3, mood=3)
        return bool(system.started("leo"))

    system.until(bids, "a run under simulated time")
    beats = system.heartbeat_probe("agents")
    system.until(lambda: system.say_server.texts == ["first"], "the first sentence")
    before = beats.count
    system.until(lambda: beats.count >= before + 10, "a while in which time stands still")
    assert system.say_server.texts == ["first"]
    play(104)
    before = beats.count
    system.until(lambda: beats.count >= before + 10, "a while before the wait is over")
    assert system.say_server.texts == ["first"]
    play(105)
    system.until(lambda: system.say_server.texts == ["first", "second"], "the second sentence")
    system.until(lambda: system.ended("leo"), "the end of the run")
    assert system.ended("leo")[0].outcome == Run.SUCCEEDED


def test_single_process_remaps_names_inside_and_outside(system: System, tmp_path: Path) -> None:
    trees = write_trees(tmp_path / "a", leo=(5, "say: hello"))
    names = ("bt_agents/calls", "bt_agents/bids", "bt_agents/runs", "feedback/manage")
    remapped = [word for name in names for word in ("-r", f"{name}:=their/{name}")]
    remapped += ["-r", "agents:__node:=helpers"]
    remapped += ["-r", "marketplace:bt_agents/auctions:=their/bt_agents/auctions"]
    remapped += ["-p", f"helpers:trees:={trees}"]
    start_together(system, trees, *remapped)
    system.say_server.let_go()
    calls = system.ros.collect(CallForBids, "their/bt_agents/calls", qos.EVENTS)
    runs: list[Run] = system.ros.collect(Run, "their/bt_agents/runs", qos.HISTORY)
    beats = system.heartbeat_probe("helpers")
    system.until(
        lambda: system.statuses and system.statuses[-1].agents == 1, "the agent has registered"
    )
    assert system.statuses[-1].hosts == 1

    def is_run() -> bool:
        return any((one.event, one.outcome) == (Run.ENDED, Run.SUCCEEDED) for one in runs)

    heard = system._scenes.get_subscription_count
    system.until(heard, "the market hears scenes")
    system.scene("s1", age=5, familiarity=3, mood=3)
    system.until(is_run, "a run on the remapped topic")
    system.until(lambda: calls and beats.count, "calls for bids, and heartbeats of the host")
    assert (system.runs, system.bids, system.auctions) == ([], [], [])
    there = {name for name, _ in system.ros.node.get_service_names_and_types()}
    assert "/their/feedback/manage" in there
    assert "/feedback/manage" not in there


def launch_nodes() -> tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, str]]:
    """Return the launch file's nodes with and without ``one_process``, and its arguments."""
    entries = yaml.safe_load(LAUNCH.read_text())["launch"]
    nodes = [entry["node"] for entry in entries if "node" in entry]
    arguments = {e["arg"]["name"]: str(e["arg"]["default"]) for e in entries if "arg" in e}
    together = [one for one in nodes if one.get("if") == "$(var one_process)"]
    apart = [one for one in nodes if one.get("unless") == "$(var one_process)"]
    return together, apart, arguments


def test_launch_file_passes_same_settings_to_single_process() -> None:
    [shared], apart, _ = launch_nodes()
    names = {one["name"] for node in apart for one in node["param"] if "name" in one}
    assert {one["name"] for one in shared["param"] if "name" in one} == names
    modules = {name: importlib.import_module(name) for name in shared["args"].split()}
    assert all(callable(module.make_node) for module in modules.values())
    assert {name.partition(".")[0] for name in modules} == {node["pkg"] for node in apart}
    same = ("namespace", "respawn", "respawn_delay", "ros_args")
    assert all(node[key] == shared[key] for node in apart for key in same)


def test_single_process_runs_as_launch_file_starts_it(system: System, tmp_path: Path) -> None:
    trees = write_trees(tmp_path / "a", leo=(5, "say: hello"))
    [shared], _, arguments = launch_nodes()
    arguments |= {"trees": str(trees), "one_process": "true", "ledger": ":memory:"}
    arguments["params"] = str(ROOT / "bt_agents_bringup" / "params" / "system.yaml")

    def filled(text: str) -> str:
        return re.sub(r"\$\(var (\w+)\)", lambda found: arguments[found[1]], str(text))

    words = filled(shared["ros_args"]).split()
    for one in shared["param"]:
        if "from" in one:
            words += ["--params-file", filled(one["from"])]
        else:
            typed = {"str": str, "float": float, "bool": yaml.safe_load}[one["type"]]
            words += ["-p", f"{one['name']}:={typed(filled(one['value']))!r}"]
    bare = Component(name="system", module="bt_agents_ros.one_process")
    modules = tuple(shared["args"].split())
    started = replace(bare, arguments=modules, parts=dict(zip(modules, modules, strict=True)))
    process = system.start(Launched(**vars(started), ros_arguments=tuple(words)))
    system.say_server.let_go()
    system.until_ready(hosts=1, agents=1)
    system.scene("s1", age=5, familiarity=3, mood=3)
    system.until(lambda: system.ended("leo"), "a run")
    assert system.ended("leo")[0].outcome == Run.SUCCEEDED
    process.terminate()
    system.until(lambda: process.ended, "its end")
    assert process.exit_code == 0
    assert "UNKNOWN_PARAMETER" not in process.said
