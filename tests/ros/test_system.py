# SPDX-License-Identifier: Apache-2.0
"""The whole system in one process, all parts real."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from active_nodes import active_host
from bt_agents_interfaces.msg import Run, Scene
from bt_agents_interfaces.srv import Analyze, GiveFeedback
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from whole_system import System, write_agents


def test_mood_rules_fire_in_follow_up_rounds(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, wait="30 s", young=1.5, old=4.5, third=3.0))
    live = ros.collect(Scene, "bt_agents/scene/live", qos.SENSOR)
    system.analyze(age=5, familiarity=3, mood=4)
    for runs, mood in ((1, 3), (2, 2)):
        ros.until(lambda n=runs: sum(run.event == Run.STARTED for run in system.runs) == n)
        measured = Analyze.Request.AS_MEASURED
        assert system.analyze(announce=False, person=measured, mood=mood).accepted
    ros.until(lambda: sum(run.event == Run.STARTED for run in system.runs) == 3)
    assert {scene.person for scene in live} == {True}
    assert len({scene.scene_id for scene in live}) > 1


def test_second_host_with_same_agent_name_is_refused(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5))
    other = write_agents(tmp_path, young=5.0, other=5.0)
    second = ros.add(
        active_host(
            read_trees(other, InstalledInterfaces()), cli_args=["--ros-args", "-r", "__node:=b"]
        )
    )
    ros.until(lambda: second.registry.members["other"].agent_id)
    assert "young" in second.registry.members["young"].refusal
    assert "/agents" in second.registry.members["young"].refusal
    assert system.interact(age=5, familiarity=3, mood=3) == "other"
    assert "young" in {bid.agent for bid in system.auctions[-1].ranking}
    ros.until(lambda: "other" in system.profiles[-1].agents)
    assert ros.ask(GiveFeedback, "feedback/give", agent="young", values=[5.0, 5.0, 5.0]).accepted
    assert system.host.registry.members["young"].revision == 1
    assert second.registry.members["young"].revision == 0
