# SPDX-License-Identifier: Apache-2.0
"""The agent runtime: ticks behaviour trees, and hosts agents as one ROS node."""

from bt_agents_ros.node_main import start


def main() -> int:
    """Run a host of agents; return the exit code."""
    return start("bt_agents.host.node")
