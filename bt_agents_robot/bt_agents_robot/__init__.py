# SPDX-License-Identifier: Apache-2.0
"""A simulated robot and its visitors, behind real ROS interfaces."""

from bt_agents_ros.node_main import start


def run_robot() -> int:
    """Run the simulated robot; return the exit code."""
    return start("bt_agents_robot.robot")


def run_visitors() -> int:
    """Run the simulated visitors; return the exit code."""
    return start("bt_agents_robot.visitors")
