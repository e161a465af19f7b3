# SPDX-License-Identifier: Apache-2.0
"""Network traffic of an idle system, and discovery by late processes."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from pathlib import Path

import pytest

from programs import HANG_S, ROOT, Start
from skipped_tests import NAMESPACES

pytestmark = pytest.mark.e2e

AT_ONCE = 20
_ALONE = ("unshare", "-rn")
"""A network namespace of its own, for users who may create one."""


def test_idle_system_sends_few_datagrams_and_stays_discoverable(
    environment: dict[str, str], trees: Path
) -> None:
    tried = [*_ALONE, "ip", "link", "set", "lo", "up"]
    made = subprocess.run(tried, capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"{NAMESPACES}: {made.stderr.strip()}")
    measured = subprocess.run(
        [*_ALONE, sys.executable, str(ROOT / "tests/harness/idle_traffic.py"), trees],
        stdout=subprocess.PIPE,
        env={key: value for key, value in environment.items() if key != "ROS_DOMAIN_ID"},
        timeout=3 * HANG_S,
        check=True,
    )
    found = json.loads(measured.stdout)
    assert found["sent"] <= 200.0
    assert found["unheard"] < 1.0
    # The faster ones, because the others wait for a core on a busy machine.
    assert statistics.quantiles(found["joined"])[0] <= 1.0, found["joined"]


def test_concurrent_commands_are_all_answered(
    start: Start, start_up: Start, environment: dict[str, str]
) -> None:
    start_up()
    asking = [start("status") for _ in range(AT_ONCE)]
    for one in asking:
        assert one.wait() == 0, one.output
    assert all("attentive_guide" in one.output for one in asking)
