# SPDX-License-Identifier: Apache-2.0
"""Outcome for a tree when the robot's process is killed in the middle of a sentence."""

from __future__ import annotations

import shutil

import pytest
from std_msgs.msg import Empty, String

from bt_agents_interfaces.msg import OpenGoals, Run
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from processes import BEATS_A_SECOND, NodeProcess, System, write_trees
from tree_harness import TREES

pytestmark = pytest.mark.e2e

LONG = "word " * 200


def robot_and_host(
    system: System, tree: str, within: str = "2 s", accept: str = "3 s"
) -> NodeProcess:
    """Start a market, the simulated robot and a host with one agent; return the robot.

    The robot is lost after a silence of ``within``; it must accept a goal within ``accept``.
    """
    trees = write_trees(system.folder / "a", leo=(4.0, tree))
    shutil.rmtree(trees / "skills")
    shutil.copytree(TREES / "skills", trees / "skills")
    file = trees / "skills" / "robot.yaml"
    text = file.read_text().replace("within: 2 s", f"within: {within}")
    patient = f"{{result: 2 min, accept: {accept}, server: {accept}}}"
    file.write_text(text.replace("{result: 2 min}", patient))
    system.say_server.die()
    system.market(trees, collect_deadline=0.05, bid_deadline=5.0)
    beats = system.ros.collect(Empty, "robot/heartbeat", qos.SENSOR)
    robot = system.start(components.robot("off"))
    system.host("agents", trees)
    system.until_ready(hosts=1, agents=1)
    system.until(lambda: beats, "the robot")
    return robot


def test_killing_robot_during_sentence_fails_leaf_and_run(system: System) -> None:
    acts: list[String] = system.ros.collect(String, "robot/transcript", qos.EVENTS)
    opened: list[OpenGoals] = system.ros.collect(OpenGoals, "bt_agents/open_goals", qos.FACTS)
    robot = robot_and_host(system, f"say: {LONG}")
    heartbeat_probe = system.heartbeat_probe("agents")
    system.old_person("s1")
    system.until(lambda: acts, "the robot speaks")
    robot.kill()
    killed_at = heartbeat_probe.count
    end = system.until_end_of("s1")
    assert end.code == "FAILED"
    assert heartbeat_probe.count - killed_at <= 5 * BEATS_A_SECOND
    [ended] = system.ended("leo")
    assert ended.outcome == Run.FAILED
    assert "say unreachable" in ended.message
    assert list(ended.orphans) == ["tree"]
    assert opened[-1].goals, "a robot that is dead may go on, for all one knows"
    beats: list[Empty] = system.ros.collect(Empty, "robot/heartbeat", qos.SENSOR)
    robot.start()
    system.until(lambda: beats, "the robot is back")
    system.until(
        lambda: not opened[-1].goals, "the robot knows nothing of it, so it is open no longer"
    )
    system.old_person("s2")
    system.until(lambda: len(acts) == 2, "the robot speaks again")


def test_quickly_restarted_robot_does_not_know_old_goal(system: System) -> None:
    acts: list[String] = system.ros.collect(String, "robot/transcript", qos.EVENTS)
    robot = robot_and_host(system, f"say: {LONG}", within="30 s")
    system.old_person("s1")
    system.until(lambda: acts, "the robot speaks")
    robot.kill()
    robot.start()
    assert system.until_end_of("s1").code == "FAILED"
    [ended] = system.ended("leo")
    assert "knows nothing of the goal" in ended.message


def test_restarted_robot_says_sentence_sent_while_dead(system: System) -> None:
    robot = robot_and_host(system, "say: hello", within="30 s", accept="30 s")
    system.old_person("s1")
    assert system.until_end_of("s1").code == "SUCCEEDED"
    robot.kill()
    system.old_person("s2")
    system.until(lambda: len(system.started("leo")) == 2, "the second run")
    robot.start()
    assert system.until_end_of("s2").code == "SUCCEEDED"
    assert robot.said.count("robot says: hello") == 2
