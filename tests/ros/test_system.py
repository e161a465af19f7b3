# SPDX-License-Identifier: Apache-2.0
"""The whole system in one process: all parts real, and hostile input on every interface."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from active_nodes import active_host, active_market
from bt_agents_interfaces.msg import Bids, HostCard, Run, Scene, SceneValue
from bt_agents_interfaces.srv import Analyze, CancelRun, GiveFeedback, RegisterHost, SetProfile
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros import qos
from bt_agents_ros.installed import InstalledInterfaces
from whole_system import System, write_agents

pytestmark = pytest.mark.ros

NAN, INF = math.nan, math.inf


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


def test_refused_agent_appears_on_no_card(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5))
    other = write_agents(tmp_path, young=5.0, other=5.0)
    second = ros.add(
        active_host(
            read_trees(other, InstalledInterfaces()), cli_args=["--ros-args", "-r", "__node:=b"]
        )
    )
    ros.until(lambda: second.registry.members["other"].agent_id)
    ros.until(lambda: "other" in system.profiles[-1].agents)
    give = ros.node.create_client(GiveFeedback, "feedback/give")
    request = GiveFeedback.Request(agent="young", kind=0, values=[5.0, 5.0, 5.0])
    assert ros.call(give, request).accepted
    assert system.host.registry.members["young"].revision == 1
    assert second.registry.members["young"].revision == 0


def test_restarted_market_ends_run_of_its_predecessor(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, wait="30 s", young=1.5))
    system.analyze(age=1, familiarity=3, mood=3)
    ros.until(lambda: any(run.event == Run.STARTED for run in system.runs))
    ros.remove(system.market)
    assert not system.host.stopped()
    ros.add(active_market(system.folder.scene.space, "epoch-2"))
    ros.until(system.host.stopped)
    told = system.statuses
    ros.until(lambda: told and (told[-1].epoch, told[-1].agents) == ("epoch-2", 1))


def test_restarted_market_finds_its_hosts(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5))
    ros.remove(system.market)
    ros.add(active_market(system.folder.scene.space, "epoch-2"))
    told = system.statuses
    ros.until(lambda: told and (told[-1].epoch, told[-1].agents) == ("epoch-2", 1))
    assert system.interact(age=5, familiarity=3, mood=3) == "young"


def test_parameters_have_descriptions_and_bad_ones_are_refused(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5))
    for node, name in (
        (system.market, "bid_deadline"),
        (system.market, "strategy"),
        (system.market, "on_new_scene"),
        (system.market, "tie_break"),
        (system.scene_layer, "live_rate"),
        (system.host, "tick_rate"),
    ):
        assert node.describe_parameter(name).description
    for node, name, value in (
        (system.market, "bid_deadline", NAN),
        (system.market, "strategy", "coin"),
        (system.market, "on_new_scene", "panic"),
        (system.scene_layer, "live_rate", 0.0),
        (system.host, "tick_rate", 1e9),
    ):
        assert not node.set_parameters([Parameter(name, value=value)])[0].successful


def scene_message(*values: float, scene_id: str = "x") -> Scene:
    names = ["age", "familiarity", "mood", "more"]
    return Scene(
        scene_id=scene_id,
        person=True,
        values=[
            SceneValue(name=name, value=float(value), origin=SceneValue.GIVEN)
            for name, value in zip(names, values, strict=False)
        ],
    )


BAD_VECTORS = ([NAN, 3, 3], [INF, 3, 3], [], [3], [3, 3, 3, 3], [3, 3, 99])


def test_bad_vectors_are_refused_at_every_interface(ros: Any, tmp_path: Path) -> None:
    system = System(ros, write_agents(tmp_path, young=1.5))
    node = ros.node
    scenes = node.create_publisher(Scene, "bt_agents/scene", qos.FACT)
    live = node.create_publisher(Scene, "bt_agents/scene/live", qos.SENSOR)
    bids = node.create_publisher(Bids, "bt_agents/bids", qos.EVENTS)
    cards = node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
    for publisher in (scenes, live, bids, cards):
        ros.until(lambda p=publisher: p.get_subscription_count() > 0)
    give = node.create_client(GiveFeedback, "feedback/give")
    set_profile = node.create_client(SetProfile, "agents/set_profile")
    register = node.create_client(RegisterHost, "marketplace/register")
    for vector in BAD_VECTORS:
        values = [float(value) for value in vector]
        scenes.publish(scene_message(*values))
        live.publish(scene_message(*values))
        bids.publish(
            Bids(
                epoch="epoch",
                round=1,
                host="/agents",
                host_instance=system.host.instance,
                agents=["young"],
                agent_ids=[1],
                vectors=values,
            )
        )
        # NaN is "no opinion" in direct feedback, and only there.
        wanted = [NAN, NAN, NAN] if any(math.isnan(v) for v in values) else values
        given = ros.call(give, GiveFeedback.Request(agent="young", kind=0, values=wanted))
        assert not given.accepted
        assert given.code in ("NO_OPINION", "NOT_FINITE", "WRONG_LENGTH", "OUT_OF_RANGE")
        kept = ros.call(set_profile, SetProfile.Request(agent="young", values=values, revision=9))
        assert not kept.accepted
        assert kept.code in ("NOT_FINITE", "WRONG_LENGTH", "OUT_OF_RANGE")
    cards.publish(HostCard(host="/evil", parameters=["x"]))
    assert not ros.call(register, RegisterHost.Request(host="/evil", parameters=["x"])).accepted
    for values in ({"age": NAN}, {"age": INF}, {"age": 99}, {"size": 1}):
        answer = system.analyze(**values)
        assert not answer.accepted
        assert answer.code
    ros.turns()
    assert system.auctions == []
    assert system.interact(age=1, familiarity=3, mood=3) == "young"
