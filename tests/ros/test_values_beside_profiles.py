# SPDX-License-Identifier: Apache-2.0
"""The whole system with a scene parameter that no profile has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bt_agents_interfaces.srv import GiveFeedback
from whole_system import System, write_agents

PAIN = "  pain: {min: 0, max: 10, default: 0, profile: false}\n"


def test_non_profile_value_reaches_only_conditions(ros: Any, tmp_path: Path) -> None:
    trees = write_agents(tmp_path, young=1.5, old=4.5)
    scene = trees / "scene.yaml"
    # It is first in the file, and last in every message.
    scene.write_text(scene.read_text().replace("parameters:\n", f"parameters:\n{PAIN}", 1))
    old = trees / "agents" / "old.yaml"
    old.write_text(old.read_text().replace("scene.person", "scene.pain > 3"))
    system = System(ros, trees)

    assert system.interact(age=5, familiarity=3, mood=3, pain=2) == "young"
    assert system.interact(age=5, familiarity=3, mood=3, pain=8) == "old"
    decision = system.auctions[-1]
    assert [value.name for value in decision.scene.values][-1] == "pain"
    assert [list(bid.vector) for bid in decision.ranking] == [[4.5, 3.0, 3.0], [1.5, 3.0, 3.0]]
    assert decision.ranking[0].calculation.startswith("0.5 = |4.5−5| + |3−3| + |3−3|")
    assert list(system.profiles[-1].parameters) == ["age", "familiarity", "mood"]

    client = ros.node.create_client(GiveFeedback, "feedback/give")
    answer = ros.call(client, GiveFeedback.Request(kind=1, agent="old", source="person"))
    assert answer.accepted, answer.message
    assert list(answer.feedback.parameters) == ["age", "familiarity", "mood"]
    assert 4.5 < answer.feedback.after[0] <= 5.0
    ros.until(lambda: system.host.registry.members["old"].revision == 1)
    assert system.interact(age=5, familiarity=3, mood=3, pain=8) == "old"
    assert system.auctions[-1].ranking[0].vector[0] == answer.feedback.after[0]
