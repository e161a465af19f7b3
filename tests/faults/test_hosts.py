# SPDX-License-Identifier: Apache-2.0
"""Host behaviour when its process is killed, hangs or runs twice."""

from __future__ import annotations

import time

import pytest

from bt_agents_interfaces.msg import Auction, Bids, MarketHeartbeat, Run, TreeStatus
from bt_agents_interfaces.srv import RegisterHost
from bt_agents_ros import qos
from market_node_harness import FakeHost
from marketplace_node.settings import Settings
from processes import BEATS_A_SECOND, NodeProcess, System, write_trees

pytestmark = pytest.mark.e2e

TREE = """
sequence:
  - say: {name} begins
  - say: {name} ends
"""
LEO, MIRA = 4.5, 2.0


def two_hosts(
    system: System, *, leo: str = TREE.format(name="leo"), bid_deadline: float = 5.0
) -> tuple[NodeProcess, NodeProcess]:
    """Start a market, leo on one host and mira on another; leo suits a scene of age 5."""
    first = write_trees(system.folder / "a", leo=(LEO, leo))
    second = write_trees(system.folder / "b", mira=(MIRA, TREE.format(name="mira")))
    system.market(
        first, collect_deadline=0.05, bid_deadline=bid_deadline, host_lease=Settings().host_lease_s
    )
    hosts = system.host("agents_a", first), system.host("agents_b", second)
    system.until_ready(hosts=2, agents=2)
    return hosts


def silent_host(system: System) -> FakeHost:
    """Register a host that keeps each round open, so that a fault comes before the goal."""
    host: FakeHost = system.ros.add(FakeHost("silent", nobody=(1.0, 3.0, 3.0)))
    host.silent, host.distort = True, decline
    market = system.ros.node.create_client(
        RegisterHost, "marketplace/register", qos_profile=qos.SERVICE
    )
    host.take(system.ros.call(market, host.request()))
    system.until(lambda: host.answers.get_subscription_count() > 1, "its bids are heard")
    return host


def decline(answer: Bids) -> None:
    answer.agents, answer.agent_ids, answer.vectors = [], [], []
    answer.declined, answer.decline_reasons = ["nobody"], ["it was told to"]


def close_round(system: System, silent: FakeHost, number: int) -> None:
    """Let the silent host answer a round, for which it does not bid."""
    system.until(lambda: silent.calls and silent.calls[-1].round == number, "its call for bids")
    silent.silent = False
    silent.answer(silent.calls[-1])
    silent.silent = True


@pytest.mark.parametrize("fault", ["killed", "hung"])
def test_lost_host_is_replaced_by_next_agent_quickly(system: System, fault: str) -> None:
    host, _ = two_hosts(system)
    heartbeat_probe = system.heartbeat_probe("agents_b")
    system.old_person("s1")
    system.until_speaking("leo begins")
    if fault == "killed":
        host.kill()
    else:
        host.hang()
    beats = heartbeat_probe.count
    system.until(lambda: system.ended("leo"), "the end of leo's run")
    assert heartbeat_probe.count - beats <= 2 * BEATS_A_SECOND
    lost = system.ended("leo")[0]
    assert lost.outcome == Run.LOST
    assert "/agents_a is gone: no heartbeat" in lost.message
    system.until(lambda: system.started("mira"), "mira's start")
    system.until(lambda: len(system.auctions) == 2, "the second auction")
    second = system.auctions[-1]
    assert (second.follows, second.winner) == (lost.round, "mira")
    system.until(lambda: "mira begins" in system.say_server.speaking, "mira speaks")
    system.say_server.let_go()
    end = system.until_end_of("s1")
    assert (end.code, end.agent) == ("SUCCEEDED", "mira")
    assert [run.agent for run in system.started()] == ["leo", "mira"]


