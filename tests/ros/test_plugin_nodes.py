# SPDX-License-Identifier: Apache-2.0
"""Behaviours of py_trees_ros as leaves of a host: the page's example, and its promises."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import py_trees
import pytest
from rcl_interfaces.msg import Log
from std_msgs.msg import Bool, String

from bt_agents.engine.nodes import plugin
from bt_agents_interfaces.action import RunAgent
from bt_agents_language.nodes.plugin_discovery import installed_plugins
from bt_agents_ros import qos
from checkout import ROOT
from fake_market import Market, folder
from scripted_server import Script, ScriptedServer

HEAD = "format: 1\nagent: {0}\ntitle: {0}\ndescription: {0}\n"
PROFILE = "profile: {age: 3, familiarity: 3, mood: 3}\n"
EXAMPLE = ROOT / "examples" / "py_trees_ros_nodes"
PAGE = (ROOT / "docs" / "py_trees_ros.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    [found] = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(found)


@pytest.fixture(autouse=True)
def package(py_trees_ros: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package of the page, as installed by pip."""
    place = tmp_path / "installed"
    info = place / "their_nodes-1.0.dist-info"
    info.mkdir(parents=True)
    (place / "their_nodes.py").write_text(block("py"))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-nodes\nVersion: 1.0\n")
    points = block("toml").partition('"bt_agents.nodes"]\n')[2].replace('"', "")
    (info / "entry_points.txt").write_text(f"[bt_agents.nodes]\n{points}")
    monkeypatch.syspath_prepend(place)
    # Nothing here blocks, but a call may take long on a busy machine.
    monkeypatch.setattr(plugin, "BLOCKS_S", 300.0)
    before = set(sys.modules)
    installed_plugins.cache_clear()
    yield
    installed_plugins.cache_clear()
    for name in set(sys.modules) - before:
        if name == "their_nodes":
            del sys.modules[name]


class PluginHarness:
    """A host with one agent, whose run a market has started."""

    def __init__(self, ros: Any, tmp_path: Path, tree: str) -> None:
        self.ros = ros
        self.market = Market(ros)
        text = HEAD.format("guide") + PROFILE + tree
        self.host = self.market.host(folder(tmp_path, text))
        self.made = self.count()
        self.handle: Any = None

    def count(self) -> tuple[int, int]:
        """Return the numbers of the host's subscriptions and waitables."""
        return len(list(self.host.subscriptions)), len(list(self.host.waitables))

    def begin(self, round_number: int = 1) -> None:
        self.handle = self.market.send(self.market.goal(self.host, "guide", round=round_number))

    def result(self) -> Any:
        return self.market.result(self.handle).result

    def play(self) -> Any:
        """Start a run; return its result."""
        self.begin()
        return self.result()

    def publish(self, kind: Any, topic: str, data: Any) -> None:
        """Publish once the behaviour has subscribed."""
        publisher = self.ros.node.create_publisher(kind, topic, 10)
        self.ros.until(publisher.get_subscription_count)
        publisher.publish(kind(data=data))


def test_example_package_is_that_of_the_page() -> None:
    for file, language in (("pyproject.toml", "toml"), ("their_nodes.py", "py")):
        _, _, written = (EXAMPLE / file).read_text(encoding="utf-8").partition("\n")
        assert written == block(language)


def test_example_package_passes_its_tests() -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", "/dev/null", "."],
        cwd=EXAMPLE,
        # With the py_trees_ros of this process, or its stand-in.
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(EXAMPLE), *sys.path])},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "2 passed" in ended.stdout, ended.stdout + ended.stderr


