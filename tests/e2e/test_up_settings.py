# SPDX-License-Identifier: Apache-2.0
"""Settings of `up`, which restarted components keep."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest

from programs import Ask, Start, node_of

pytestmark = pytest.mark.e2e


def test_options_and_parameter_file_survive_market_restart(
    start_up: Start, ask: Ask, tmp_path: Path
) -> None:
    file = tmp_path / "my.yaml"
    file.write_text(
        "marketplace: {ros__parameters: {on_new_scene: reject, queue_limit: 3}}\n"
        "agents: {ros__parameters: {tick_rate: 25.0, pace: 2.0}}\n"
        "/**: {ros__parameters: {pace: 1.0, bid_deadlin: 0.4}}\n"
    )
    up = start_up("--on-new-scene", "preempt", "--params", str(file), "--bindings", "peper")
    up.until("problem no skills file binds the robot 'peper'")
    misspelt = "no node here has a parameter 'bid_deadlin'"
    if misspelt not in up.output:  # it may come before the rest is ready
        up.until(misspelt)
    assert "did you mean 'bid_deadline'" in up.output
    settings = "new scenes: preempt, 0 of 3 wait"
    said = ask("status")
    assert settings in said
    assert "my.yaml: agents has no parameter 'pace'" in said
    assert misspelt in said
    assert "a parameter 'pace'" not in up.output + said, "the robot has it"
    assert re.search(r"tick_rate +25", ask("tune"))
    os.kill(node_of(up.process.pid, "marketplace_node.node"), signal.SIGKILL)
    up.until("marketplace is back")
    assert settings in ask("status")
