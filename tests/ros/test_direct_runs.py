# SPDX-License-Identifier: Apache-2.0
"""Runs without a market: any program runs an agent by name."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from action_msgs.msg import GoalStatus
from py_trees.common import Status
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from bt_agents.host import run_server
from bt_agents.host.node import HostNode, make_node
from bt_agents.host.run_server import MOST_REFUSALS
from bt_agents_core.errors import Refused
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Heartbeat, OpenGoals, Scene, SceneValue, TreeStatus
from bt_agents_ros import qos
from bt_agents_ros.types import fill
from fake_market import agent_text, folder, make_host
from programs import ROOT
from scripted_server import ScriptedServer

TALKER = agent_text("talker", "say: hello", "on_cancel: {say: good-bye}")
QUICK = agent_text("quick", "wait: 0 s")
GUIDE = agent_text("attentive_guide", "wait: 0.1 s")
TELLER = agent_text("teller", "say: 'age ${scene.age}'")
DANCER = agent_text("dancer", "dance: {}")
SKILL = """
format: 1
skills:
  dance:
    description: dances
    action: {name: dance, type: nobody_has/action/Dance}
"""


class Client:
    """A program that knows the name of an agent, but no market."""

    def __init__(self, ros: Any) -> None:
        self.ros = ros
        self.feedback: list[TreeStatus] = []
        self.action = ActionClient(ros.node, RunAgent, "agents/run")
        ros.until(self.action.server_is_ready)

    def send(self, agent: str, **fields: Any) -> Any:
        future = self.action.send_goal_async(
            RunAgent.Goal(agent=agent, **fields),
            feedback_callback=lambda message: self.feedback.append(message.feedback.status),
        )
        return self.ros.result(future)

    def result(self, handle: Any) -> Any:
        return self.ros.result(handle.get_result_async())

    def refusal(self, agent: str, **fields: Any) -> tuple[str, str]:
        answer = self.result(self.send(agent, **fields))
        assert answer.status == GoalStatus.STATUS_ABORTED
        assert answer.result.outcome == RunAgent.Result.REFUSED
        return answer.result.code, answer.result.message


@pytest.fixture
def host(ros: Any, tmp_path: Path) -> HostNode:
    trees = folder(tmp_path, QUICK, GUIDE, TALKER, TELLER, DANCER)
    (trees / "skills" / "dance.yaml").write_text(SKILL)
    node: HostNode = ros.add(make_host(trees, market=False))
    return node


@pytest.fixture
def client(ros: Any, host: HostNode) -> Iterator[Client]:
    one = Client(ros)
    yield one
    one.action.destroy()


def test_agent_name_alone_starts_run_with_feedback(
    ros: Any, host: HostNode, client: Client, mouth: ScriptedServer
) -> None:
    beats = ros.collect(Heartbeat, "agents/heartbeat", qos.EVENTS)
    opened = ros.collect(OpenGoals, "bt_agents/open_goals", qos.FACT)
    handle = client.send("talker")
    ros.until(lambda: mouth.goals and client.feedback)
    ros.until(lambda: opened and opened[-1].goals)
    ros.until(lambda: beats and beats[-1].agent == "talker")
    assert [(one.epoch, one.round) for one in (beats[-1], opened[-1], client.feedback[0])] == [
        (host.instance, 1)
    ] * 3
    mouth.goals[0].finish()
    answer = client.result(handle)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.outcome == RunAgent.Result.SUCCEEDED
    ros.until(lambda: not opened[-1].goals)
    assert client.result(client.send("quick")).status == GoalStatus.STATUS_SUCCEEDED


def test_cancel_runs_clean_up_of_agent(ros: Any, client: Client, mouth: ScriptedServer) -> None:
    handle = client.send("talker")
    ros.until(lambda: mouth.goals)
    handle.cancel_goal_async()
    ros.until(lambda: len(mouth.goals) == 2)
    assert (mouth.goals[0].cancels, mouth.goals[1].request.text) == (1, "good-bye")
    mouth.goals[1].finish()
    answer = client.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.outcome == RunAgent.Result.CANCELLED
    assert answer.result.stop_cause == RunAgent.Result.BY_HOST
    assert "the program that started it stopped it" in answer.result.message


def test_unrunnable_goal_is_refused_with_reason(
    ros: Any, client: Client, mouth: ScriptedServer
) -> None:
    assert client.refusal("nobody") == (
        "UNKNOWN_AGENT",
        "no agent 'nobody' here; there are: attentive_guide, dancer, quick, talker, teller",
    )
    assert client.refusal("")[0] == "EMPTY"
    wrong = Scene(values=[SceneValue(name="age", value=99.0)])
    assert client.refusal("quick", scene=wrong)[0] == "OUT_OF_RANGE"
    unknown = Scene(values=[SceneValue(name="height", value=1.0)])
    assert client.refusal("quick", scene=unknown)[0] == "UNKNOWN_PARAMETER"
    code, message = client.refusal("dancer")
    assert (code, message.partition(": ")[0]) == ("UNAVAILABLE", "dancer cannot run")
    assert "nobody_has" in message
    handle = client.send("talker")
    ros.until(lambda: mouth.goals)
    assert client.refusal("quick") == ("BUSY", "talker is running; one tree at a time")
    assert mouth.goals[0].cancels == 0
    mouth.goals[0].finish()
    assert client.result(handle).result.outcome == RunAgent.Result.SUCCEEDED


def test_run_without_simulated_time_is_refused(host: HostNode, client: Client) -> None:
    host.set_parameters([Parameter("use_sim_time", value=True)])
    reason = "quick cannot run: use_sim_time is set, but nothing publishes /clock"
    assert client.refusal("quick") == ("UNAVAILABLE", reason)


def test_refusal_names_simulated_time_at_zero(ros: Any, host: HostNode, client: Client) -> None:
    host.set_parameters([Parameter("use_sim_time", value=True)])
    ros.node.create_publisher(Clock, "/clock", 1).publish(Clock())
    ros.until(lambda: host.count_publishers("/clock"))
    reason = "quick cannot run: use_sim_time is set, but /clock stands at zero"
    assert client.refusal("quick") == ("UNAVAILABLE", reason)


def test_agent_still_runs_after_flood_of_refused_goals(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    # All goals arrive within this time, even on a slow machine.
    monkeypatch.setattr(run_server, "RESULT_TIMEOUT_S", 300)
    accepted = [client.send("nobody").accepted for _ in range(MOST_REFUSALS + 5)]
    assert accepted[:MOST_REFUSALS] == [True] * MOST_REFUSALS
    assert False in accepted[MOST_REFUSALS:]
    assert client.result(client.send("quick")).result.outcome == RunAgent.Result.SUCCEEDED


def test_run_uses_scene_values_of_its_goal(
    ros: Any, client: Client, mouth: ScriptedServer
) -> None:
    handle = client.send("teller", scene=Scene(values=[SceneValue(name="age", value=4.5)]))
    ros.until(lambda: mouth.goals)
    assert mouth.goals[0].request.text == "age 4.5"
    mouth.goals[0].finish()
    client.result(handle)
    unknown = Scene(person=True, values=[SceneValue(name="mood", value=2.0)])
    answer = client.result(client.send("teller", scene=unknown))
    assert "'scene.age' has no value" in answer.result.message


def test_documented_goals_can_be_sent() -> None:
    page = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
    goals = re.findall(r"send_goal /agents/run bt_agents_interfaces/action/RunAgent '(.*?)'", page)
    assert len(goals) == 2
    for text in goals:
        goal = RunAgent.Goal()
        fill(goal, yaml.safe_load(text))
        assert goal.agent == "attentive_guide"


@pytest.mark.usefixtures("host")
def test_documented_client_runs_agent(ros: Any) -> None:
    page = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
    [code] = re.findall(r"```py\n(import rclpy.*?)```", page, re.DOTALL)
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as program:
        try:
            ros.until(lambda: program.poll() is not None)
            assert program.stdout is not None
            *_, last = program.stdout.read().splitlines()
            assert (program.returncode, last) == (0, "succeeded")
        finally:
            program.kill()


# The setup of the leaf blocks until it finds the server, as the client has.
@pytest.mark.usefixtures("py_trees_ros", "client")
def test_documented_leaf_runs_agent(ros: Any, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
    [code] = re.findall(r"```py\n(from py_trees_ros.*?)```", page, re.DOTALL)
    example = tmp_path / "example.py"
    example.write_text(code)
    leaf = runpy.run_path(str(example))["guide"]
    leaf.setup(node=ros.node)

    def ended() -> bool:
        leaf.tick_once()
        return bool(leaf.status is Status.SUCCESS)

    ros.until(ended)
    leaf.shutdown()


def test_unknown_market_is_refused_at_start(tmp_path: Path) -> None:
    rclpy.init(args=["--ros-args", "-p", "market:=plaza"], domain_id=0)
    try:
        with pytest.raises(Refused, match="UNKNOWN_CHOICE: the parameter 'market' is 'plaza'"):
            make_node()
    finally:
        rclpy.try_shutdown()
