# SPDX-License-Identifier: Apache-2.0
"""Process that prints the messages that reach one machine: acts, runs, scenes, the market."""

from __future__ import annotations

from typing import Any

import rclpy
from std_msgs.msg import String

from bt_agents_interfaces.msg import MarketStatus, Run, SceneEnd
from bt_agents_ros import qos


def say(text: str) -> None:
    """Print a line at once."""
    print(text, flush=True)


def on_market(status: Any) -> None:
    """Print the numbers of hosts and agents."""
    say(f"market: {status.hosts} hosts, {status.agents} agents")


def on_run(run: Any) -> None:
    """Print an event of a run."""
    say(f"run {run.round}: {run.agent} {run.event}-{run.outcome} {run.message}")


def main() -> None:
    """Print until the process is killed."""
    rclpy.init()
    node = rclpy.create_node("_probe")
    node.create_subscription(
        String, "robot/transcript", lambda m: say(f"robot {m.data}"), qos.EVENTS
    )
    node.create_subscription(MarketStatus, "bt_agents/market", on_market, qos.FACT)
    node.create_subscription(Run, "bt_agents/runs", on_run, qos.EVENTS)
    node.create_subscription(
        SceneEnd, "bt_agents/scene_ends", lambda m: say(f"end: {m.agent} {m.code}"), qos.EVENTS
    )
    say("listening")
    rclpy.spin(node)


if __name__ == "__main__":
    main()