@pytest.mark.parametrize("sentence", ["under way", "over"])
def test_resumed_host_stops_its_tree_without_speaking(system: System, sentence: str) -> None:
    host, _ = two_hosts(system)
    first = system.heartbeat_probe("agents_a")
    system.old_person("s1")
    system.until_speaking("leo begins")
    host.hang()
    if sentence == "over":
        system.say_server.finish()
    system.until(lambda: "mira begins" in system.say_server.speaking, "mira speaks")
    beats = first.count
    host.go_on()
    system.until(lambda: first.count > beats and not first.busy, "leo's host is idle")
    assert system.say_server.texts == ["leo begins", "mira begins"]
    outcome = "succeeded" if sentence == "over" else "cancelled"
    assert system.say_server.goals[0].outcome == outcome
    assert system.say_server.speaking == ["mira begins"]
    system.say_server.let_go()
    assert system.until_end_of("s1").code == "SUCCEEDED"
    assert system.say_server.texts == ["leo begins", "mira begins", "mira ends"]
    system.old_person("s2")
    assert system.until_end_of("s2").agent == "leo"


def test_resumed_host_does_not_act_on_expired_wait(system: System) -> None:
    wait_s = 3.0  # A busy machine takes some time to suspend the host.
    tree = f"sequence: [say: leo begins, wait: {wait_s:g} s, say: leo ends]"
    host, _ = two_hosts(system, leo=tree)
    first = system.heartbeat_probe("agents_a")
    statuses = system.ros.collect(TreeStatus, "agents_a/status", qos.EVENTS)
    system.old_person("s1")
    system.until_speaking("leo begins")
    system.say_server.finish()
    system.until(
        lambda: any("wait" in change.path for status in statuses for change in status.changes),
        "leo waits",
    )
    host.hang()
    expires = time.monotonic() + wait_s
    system.until_speaking("mira begins")
    system.until(lambda: time.monotonic() > expires, "the end of leo's wait")
    beats = first.count
    host.go_on()
    system.until(lambda: first.count > beats + 2 and not first.busy, "leo's host is idle")
    assert system.say_server.texts == ["leo begins", "mira begins"]


def test_host_hanging_after_its_bid_loses_run(system: System) -> None:
    host, _ = two_hosts(system, bid_deadline=1.0)
    silent = silent_host(system)
    first, second = system.heartbeat_probe("agents_a"), system.heartbeat_probe("agents_b")
    hung = 0
    for number in range(1, 41):
        system.until_ready(hosts=3, agents=3)
        scene_id = f"s{number}"
        system.old_person(scene_id)
        system.until(
            lambda n=number: system.has_bid("/agents_a", n), f"the bid of leo in round {number}"
        )
        host.hang()
        hung_at = second.count
        close_round(system, silent, number)
        system.until(lambda n=number: len(system.started()) == n, f"start {number}")
        assert second.count - hung_at <= 2 * BEATS_A_SECOND
        assert (system.started()[-1].agent, system.started()[-1].round) == ("mira", number)
        system.until_speaking("mira begins")
        said, beats = len(system.say_server.texts), first.count
        host.go_on()
        system.until(
            lambda n=beats: first.count > n + 2 and not first.busy, "leo's host beats and is idle"
        )
        for text in ("mira begins", "mira ends"):
            system.until_speaking(text)
            system.say_server.finish()
        assert system.until_end_of(scene_id).agent == "mira"
        assert system.say_server.texts[said:] == ["mira ends"]
        # The hang may come when the probe has received the bid but the market has not.
        hung += system.auctions[-1].winner == "leo"
        if hung == 20:
            return
    pytest.fail("the market did not hear the bid of leo in half of the rounds")


