# SPDX-License-Identifier: Apache-2.0
"""Traffic of an idle system: run as ``unshare -rn python idle_traffic.py TREES``.

Prints a line of JSON: datagrams sent per second, how many of them go to ports without a listener,
and after which time each of some late processes has discovered the system [s].
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from programs import BT_AGENTS, HANG_S, printed_by

SETTLE_S = 10.0
WINDOW_S = 5.0
JOINERS = 7

JOIN = """
import sys, time
import rclpy
from rclpy.qos import QoSProfile
from bt_agents_interfaces.msg import MarketStatus
from bt_agents_interfaces.srv import Analyze, CollectFeedback
from bt_agents_ros import qos
rclpy.init()
node = rclpy.create_node("late")
begin = time.monotonic()
heard = []
node.create_subscription(MarketStatus, "bt_agents/market", heard.append, qos.FACT)
clients = [
    node.create_client(Analyze, "scene_layer/analyze"),
    node.create_client(CollectFeedback, "feedback/collect"),
]
while not (heard and all(one.service_is_ready() for one in clients)):
    rclpy.spin_once(node, timeout_sec=0.01)
    if time.monotonic() - begin > 20:
        break
print(time.monotonic() - begin)
"""


def main() -> None:
    """Measure, and print the result."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    # Use the launcher's profile, like all commands.
    from bt_agents_tools.launcher.supervisor import set_discovery

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    command = [sys.executable, *BT_AGENTS, "up", sys.argv[1], "--no-voice"]
    up = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert up.stdout is not None
        for line in up.stdout:
            if line.startswith("ready"):
                break
        time.sleep(SETTLE_S)
        before, begin = _counts(), time.monotonic()
        time.sleep(WINDOW_S)
        after, duration_s = _counts(), time.monotonic() - begin
        set_discovery(os.environ)
        joined = [float(printed_by(JOIN)[-1]) for _ in range(JOINERS)]
    finally:
        up.send_signal(signal.SIGINT)
        up.wait(HANG_S)
    found = {
        "sent": (after["OutDatagrams"] - before["OutDatagrams"]) / duration_s,
        "unheard": (after["NoPorts"] - before["NoPorts"]) / duration_s,
        "joined": joined,
    }
    print(json.dumps(found))


def _counts() -> dict[str, int]:
    """Return the UDP counters of this network namespace by name."""
    lines = Path("/proc/net/snmp").read_text().splitlines()
    names, values = (line.split()[1:] for line in lines if line.startswith("Udp:"))
    return dict(zip(names, map(int, values), strict=True))


if __name__ == "__main__":
    main()
