# SPDX-License-Identifier: Apache-2.0
"""What a tree is told when the process of the robot is killed in the middle of a sentence."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from std_msgs.msg import Empty, String

from bt_agents_interfaces.msg import Run
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from processes import BEATS_A_SECOND, ROOT, System, write_trees

pytestmark = pytest.mark.e2e

LONG = "word " * 200


def test_a_robot_killed_in_the_middle_of_a_sentence_makes_the_leaf_fail_and_ends_the_run(
    system: System, tmp_path: Path
) -> None:
    trees = write_trees(tmp_path / "a", leo=(4.0, f"say: {LONG}"))
    shutil.rmtree(trees / "skills")
    shutil.copytree(ROOT / "trees" / "skills", trees / "skills")
    system.ros.remove(system.mouth)
    acts: list[String] = system.ros.collect(String, "robot/transcript", qos.EVENTS)
    system.market(trees, collect_deadline=0.05, bid_deadline=5.0)
    robot = system.start(components.robot(pace=1.0, voice="off"))
    system.host("agents", trees)
    system.until_ready(hosts=1, agents=1)
    pulse = system.pulse("agents")
    system.scene("s1", age=5, familiarity=3, mood=3)
    system.until(lambda: acts and pulse.count, "the robot speaks")
    robot.kill()
    killed_at = pulse.count
    end = system.until_end_of("s1")
    assert end.code == "FAILED"
    assert pulse.count - killed_at <= 5 * BEATS_A_SECOND
    [ended] = system.ended("leo")
    assert ended.outcome == Run.FAILED
    assert "say unreachable" in ended.message
    assert list(ended.orphans) == ["tree"]
    beats: list[Empty] = system.ros.collect(Empty, "robot/heartbeat", qos.SENSOR)
    robot.start()
    system.until(lambda: beats, "the robot is back")
    # The graph goes on showing the server that is dead, so a first goal may be lost on it.
    for number in range(2, 7):
        system.scene(f"s{number}", age=5, familiarity=3, mood=3)
        system.until(
            lambda n=number: len(acts) == 2 or system.ends_of(f"s{n}"), "the robot speaks again"
        )
        if len(acts) == 2:
            return
    pytest.fail(f"the robot was started again, but it is not asked to speak:\n{system.told()}")
