# SPDX-License-Identifier: Apache-2.0
"""Which goals of the robot have lost their host."""

from __future__ import annotations

import pytest

from bt_agents_robot.host_watch import MOST_HOSTS, HostWatch

FIRST, SECOND = b"1" * 16, b"2" * 16


class Watched:
    """A watch whose clock is turned by hand, polled as often as the robot does."""

    def __init__(self) -> None:
        self.now = 10.0
        self.watch = HostWatch(1.0, self.now)
        self.lost: dict[bytes, str] = {}

    def open(self, *goals: bytes, host: str = "/agents", instance: str = "first") -> None:
        self.watch.on_open_goals(host, instance, goals, self.now)

    def wait(self, seconds: float, *beating: str, instance: str = "first") -> None:
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            for host in beating:
                self.watch.on_heartbeat(host, instance, self.now)
            self.lost |= self.watch.lost(self.now)


@pytest.fixture
def hosts() -> Watched:
    return Watched()


def test_goals_of_a_host_that_beats_go_on(hosts: Watched):
    hosts.open(FIRST)
    hosts.wait(30.0, "/agents")
    assert hosts.lost == {}


def test_goals_of_a_host_that_is_silent_for_longer_than_its_lease_are_lost(hosts: Watched):
    hosts.open(FIRST, SECOND)
    hosts.wait(3.0, "/agents")
    hosts.wait(0.8)
    assert hosts.lost == {}
    hosts.wait(0.3)
    reason = "its host /agents has been silent for 1.0 s"
    assert set(hosts.lost) == {FIRST, SECOND}
    assert hosts.lost[FIRST].startswith(reason[:-5])


def test_a_goal_that_has_ended_is_not_lost(hosts: Watched):
    hosts.open(FIRST, SECOND)
    hosts.open(SECOND)
    hosts.wait(2.0)
    assert set(hosts.lost) == {SECOND}


def test_the_heartbeat_of_another_start_keeps_nothing_alive(hosts: Watched):
    hosts.open(FIRST)
    hosts.wait(2.0, "/agents", instance="second")
    assert set(hosts.lost) == {FIRST}


def test_a_new_start_of_a_host_loses_the_goals_of_the_one_before_at_once(hosts: Watched):
    hosts.open(FIRST)
    hosts.open(instance="second")
    hosts.wait(0.1, "/agents", instance="second")
    assert hosts.lost == {FIRST: "its host was started anew"}


def test_one_host_says_nothing_about_the_goals_of_another(hosts: Watched):
    hosts.open(FIRST, host="/a")
    hosts.open(SECOND, host="/b")
    hosts.wait(2.0, "/a")
    assert set(hosts.lost) == {SECOND}


def test_a_robot_that_was_held_up_itself_reads_what_has_come_before_it_decides(hosts: Watched):
    hosts.open(FIRST)
    hosts.wait(1.0, "/agents")
    hosts.now += 20.0
    hosts.lost |= hosts.watch.lost(hosts.now)
    assert hosts.lost == {}
    hosts.wait(1.0, "/agents")
    assert hosts.lost == {}
    hosts.wait(2.0)
    assert set(hosts.lost) == {FIRST}


def test_hosts_are_bounded_and_those_that_are_gone_make_room(hosts: Watched):
    names = [f"/h{number}" for number in range(MOST_HOSTS)]
    for name in names:
        hosts.open(FIRST, host=name)
    hosts.open(SECOND, host="/late")
    assert set(hosts.watch.hosts) == set(names)
    hosts.wait(2.0, *names[1:])
    hosts.open(SECOND, host="/late")
    assert set(hosts.watch.hosts) == {*names[1:], "/late"}
