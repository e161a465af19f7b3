# SPDX-License-Identifier: Apache-2.0
"""The marketplace under messages and requests that are too large or too many, from elsewhere."""

from __future__ import annotations

import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

import flooder
from bt_agents_interfaces.msg import MarketHeartbeat
from bt_agents_ros import qos
from processes import System, write_trees

pytestmark = pytest.mark.e2e

LONGEST_SILENCE_S = 2.0
"""Between two heartbeats as the probe hears them, on a machine that does much else [s]."""

MOST_GROWTH_MB = 200.0


def resident_mb(pid: int) -> float:
    """Return the memory of a process that is in use [MB]."""
    status = Path(f"/proc/{pid}/status").read_text()
    [line] = [line for line in status.splitlines() if line.startswith("VmRSS:")]
    return float(line.split()[1]) / 1000


@pytest.mark.parametrize("kind", flooder.FLOODS)
def test_a_flood_does_not_silence_the_market_nor_stay_in_its_memory(
    system: System, tmp_path: Path, kind: str
) -> None:
    trees = write_trees(tmp_path / "leo", leo=(4.5, "say: leo speaks"))
    market = system.market(trees, collect_deadline=0.05)
    system.host("agents", trees)
    system.mouth.holds = lambda _text: False
    came: list[float] = []
    system.ros.node.create_subscription(
        MarketHeartbeat,
        "marketplace/heartbeat",
        lambda _beat: came.append(time.monotonic()),
        qos.EVENTS,
    )
    system.until_ready(hosts=1, agents=1)
    system.until(lambda: came, "a heartbeat")
    before_mb = resident_mb(market.pid)
    flood = subprocess.Popen([sys.executable, flooder.__file__, kind])
    try:
        system.until(lambda: flood.poll() is not None, f"the end of the flood of {kind}")
    finally:
        flood.kill()
        flood.wait()
    assert flood.returncode == 0
    heard = len(came)
    system.until(lambda: len(came) > heard + 10, "heartbeats after the flood")
    silence_s = max(later - earlier for earlier, later in pairwise(came))
    growth_mb = resident_mb(market.pid) - before_mb
    print(f"{kind}: longest silence {silence_s:.2f} s, memory {growth_mb:+.0f} MB")
    assert silence_s < LONGEST_SILENCE_S
    assert growth_mb < MOST_GROWTH_MB
    system.scene("s1", age=5, familiarity=3, mood=3)
    assert system.until_end_of("s1").code == "SUCCEEDED"
