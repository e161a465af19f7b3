# SPDX-License-Identifier: Apache-2.0
"""Watches: which goals of the robot have lost their host, or the screen that they need."""

from __future__ import annotations

import pytest

from bt_agents_robot.watches import FIRST_PAGE_S, LEASE_S, MOST_HOSTS, HostWatch, ScreenWatch

FIRST, SECOND = b"1" * 16, b"2" * 16


class Watched:
    """A watch on a manual clock, polled as often as by the robot."""

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


def test_silence_beyond_lease_loses_goals_of_host(hosts: Watched):
    hosts.open(FIRST, SECOND)
    hosts.wait(3.0, "/agents")
    hosts.wait(0.8)
    assert hosts.lost == {}
    hosts.wait(0.3)
    reason = "its host /agents has been silent for 1.0 s"
    assert set(hosts.lost) == {FIRST, SECOND}
    assert hosts.lost[FIRST].startswith(reason[:-5])


def test_ended_goal_is_not_lost(hosts: Watched):
    hosts.open(FIRST, SECOND)
    hosts.open(SECOND)
    hosts.wait(2.0)
    assert set(hosts.lost) == {SECOND}


def test_heartbeat_of_another_instance_keeps_nothing_alive(hosts: Watched):
    hosts.open(FIRST)
    hosts.wait(2.0, "/agents", instance="second")
    assert set(hosts.lost) == {FIRST}


def test_restarted_host_loses_its_earlier_goals_immediately(hosts: Watched):
    hosts.open(FIRST)
    hosts.open(instance="second")
    hosts.wait(0.1, "/agents", instance="second")
    assert hosts.lost == {FIRST: "its host was started anew"}


def test_heartbeat_does_not_cover_goals_of_other_hosts(hosts: Watched):
    hosts.open(FIRST, host="/a")
    hosts.open(SECOND, host="/b")
    hosts.wait(2.0, "/a")
    assert set(hosts.lost) == {SECOND}


def test_stalled_robot_reads_queued_heartbeats_before_deciding(hosts: Watched):
    hosts.open(FIRST)
    hosts.wait(1.0, "/agents")
    hosts.now += 20.0
    hosts.lost |= hosts.watch.lost(hosts.now)
    assert hosts.lost == {}
    hosts.wait(1.0, "/agents")
    assert hosts.lost == {}
    hosts.wait(2.0)
    assert set(hosts.lost) == {FIRST}


def test_watched_hosts_are_bounded_and_lost_ones_evicted(hosts: Watched):
    names = [f"/h{number}" for number in range(MOST_HOSTS)]
    for name in names:
        hosts.open(FIRST, host=name)
    hosts.open(SECOND, host="/late")
    assert set(hosts.watch.hosts) == set(names)
    hosts.wait(2.0, *names[1:])
    hosts.open(SECOND, host="/late")
    assert set(hosts.watch.hosts) == {*names[1:], "/late"}


POLL_S = 0.2
"""Period of the robot's heartbeats [s]."""

LIMIT_S = 2.0
"""Time within which the goals of a closed page end [s]."""


class WatchedScreen:
    """A watch on a manual clock, polled as often as by the robot."""

    def __init__(self) -> None:
        self.now = 10.0
        self.watch = ScreenWatch(self.now)

    def wait(self, seconds: float, *, is_open: bool = False) -> bool:
        """Let time pass with an open or closed page; return whether it ever counted as gone."""
        was_gone = False
        for _ in range(round(seconds / POLL_S)):
            self.now += POLL_S
            if is_open:
                self.watch.on_heartbeat(self.now)
            was_gone |= self.watch.is_gone(self.now)
        return was_gone


@pytest.fixture
def screen() -> WatchedScreen:
    return WatchedScreen()


def test_closed_page_is_gone_within_two_seconds(screen: WatchedScreen) -> None:
    screen.wait(5.0, is_open=True)
    assert not screen.wait(LEASE_S - POLL_S)
    assert screen.wait(LIMIT_S - LEASE_S)


def test_reloaded_page_is_not_gone(screen: WatchedScreen) -> None:
    screen.wait(5.0, is_open=True)
    assert not screen.wait(LEASE_S - POLL_S)
    assert not screen.wait(5.0, is_open=True)


def test_first_goal_waits_for_first_page(screen: WatchedScreen) -> None:
    assert not screen.wait(60.0), "nothing needs it yet"
    screen.watch.on_goal(screen.now)
    assert not screen.wait(FIRST_PAGE_S - POLL_S)
    assert not screen.watch.was_seen
    assert not screen.wait(5.0, is_open=True)
    assert screen.watch.was_seen


def test_wait_for_first_page_ends(screen: WatchedScreen) -> None:
    screen.watch.on_goal(screen.now)
    assert screen.wait(FIRST_PAGE_S + POLL_S)
    screen.watch.on_goal(screen.now)
    assert screen.watch.is_gone(screen.now), "a later goal does not wait again"


def test_page_opened_too_late_serves_later_goals(screen: WatchedScreen) -> None:
    screen.watch.on_goal(screen.now)
    assert screen.wait(2 * FIRST_PAGE_S)
    assert not screen.wait(5.0, is_open=True)


def test_goal_after_closed_page_does_not_wait(screen: WatchedScreen) -> None:
    screen.wait(5.0, is_open=True)
    screen.wait(LIMIT_S)
    screen.watch.on_goal(screen.now)
    assert screen.watch.is_gone(screen.now)


def test_stalled_robot_reads_heartbeats_of_page_before_deciding(screen: WatchedScreen) -> None:
    screen.wait(5.0, is_open=True)
    screen.now += 20.0
    assert not screen.watch.is_gone(screen.now)
    assert screen.wait(LEASE_S), "nothing was queued"
