# SPDX-License-Identifier: Apache-2.0
"""Marketplace: calls for bids, ranks them and awards the run to one agent."""

from bt_agents_ros.node_main import start


def main() -> int:
    """Run the marketplace; return the exit code."""
    return start("marketplace_node.node")


def selector() -> int:
    """Run the selector, which has a language model rank bids; return the exit code."""
    return start("marketplace_node.node.selector")