def test_documented_example_runs(ros: Any, tmp_path: Path) -> None:
    other = ScriptedServer(ros, "other/say")
    said = ScriptedServer(ros)
    harness = PluginHarness(ros, tmp_path, block("yaml"))
    logged = ros.collect(Log, "/rosout", qos.FACTS)
    # Other tests in this process may have ended in the middle of a run.
    before = set(py_trees.blackboard.Blackboard.keys())
    for number in (1, 2):
        harness.begin(number)
        harness.publish(Bool, "door", True)
        ros.until(lambda count=number: len(other.goals) == count)
        harness.publish(String, "words", f"hello {number}")
        result = harness.result()
        assert (result.outcome, list(result.orphans)) == (RunAgent.Result.SUCCEEDED, [])
    assert [goal.request.text for goal in other.goals] == ["Come in."] * 2
    assert [goal.request.text for goal in said.goals] == ["You said hello 1.", "You said hello 2."]
    assert harness.count() == harness.made
    keys = py_trees.blackboard.Blackboard.keys() - before
    assert not [key for key in keys if key.startswith(("/heard", "/goal_"))]
    clients = py_trees.blackboard.Blackboard.clients.values()
    assert not {"greet Come in.", "listen"} & set(clients)
    assert not [line for line in logged if "at the end of the run" in line.msg]


def test_restarted_leaf_reuses_one_subscription_and_releases_it(ros: Any, tmp_path: Path) -> None:
    harness = PluginHarness(ros, tmp_path, "tree: {door: true, repeat: {times: 300}}\n")
    harness.host._runs.set_rate(1000.0)
    seen: list[int] = []
    harness.host._runs.on_tick.append(lambda: seen.append(harness.count()[0]))
    harness.begin()
    harness.publish(Bool, "door", True)
    result = harness.result()
    assert result.outcome == RunAgent.Result.SUCCEEDED
    assert result.ticks >= 300
    assert max(seen) == harness.made[0] + 1
    assert harness.count() == harness.made


def test_goal_stopped_before_acceptance_is_cancelled_on_acceptance(
    ros: Any, tmp_path: Path
) -> None:
    other = ScriptedServer(ros, "other/say", script=Script(accept_s=1.5, finish_s=None))
    harness = PluginHarness(ros, tmp_path, "tree: {greet: Come in., timeout: 1 s}\n")
    result = harness.play()
    assert (result.outcome, list(result.orphans)) == (RunAgent.Result.FAILED, [])
    [goal] = other.goals
    assert (goal.outcome, goal.cancels) == ("cancelled", 1)
    assert harness.count() == harness.made


def test_goal_stopped_while_running_is_cancelled_once(ros: Any, tmp_path: Path) -> None:
    other = ScriptedServer(ros, "other/say", script=Script(finish_s=None))
    harness = PluginHarness(ros, tmp_path, "tree: {greet: Come in.}\n")
    harness.begin()
    ros.until(lambda: other.goals and other.goals[0].accepted.done())
    ros.turns()
    harness.handle.cancel_goal_async()
    result = harness.result()
    assert (result.outcome, list(result.orphans)) == (RunAgent.Result.CANCELLED, [])
    assert (other.goals[0].outcome, other.goals[0].cancels) == ("cancelled", 1)


def test_goal_of_unstoppable_server_is_an_orphan(ros: Any, tmp_path: Path) -> None:
    other = ScriptedServer(ros, "other/say", script=Script(finish_s=None, on_cancel="refuses"))
    harness = PluginHarness(ros, tmp_path, "tree: {greet: Come in., timeout: 1 s}\n")
    result = harness.play()
    assert (result.outcome, list(result.orphans)) == (RunAgent.Result.FAILED, ["tree"])
    assert other.goals[0].cancels


def test_missing_server_fails_leaf_without_blocking(ros: Any, tmp_path: Path) -> None:
    harness = PluginHarness(ros, tmp_path, "tree: {greet: Come in.}\n")
    began = time.monotonic()
    result = harness.play()
    assert result.outcome == RunAgent.Result.FAILED
    assert "other/say unreachable: its server is not there" in result.message
    assert time.monotonic() - began < 20.0
    assert not result.overruns or result.ticks > 10
    assert harness.count() == harness.made
