# SPDX-License-Identifier: Apache-2.0
"""Open goals of a killed host: they end before another agent acts."""

from __future__ import annotations

import itertools
import os
import random
import shutil
from collections.abc import Sequence
from typing import Any

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray

from bt_agents_interfaces.msg import MarketStatus, OpenGoals, Run
from bt_agents_ros import qos
from bt_agents_tools.launcher import components
from marketplace_node.settings import Settings
from processes import BEATS_A_SECOND, HeartbeatProbe, NodeProcess, System, write_trees
from tree_harness import TREES

pytestmark = pytest.mark.e2e

LEO, MIRA = 4.5, 2.0
LIMITS: dict[str, float] = {
    "collect_deadline": 0.05,
    "bid_deadline": 5.0,
    "host_lease": Settings().host_lease_s,
}
KILLS = int(os.environ.get("BT_AGENTS_KILLS", "4"))
"""Number of kills of a host at random moments."""

UNDER_WAY = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


def two_hosts(
    system: System, **parameters: float | str
) -> tuple[NodeProcess, NodeProcess, NodeProcess]:
    """Start a market and two hosts with a file each; return them. Leo suits a scene of age 5."""
    first = write_trees(system.folder / "a", leo=(LEO, "say: leo speaks"))
    second = write_trees(system.folder / "b", mira=(MIRA, "say: mira speaks"))
    market = system.market(first, **{**LIMITS, **parameters})
    hosts = (
        system.host("agents_a", first, system.folder / "a" / "open-goals"),
        system.host("agents_b", second, system.folder / "b" / "open-goals"),
    )
    system.until_ready(hosts=2, agents=2)
    return market, *hosts


def test_next_agent_waits_for_killed_hosts_sentence(system: System) -> None:
    _, host, _ = two_hosts(system)
    system.old_person("s1")
    system.until_speaking("leo speaks")
    host.kill()
    system.until(lambda: "mira speaks" in system.say_server.speaking, "mira speaks")
    system.until(lambda: system.started("mira"), "the news of mira's start")
    leo, _ = system.say_server.goals
    assert (leo.outcome, system.say_server.beside[1]) == ("cancelled", [])
    [lost] = system.ended("leo")
    assert (lost.outcome, list(lost.orphans)) == (Run.LOST, ["tree"])
    assert system.started("mira")[0].message == "the host took the run"
    system.say_server.finish()
    assert system.until_end_of("s1").code == "SUCCEEDED"


@pytest.mark.parametrize("server", ["refuses", "hangs"])
def test_next_run_reports_goals_that_did_not_stop(system: System, server: str) -> None:
    # Long enough to see, on a busy machine, that the market waits.
    _, host, _ = two_hosts(system, takeover_deadline=3.0)
    heartbeat_probe = system.heartbeat_probe("agents_b")
    system.say_server.script.on_cancel = server
    system.old_person("s1")
    system.until_speaking("leo speaks")
    host.kill()
    system.until(lambda: system.ended("leo"), "leo is lost")
    lost_at = heartbeat_probe.count
    waiting = "goals of /agents_a are being cancelled: /say (tree)"
    system.until(
        lambda: any(waiting in status.message for status in system.statuses), "the market waits"
    )
    assert system.say_server.texts == ["leo speaks"]
    system.until(lambda: system.started("mira"), "mira's start")
    assert BEATS_A_SECOND // 2 <= heartbeat_probe.count - lost_at <= 10 * BEATS_A_SECOND
    unconfirmed = "not confirmed to have ended: /say (tree) of /agents_a"
    assert unconfirmed in system.started("mira")[0].message
    system.until(
        lambda: any(
            status.message == f"mira is running; {unconfirmed}" for status in system.statuses
        ),
        "the status says so",
    )
    if server == "refuses":
        system.until_speaking("leo speaks", "mira speaks")


def test_restarted_host_ends_its_open_goals_without_market(system: System) -> None:
    market, host, _ = two_hosts(system)
    system.old_person("s1")
    system.until_speaking("leo speaks")
    host.kill()
    epoch = system.kill_market(market)
    assert system.say_server.speaking == ["leo speaks"]
    host.start()
    system.until_speaking()
    assert system.say_server.goals[0].outcome == "cancelled"
    market.start()
    system.until_ready(hosts=2, agents=2, after=epoch)
    system.old_person("s2")
    system.until_speaking("leo speaks")
    assert system.say_server.beside[-1] == []


def test_restarted_market_ends_dead_hosts_goals_first(system: System) -> None:
    scenes = system.folder / "scenes.json"
    market, host, _ = two_hosts(system, scenes=str(scenes))
    system.old_person("s1")
    system.until_speaking("leo speaks")
    system.until(lambda: '"/say"' in scenes.read_text(), "the market has stored what is open")
    host.kill()
    epoch = system.kill_market(market)
    assert system.say_server.speaking == ["leo speaks"]
    market.start()
    system.until_ready(hosts=1, agents=1, after=epoch)
    system.scene("s2", age=1, familiarity=3, mood=3)
    system.until(lambda: "mira speaks" in system.say_server.speaking, "mira speaks")
    leo, _ = system.say_server.goals
    assert (leo.outcome, system.say_server.beside[1]) == ("cancelled", [])


