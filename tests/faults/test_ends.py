# SPDX-License-Identifier: Apache-2.0
"""Shutdown of all parts of a system at once, as by Ctrl-C under ``ros2 launch``."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import pytest

from bt_agents_interfaces.msg import Profiles, Run
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from feedback_node.ledger import Ledger
from processes import System, write_trees

pytestmark = pytest.mark.e2e


@pytest.mark.parametrize(
    "order", ["one process", *map(", ".join, permutations(("market", "feedback", "host")))]
)
def test_running_agent_ends_properly_in_any_shutdown_order(
    system: System, simulated: Path, order: str
) -> None:
    trees = write_trees(system.folder / "a", leo=(4.0, "say: hello"))
    ledger = system.folder / "ledger.sqlite"
    feedback = components.feedback(trees, str(ledger), simulated)
    if order == "one process":
        together = [components.market(trees), components.host(trees), feedback]
        parts = {order: system.start(components.one_process(together))}
    else:
        parts = {
            "market": system.market(trees, bid_deadline=5.0),
            "feedback": system.start(feedback),
            "host": system.host("agents", trees),
        }
    profiles: list[Profiles] = system.ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
    system.until_ready(hosts=1, agents=1)
    system.until(lambda: profiles and profiles[-1].agents == ["leo"], "the profile of leo")
    system.old_person("s1")
    system.until_speaking("hello")
    system.until(system.started, "the market knows that leo runs")

    for name in order.split(", "):
        parts[name].terminate()
    system.until(lambda: all(part.ended for part in parts.values()), "all have ended")

    assert {name: part.exit_code for name, part in parts.items()} == dict.fromkeys(parts, 0)
    assert [(run.outcome, run.agent) for run in system.ended()] == [(Run.CANCELLED, "leo")]
    said = "".join(part.said for part in parts.values())
    assert "[ERROR]" not in said, said
    assert "lost with this process" not in said
    with Ledger(ledger) as book:
        history = book.history("leo")
    assert [(row.revision, row.cause.source) for row in history[1:]] == [(1, "simulated")]
