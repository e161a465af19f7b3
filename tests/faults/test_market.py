# SPDX-License-Identifier: Apache-2.0
"""Runs and their scenes when the process of the marketplace is killed."""

from __future__ import annotations

import os

import pytest

from bt_agents_interfaces.msg import MarketHeartbeat, Run
from bt_agents_ros import qos
from processes import BEATS_A_SECOND, NodeProcess, System, write_trees

pytestmark = pytest.mark.e2e


def market_and_hosts(system: System) -> NodeProcess:
    """Start a market, and leo and mira on a host each; leo suits a scene of age 5."""
    trees = {
        name: write_trees(system.folder / name, **{name: (age, f"say: {name} speaks")})
        for name, age in (("leo", 4.5), ("mira", 2.0))
    }
    market = system.market(trees["leo"], collect_deadline=0.05, bid_deadline=5.0)
    system.host("agents_a", trees["leo"])
    system.host("agents_b", trees["mira"])
    system.until_ready(hosts=2, agents=2)
    return market


def check_that_nothing_else_runs(system: System, epoch: str, starts: int) -> None:
    """Run one more scene in the new market, and count the starts there."""
    system.say_server.let_go()
    system.old_person("s2")
    assert system.until_end_of("s2").code == "SUCCEEDED"
    assert len(system.started(epoch=epoch)) == starts + 1
    assert len(system.ends_of("s1")) == 1


@pytest.mark.parametrize("restart", ["after the host has given up", "at once"])
def test_killed_market_ends_its_run_and_successor_retries(system: System, restart: str) -> None:
    market = market_and_hosts(system)
    heartbeat_probe = system.heartbeat_probe("agents_a")
    system.old_person("s1")
    system.until_speaking("leo speaks")
    epoch = system.kill_market(market)
    killed_at = heartbeat_probe.count
    if restart == "at once":
        market.start()
    first = system.say_server.goals[0]
    system.until(lambda: first.outcome, "the end of what leo says")
    assert first.outcome == "cancelled"
    assert heartbeat_probe.count - killed_at <= 4 * BEATS_A_SECOND
    if restart != "at once":
        market.start()
    system.until_ready(hosts=2, agents=2, after=epoch)
    new = system.epoch
    system.until(lambda: system.ends_of("s1"), "the end of the scene that was cut off")
    [end] = system.ends_of("s1")
    assert (end.epoch, end.code) == (new, "LOST")
    [cut_off] = system.ended(epoch=epoch) or system.ended("leo", epoch=new)[:1]
    assert cut_off.scene.scene_id == "s1"
    system.until(lambda: system.started(epoch=new), "the scene is run again")
    system.until_speaking("leo speaks")
    again = system.started(epoch=new)[0].scene.scene_id
    assert again != "s1"
    assert again in end.message
    check_that_nothing_else_runs(system, new, starts=1)
    assert system.until_end_of(again).code == "SUCCEEDED"
    assert system.say_server.texts == ["leo speaks"] * 3


def test_run_ending_without_market_is_not_repeated(system: System) -> None:
    market = market_and_hosts(system)
    heartbeat_probe = system.heartbeat_probe("agents_a")
    system.old_person("s1")
    system.until_speaking("leo speaks")
    system.until(lambda: heartbeat_probe.busy, "the host is busy")
    epoch = system.kill_market(market)
    system.say_server.finish()
    system.until(lambda: not heartbeat_probe.busy, "the run is over")
    market.start()
    system.until_ready(hosts=2, agents=2, after=epoch)
    end = system.until_end_of("s1")
    assert (end.code, end.agent) == ("SUCCEEDED", "leo")
    [ended] = system.ended("leo")
    assert (ended.outcome, ended.scene.scene_id) == (Run.SUCCEEDED, "s1")
    check_that_nothing_else_runs(system, system.epoch, starts=0)


def test_market_hanging_beyond_lease_loses_run_and_continues(system: System) -> None:
    market = market_and_hosts(system)
    heartbeat_probe = system.heartbeat_probe("agents_a")
    system.old_person("s1")
    system.until_speaking("leo speaks")
    system.until(lambda: system.started("leo"), "the start")
    market.hang()
    hung_at = heartbeat_probe.count
    first = system.say_server.goals[0]
    system.until(lambda: first.outcome, "the end of what leo says")
    assert first.outcome == "cancelled"
    assert heartbeat_probe.count - hung_at <= 4 * BEATS_A_SECOND
    market.go_on()
    system.until_end_of("s1")
    [ended] = system.ended("leo")
    assert ended.outcome in (Run.CANCELLED, Run.LOST)
    assert "silent" in ended.message
    system.until_ready(hosts=2, agents=2)
    system.say_server.let_go()
    system.old_person("s2")
    assert system.until_end_of("s2").code == "SUCCEEDED"
    assert len(system.ends_of("s1")) == 1


def test_second_market_is_refused_naming_first(system: System) -> None:
    trees = write_trees(system.folder / "trees", leo=(3.0, "wait: 0 s"))
    first = system.market(trees)
    system.until(lambda: system.epoch, "the first market")
    epoch = system.epoch
    second = system.market(trees)
    second.expect_end()
    system.until(lambda: second.exit_code is not None, "the end of the second market")
    assert second.exit_code == 1
    assert f"another marketplace is alive here: epoch '{epoch}'" in second.said
    assert "node /marketplace; end one of the two" in second.said
    assert first.exit_code is None


def test_market_replaced_during_hang_gives_way(system: System) -> None:
    trees = write_trees(system.folder / "trees", leo=(3.0, "wait: 0 s"))
    beats = system.ros.collect(MarketHeartbeat, "marketplace/heartbeat", qos.EVENTS)
    first = system.market(trees)
    system.until(lambda: beats, "the first market")
    first.hang()
    old = beats[-1]
    second = system.market(trees)

    def is_older() -> bool:
        return beats[-1].epoch != old.epoch and beats[-1].sequence > beats[0].sequence + 20

    system.until(is_older, "a second market that is the older one")
    epoch = beats[-1].epoch
    first.expect_end()
    first.go_on()
    system.until(lambda: first.exit_code is not None, "the end of the first market")
    assert first.exit_code == os.EX_CONFIG
    assert f"another marketplace is alive here: epoch '{epoch}', node /marketplace" in first.said
    assert second.exit_code is None
