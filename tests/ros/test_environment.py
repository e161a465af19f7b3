# SPDX-License-Identifier: Apache-2.0
"""Environment of a host's trees apart from goals: log lines, local time, preparation."""

from __future__ import annotations

import time
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Log
from rclpy.impl import rcutils_logger

from bt_agents.host.environment.open_goal_list import OpenGoalList
from bt_agents.host.environment.ros_environment import RosEnvironment
from bt_agents_core.local_time import local_time
from bt_agents_interfaces.action import RunAgent
from bt_agents_ros import qos
from bt_agents_ros.workarounds import quick_logger
from bt_agents_ros.workarounds.quick_logger import QuickLogger
from hostile_texts import HOSTILE
from tree_harness import SPACE, agent


def environment_of(ros: Any) -> RosEnvironment:
    return RosEnvironment(
        ros.node,
        lambda: None,
        run_goal=lambda: RunAgent.Goal(agent="guide"),
        open_goals=OpenGoalList(ros.node, "first", lambda: None),
        space=SPACE,
    )


def test_log_lines_carry_running_agent_name_and_level(ros: Any) -> None:
    lines = ros.collect(Log, "/rosout", qos.HISTORY)
    subject = environment_of(ros)
    for level in ("info", "warning", "error", "info"):
        subject.log(level, f"this is {level}")
    told = [("this is info", 20), ("this is warning", 30), ("this is error", 40)]
    ros.until(
        lambda: (
            [(line.msg, line.level) for line in lines if line.name == "probe.guide"]
            == [*told, told[0]]
        )
    )


def test_log_escapes_control_characters_and_indents_continuation_lines(ros: Any) -> None:
    lines = ros.collect(Log, "/rosout", qos.HISTORY)
    logger = QuickLogger(ros.node.get_logger().name)
    logger.info(HOSTILE)
    logger.info(HOSTILE, once=True)
    logger.get_child("guide").info(HOSTILE)
    ros.until(lambda: sum("title" in line.msg for line in lines) == 3)
    for line in lines:
        if "title" in line.msg:
            first, further = line.msg.split("\n")
            assert first.isprintable()
            assert further.startswith("    [FATAL] forged")
            assert not {one for one in further if not one.isprintable()} - {"\t"}


def test_local_time_follows_node_clock(ros: Any) -> None:
    before, told = local_time(time.time()), environment_of(ros).local_time()
    assert told in (before, local_time(time.time()))


def test_log_throttling_works_per_level_in_symlinked_files(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / "linked_logger.py"
    link.symlink_to(quick_logger.__file__)
    spec = spec_from_file_location("linked_logger", link)
    assert spec is not None
    assert spec.loader is not None
    ros.node.get_logger().info("rclpy lists its own files with the first line that it logs")
    known = [name for name in rcutils_logger._internal_callers if "quick_logger" not in name]
    monkeypatch.setattr(rcutils_logger, "_internal_callers", known)
    linked = module_from_spec(spec)
    spec.loader.exec_module(linked)
    lines = linked.QuickLogger("linked")
    for told in (True, False):
        assert lines.warning("again and again", throttle_duration_sec=60.0) == told
        assert lines.error("again and again", throttle_duration_sec=60.0) == told


def test_preparation_failure_is_logged_and_left_to_leaf(ros: Any) -> None:
    lines = ros.collect(Log, "/rosout", qos.HISTORY)
    tree = agent("publish: {topic: sound, type: no_such_msgs/msg/Word, message: {}}").tree
    environment_of(ros).prepare(tree)
    ros.until(
        lambda: [line for line in lines if "tree, a.yaml:8:3: " in line.msg and line.level == 30]
    )
