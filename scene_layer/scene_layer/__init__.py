# SPDX-License-Identifier: Apache-2.0
"""The scene layer: turns sensor readings into the vector that describes an interaction."""

from bt_agents_ros.node_main import start


def main() -> int:
    """Run the scene layer; return the exit code."""
    return start("scene_layer.node")