@pytest.mark.parametrize("server", ["stops", "refuses"])
def test_restarted_host_settles_open_goals_before_registering(system: System, server: str) -> None:
    _, host, _ = two_hosts(system, takeover_deadline=0.5)
    heartbeat_probe = system.heartbeat_probe("agents_a")
    system.say_server.script.on_cancel = server
    system.old_person("s1")
    system.until_speaking("leo speaks")
    host.kill()
    system.until(lambda: system.ended("leo"), "leo is lost")
    system.until(lambda: system.statuses[-1].hosts == 1, "one host is left")
    before = heartbeat_probe.count
    host.start()
    system.until(lambda: system.statuses[-1].hosts == 2, "it is registered again")
    # It publishes heartbeats while it waits.
    waited = heartbeat_probe.count - before
    assert waited <= 15 * BEATS_A_SECOND
    if server == "refuses":
        assert waited >= BEATS_A_SECOND // 2
        assert "their servers have not confirmed their end: /say (tree)" in host.said


def test_second_host_process_leaves_goals_of_first_alone(system: System) -> None:
    two_hosts(system)
    system.old_person("s1")
    system.until_speaking("leo speaks")
    second = system.host("agents_a", system.folder / "a", system.folder / "a" / "open-goals")
    system.until(lambda: "HOST_EXISTS" in second.said, "the refusal of the second")
    assert "open-goals cannot be used" in second.said
    assert system.say_server.speaking == ["leo speaks"]


def drivers(system: System) -> tuple[dict[str, NodeProcess], NodeProcess, Any]:
    """Start two hosts whose agents drive the simulated robot; return all, and its acts."""
    folders = {}
    for name, agent, age in (("agents_a", "leo", LEO), ("agents_b", "mira", MIRA)):
        folders[name] = write_trees(system.folder / name, **{agent: (age, f"drive: to {agent}")})
        shutil.rmtree(folders[name] / "skills")
        shutil.copytree(TREES / "skills", folders[name] / "skills")
    nodes = {"market": system.market(folders["agents_a"], **LIMITS)}
    robot = system.start(components.robot("off"))
    for name, trees in folders.items():
        nodes[name] = system.host(name, trees, trees / "open-goals")
    states: list[GoalStatusArray] = system.ros.collect(
        GoalStatusArray, "drive/_action/status", qos.FACTS
    )
    system.until_ready(hosts=2, agents=2)
    return nodes, robot, states


def until_driving(system: System, pulses: Sequence[HeartbeatProbe], name: str, age: float) -> Run:
    """Send scenes to the market until it accepts one; return the start of its run."""
    begun, asked = len(system.started()), itertools.count()
    due = 0

    def started() -> bool:
        nonlocal due
        beats = sum(heartbeat_probe.count for heartbeat_probe in pulses)
        # The probe may not be matched with a new market yet.
        if beats >= due and system.statuses[-1].state == MarketStatus.IDLE:
            due = beats + 2 * BEATS_A_SECOND
            system.scene(f"{name}.{next(asked)}", age=age, familiarity=3, mood=3)
        return len(system.started()) > begun

    system.until(started, f"a start for scene {name}")
    return system.started()[begun]


def until_idle(system: System, after: str) -> None:
    """Wait for a market other than ``after`` that has both hosts and is idle."""

    def idle() -> bool:
        last = system.statuses[-1]
        return (last.hosts, last.state) == (2, MarketStatus.IDLE) and last.epoch != after

    system.until(idle, "an idle market with both hosts")


def test_random_kills_never_cause_two_simultaneous_drives(system: System) -> None:
    nodes, robot, states = drivers(system)
    pulses = system.heartbeat_probe("agents_a"), system.heartbeat_probe("agents_b")
    luck = random.Random(KILLS)
    hosts_of = {"leo": nodes["agents_a"], "mira": nodes["agents_b"]}
    for number in range(KILLS):
        run = until_driving(system, pulses, f"s{number}", luck.choice([5.0, 1.0]))
        # From before the goal reaches the robot to near the end of the drive, which takes 3 s.
        system.ros.turns(luck.randrange(60))
        host, both = hosts_of[run.agent], luck.random() < 0.3
        host.kill()
        if both:
            nodes["market"].kill()
            nodes["market"].start()
        else:
            system.until(
                lambda run=run: any(
                    (one.epoch, one.round) == (run.epoch, run.round) for one in system.ended()
                ),
                "the run is lost",
            )
        host.start()
        until_idle(system, after=run.epoch if both else "")
    driven = {
        bytes(one.goal_info.goal_id.uuid) for message in states for one in message.status_list
    }
    assert len(driven) > KILLS // 3
    together = [
        message
        for message in states
        if sum(one.status in UNDER_WAY for one in message.status_list) > 1
    ]
    assert together == []
    assert "the robot is driving" not in robot.said
    print(f"{KILLS} kills, {len(driven)} drives, {len(system.started())} runs, no overlap")


def test_host_publishes_open_goals_before_sending_them(system: System) -> None:
    said: list[OpenGoals] = system.ros.collect(OpenGoals, "bt_agents/open_goals", qos.FACTS)
    two_hosts(system)
    system.old_person("s1")
    system.until_speaking("leo speaks")
    system.say_server.finish()
    system.until_end_of("s1")
    of_leo: list[OpenGoals] = []

    def told() -> bool:
        of_leo[:] = [message for message in said if message.host == "/agents_a"]
        return len(of_leo) > 1 and not of_leo[-1].goals

    system.until(told, "leo's host has nothing open")
    [named] = [message for message in of_leo if message.goals]
    [goal] = named.goals
    [sentence] = system.say_server.goals
    assert bytes(goal.goal_id) == bytes(sentence.handle.goal_id.uuid)
    assert (goal.path, goal.action) == ("tree", "/say")
    assert named.heartbeat == "/agents_a/heartbeat"
    assert (named.epoch, named.round) == (system.epoch, 1)
