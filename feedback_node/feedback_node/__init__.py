# SPDX-License-Identifier: Apache-2.0
"""The feedback node: mood rules, learning and the ledger of profiles."""

from bt_agents_ros.node_main import start


def main() -> int:
    """Run the feedback node; return the exit code."""
    return start("feedback_node.node")
