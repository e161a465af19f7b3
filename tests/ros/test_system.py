# SPDX-License-Identifier: Apache-2.0
"""The whole system in one process, all parts real."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from active_nodes import active_host
from bt_agents_interfaces.msg import Run, Scene, SceneValue
from bt_agents_interfaces.srv import Analyze, CancelRun, GiveFeedback
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from whole_system import System, write_agents

pytestmark = pytest.mark.ros


def test_the_nearest_agent_wins_and_runs(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5, old=4.5))
    assert system.interact(age=1, familiarity=3, mood=3) == "young"
    assert system.interact(age=5, familiarity=3, mood=3) == "old"
    assert [run.event for run in system.runs] == [Run.STARTED, Run.ENDED] * 2
    assert {run.outcome for run in system.runs if run.event == Run.ENDED} == {Run.SUCCEEDED}
    assert "0.5 = |4.5" in system.auctions[-1].reason


def test_missing_values_are_marked_and_excluded_from_distance(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5, old=4.5))
    answer = system.analyze(age=5)
    origins = {value.name: value.origin for value in answer.scene.values}
    assert origins == {
        "age": SceneValue.GIVEN,
        "familiarity": SceneValue.MISSING,
        "mood": SceneValue.MISSING,
    }
    ros.until(lambda: system.auctions)
    assert [bid.distance for bid in system.auctions[0].ranking] == [0.5, 3.5]


def test_falling_mood_gives_feedback_and_changes_agent(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, wait="30 s", young=1.5, old=4.5))
    scene_id = system.analyze(age=5, familiarity=3, mood=4).scene.scene_id
    ros.until(lambda: any(run.event == Run.STARTED for run in system.runs))
    assert system.analyze(announce=False, mood=2).accepted
    ros.until(lambda: sum(run.event == Run.STARTED for run in system.runs) == 2)
    ros.until(lambda: len(system.auctions) == 2)
    first, second = system.auctions
    assert (first.winner, second.winner) == ("old", "young")
    assert second.follows == first.round
    ended = next(run for run in system.runs if run.event == Run.ENDED)
    assert ended.outcome == Run.CANCELLED
    ros.until(lambda: max(system.profiles[-1].revisions) == 1)
    assert not system.finished(scene_id)


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
    give = ros.node.create_client(GiveFeedback, "feedback/give")
    request = GiveFeedback.Request(agent="young", kind=0, values=[5.0, 5.0, 5.0])
    assert ros.call(give, request).accepted
    assert system.host.registry.members["young"].revision == 1
    assert second.registry.members["young"].revision == 0


def test_second_host_of_same_name_takes_no_goals(ros: Any, tmp_path: Path) -> None:
    trees = write_agents(tmp_path, wait="30 s", young=1.5)
    system = System(ros, trees)
    second = ros.add(active_host(system.folder))
    ros.until(lambda: second.registry.members["young"].refusal)
    assert not second.registered
    scene_id = system.analyze(age=1, familiarity=3, mood=3).scene.scene_id
    ros.until(lambda: any(run.event == Run.STARTED for run in system.runs))
    ros.turns(50)
    assert [run.event for run in system.runs] == [Run.STARTED]
    client = ros.node.create_client(CancelRun, "marketplace/cancel")
    assert ros.call(client, CancelRun.Request(reason="enough", by=Run.OPERATOR)).accepted
    ros.until(lambda: system.finished(scene_id))
    assert [(run.stopped_by, run.stop_reason) for run in system.runs[1:]] == [
        (Run.OPERATOR, "enough"), (Run.OPERATOR, "enough")
    ]  # fmt: skip
    assert system.host.stopped()
    assert second.stopped()
