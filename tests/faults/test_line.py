# SPDX-License-Identifier: Apache-2.0
"""Scenes in line when their host, their market, or both are away."""

from __future__ import annotations

from collections import Counter

import pytest

from bt_agents_interfaces.srv import Analyze
from bt_agents_tools.launcher import components
from marketplace_node.settings import Settings
from processes import BEATS_A_SECOND, NodeProcess, System, write_trees

pytestmark = pytest.mark.e2e

LINE = tuple(f"s{number}" for number in range(2, 12))


def market_and_host(system: System, **parameters: float) -> tuple[NodeProcess, NodeProcess]:
    trees = write_trees(system.folder / "leo", leo=(4.5, "say: leo speaks"))
    market = system.market(
        trees,
        scenes=str(system.folder / "state" / "scenes.json"),
        collect_deadline=0.05,
        bid_deadline=5.0,
        host_wait=50.0,
        **parameters,
    )
    host = system.host("agents", trees)
    system.until_ready(hosts=1, agents=1)
    return market, host


def fill_the_line(system: System) -> None:
    """Let one scene run, and ten wait."""
    system.old_person("s1")
    system.until_speaking("leo speaks")
    for name in LINE:
        system.old_person(name)
    system.until(lambda: system.statuses[-1].queued == len(LINE), "ten scenes wait")


def all_wait_for_the_host(system: System) -> bool:
    status = system.statuses[-1]
    return (status.awaited_hosts, status.queued) == (["/agents"], len(LINE))


@pytest.mark.parametrize("how", ["hangs", "is killed", "is terminated"])
def test_queued_scenes_survive_loss_of_their_only_host(system: System, how: str) -> None:
    _, host = market_and_host(system, host_lease=Settings().host_lease_s)
    fill_the_line(system)
    {"hangs": host.hang, "is killed": host.kill, "is terminated": host.terminate}[how]()
    system.until(lambda: all_wait_for_the_host(system), "all scenes in line wait for the host")
    if how == "hangs":
        host.go_on()
    else:
        system.until(lambda: host.ended, "the end of the host")
        host.start()
    system.say_server.let_go()
    system.until(lambda: all(system.ends_of(name) for name in LINE), "the end of every scene")
    assert [system.ends_of(name)[0].code for name in LINE] == ["SUCCEEDED"] * len(LINE)
    assert set(Counter(end.scene_id for end in system.ends).values()) == {1}
    last = system.started("leo")[-len(LINE) :]
    assert [run.scene.scene_id for run in last] == list(LINE), "in their order, and each once"
    [end] = system.ends_of("s1")
    assert end.code == ("CANCELLED" if how == "is terminated" else "LOST")


@pytest.mark.parametrize("both", [False, True], ids=["alone", "with its host"])
def test_queue_survives_killed_market(system: System, both: bool) -> None:
    market, host = market_and_host(system)
    fill_the_line(system)
    if both:
        host.kill()
    epoch = system.kill_market(market)
    market.start()
    if both:
        host.start()
    system.say_server.let_go()
    system.until_ready(hosts=1, agents=1, after=epoch)
    system.until(lambda: system.ends_of("s1"), "the end of the scene that was under way")
    [end] = system.ends_of("s1")
    assert end.epoch != epoch
    assert end.code == "LOST" if both else end.code in ("LOST", "SUCCEEDED")
    system.until(lambda: all(system.ends_of(name) for name in LINE), "the end of every scene")
    assert [system.ends_of(name)[0].code for name in LINE] == ["SUCCEEDED"] * len(LINE)
    assert set(Counter(end.scene_id for end in system.ends).values()) == {1}


def test_scenes_announced_without_market_reach_it_once(system: System) -> None:
    market, _ = market_and_host(system)
    system.start(components.scene_layer(system.folder / "leo"))
    analyze = system.ros.node.create_client(Analyze, "scene_layer/analyze")
    system.say_server.let_go()

    def announce(age: float) -> Analyze.Response:
        request = Analyze.Request(
            names=["age"], values=[age], person=Analyze.Request.PRESENT, announce=True
        )
        system.until(analyze.service_is_ready, "the scene layer is there")
        return system.ros.call(analyze, request)

    first = announce(4.0)
    assert first.accepted
    system.until_end_of(first.scene.scene_id)
    epoch = system.kill_market(market)
    # The first one is announced before the layer can know that the market is dead.
    unsure = announce(3.0)
    heartbeat_probe = system.heartbeat_probe("agents")
    system.until(
        lambda: heartbeat_probe.count > 3 * BEATS_A_SECOND, "the market is known to be away"
    )
    kept = [announce(age) for age in (2.0, 3.0, 4.0)]
    assert all(answer.kept for answer in kept)
    assert kept[0].message.startswith("no marketplace is there")
    market.start()
    system.until_ready(hosts=1, agents=1, after=epoch)
    ids = [answer.scene.scene_id for answer in (unsure, *kept)]
    system.until(lambda: all(system.ends_of(one) for one in ids), "the end of every scene")
    ended = Counter(e.scene_id for e in system.ends if e.code == "SUCCEEDED")
    assert [ended[one] for one in ids] == [1] * len(ids)
    assert {e.code for e in system.ends if e.scene_id in ids} <= {"SUCCEEDED", "DUPLICATE"}
