# SPDX-License-Identifier: Apache-2.0
"""Feedback given while the feedback node is dead: applied exactly once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bt_agents_interfaces.msg import Profiles
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from feedback_node.ledger import Ledger
from processes import System, write_trees

pytestmark = pytest.mark.e2e

TREE = """
sequence:
  - say: the first
  - give_feedback: positive
  - say: the second
"""


def test_feedback_for_killed_node_is_applied_exactly_once(system: System, simulated: Path) -> None:
    trees = write_trees(system.folder / "a", leo=(4.0, TREE))
    ledger = system.folder / "ledger.sqlite"
    system.market(trees, collect_deadline=0.5, bid_deadline=5.0)
    feedback = system.start(components.feedback(trees, str(ledger), simulated))
    system.host("agents", trees)
    profiles: list[Profiles] = system.ros.collect(Profiles, "bt_agents/profiles", qos.FACT)
    system.until_ready(hosts=1, agents=1)
    system.until(lambda: profiles and profiles[-1].agents == ["leo"], "the profile of leo")

    system.old_person("s1")
    system.until_speaking("the first")
    feedback.kill()
    system.say_server.finish()
    system.until_speaking("the second")
    system.say_server.let_go()
    assert system.until_end_of("s1").code == "SUCCEEDED"
    assert list(profiles[-1].revisions) == [0]

    feedback.start()
    system.until(lambda: list(profiles[-1].revisions) == [2], "both changes are applied")
    feedback.kill()
    feedback.start()
    # The rest of the first interaction comes before the feedback of another one.
    system.old_person("s2")
    assert system.until_end_of("s2").code == "SUCCEEDED"
    system.until(lambda: list(profiles[-1].revisions) == [4], "two more changes are applied")
    feedback.kill()
    with Ledger(ledger) as book:
        history = book.history("leo")
    assert [revision.revision for revision in history] == [0, 1, 2, 3, 4]
    causes = [revision.cause for revision in history[1:]]
    assert sorted(cause.source for cause in causes) == ["simulated"] * 2 + ["tree"] * 2
    assert len({cause.feedback_id for cause in causes}) == 4
    # positive and direct feedback touch different values, so their order does not matter
    age = 5 - (5 - 4.0) * 0.8**2 if math.isclose(causes[0].rate, 0.2) else math.nan
    assert profiles[-1].vectors[0] == pytest.approx(age)