def test_next_best_replaces_host_killed_after_bid(system: System) -> None:
    host, _ = two_hosts(system, bid_deadline=2.0)
    silent = silent_host(system)
    system.until_ready(hosts=3, agents=3)
    heartbeat_probe = system.heartbeat_probe("agents_b")
    beats = system.ros.collect(MarketHeartbeat, "/marketplace/heartbeat", qos.EVENTS)
    system.old_person("s1")
    system.until(lambda: system.has_bid("/agents_a", 1), "the bid of leo")
    # The market has the bid two spins of its executor after the probe.
    seen = len(beats)
    system.until(lambda: len(beats) > seen + 1, "two heartbeats of the market")
    host.kill()
    killed_at = heartbeat_probe.count
    close_round(system, silent, 1)
    system.until(system.started, "a start")
    assert heartbeat_probe.count - killed_at <= 2 * BEATS_A_SECOND
    assert [run.agent for run in system.started()] == ["mira"]
    refused = [run for run in system.runs if run.event == Run.REFUSED]
    assert [(run.agent, run.message) for run in refused] == [
        ("leo", "/agents_a is gone: no heartbeat")
    ]
    system.say_server.let_go()
    assert system.until_end_of("s1").code == "SUCCEEDED"
    host.start()
    system.until_ready(hosts=3, agents=3)
    system.old_person("s2")
    assert system.until_end_of("s2").agent == "leo"


def test_round_with_silent_host_closes_at_deadline(system: System) -> None:
    names = [f"agents_{number}" for number in range(1, 6)]
    folders = {
        name: write_trees(
            system.folder / name, **{f"guide_{name[-1]}": (float(name[-1]), "wait: 0 s")}
        )
        for name in names
    }
    # The lease outlasts the round, so the silent host still gets a call.
    system.market(folders["agents_1"], bid_deadline=2.0, host_lease=5.0)
    hosts = {name: system.host(name, trees) for name, trees in folders.items()}
    system.until_ready(hosts=5, agents=5)
    hosts["agents_5"].hang()
    system.old_person("s1")
    system.until(lambda: system.auctions, "the decision")
    [auction] = system.auctions
    assert auction.closed_by == Auction.DEADLINE
    assert auction.duration_s >= 2.0
    assert auction.silent_hosts == ["/agents_5"], system.told()
    assert [bid.agent for bid in auction.ranking] == ["guide_4", "guide_3", "guide_2", "guide_1"]
    end = system.until_end_of("s1")
    assert (end.code, end.agent) == ("SUCCEEDED", "guide_4")


def test_only_one_of_two_host_processes_ever_runs(system: System) -> None:
    trees = write_trees(system.folder / "a", leo=(LEO, "say: leo speaks"))
    system.say_server.let_go()
    # The second one may take over when the lease of the first one ends.
    system.market(trees, collect_deadline=0.05, queue_limit=100, host_lease=5.0)
    first = system.host("agents", trees)
    system.until_ready(hosts=1, agents=1)
    heartbeat_probe = system.heartbeat_probe("agents")
    second = system.host("agents", trees)
    system.until(lambda: "HOST_EXISTS" in second.said, "the refusal of the second")
    ids = [f"s{number}" for number in range(1, 101)]
    for scene_id in ids:
        system.old_person(scene_id)
    system.until(lambda: len(system.ends) >= 100, "a hundred ends")
    assert [end.message for end in system.ends if end.code != "SUCCEEDED"] == []
    assert sorted(end.scene_id for end in system.ends) == sorted(ids)
    assert len(system.say_server.texts) == 100
    starts = system.started()
    assert len(starts) == 100
    assert len({run.host_instance for run in starts}) == 1
    first.kill()
    seen = heartbeat_probe.count

    def is_registered() -> bool:
        """Whether the second one has the token of its registration."""
        beats = heartbeat_probe.beats[seen:]
        return any(b.host_instance != starts[0].host_instance and any(b.token) for b in beats)

    system.until(is_registered, "the registration of the second one")
    system.old_person("after")
    assert system.until_end_of("after").code == "SUCCEEDED"
    assert len(system.say_server.texts) == 101
    assert system.started()[-1].host_instance != starts[0].host_instance
