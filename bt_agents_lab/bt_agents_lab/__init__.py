# SPDX-License-Identifier: Apache-2.0
"""Journal of a system, its replay, and experiments on the market and on learning."""

from bt_agents_ros.node_main import start


def run_journal() -> int:
    """Run the journal; return the exit code."""
    return start("bt_agents_lab.node")
