# SPDX-License-Identifier: Apache-2.0
"""Screen watch: whether a page Person serves as the robot's screen."""

from __future__ import annotations

import pytest

from bt_agents_robot.screen_watch import FIRST_PAGE_S, LEASE_S, ScreenWatch

POLL_S = 0.2
"""Period of the robot's heartbeats [s]."""

LIMIT_S = 2.0
"""Time within which the goals of a closed page end [s]."""


class Watched:
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
def screen() -> Watched:
    return Watched()


def test_closed_page_is_gone_within_two_seconds(screen: Watched) -> None:
    screen.wait(5.0, is_open=True)
    assert not screen.wait(LEASE_S - POLL_S)
    assert screen.wait(LIMIT_S - LEASE_S)


def test_reloaded_page_is_not_gone(screen: Watched) -> None:
    screen.wait(5.0, is_open=True)
    assert not screen.wait(LEASE_S - POLL_S)
    assert not screen.wait(5.0, is_open=True)


def test_first_goal_waits_for_first_page(screen: Watched) -> None:
    assert not screen.wait(60.0), "nothing needs it yet"
    screen.watch.on_goal(screen.now)
    assert not screen.wait(FIRST_PAGE_S - POLL_S)
    assert not screen.watch.was_seen
    assert not screen.wait(5.0, is_open=True)
    assert screen.watch.was_seen


def test_wait_for_first_page_ends(screen: Watched) -> None:
    screen.watch.on_goal(screen.now)
    assert screen.wait(FIRST_PAGE_S + POLL_S)
    screen.watch.on_goal(screen.now)
    assert screen.watch.is_gone(screen.now), "a later goal does not wait again"


def test_page_opened_too_late_serves_later_goals(screen: Watched) -> None:
    screen.watch.on_goal(screen.now)
    assert screen.wait(2 * FIRST_PAGE_S)
    assert not screen.wait(5.0, is_open=True)


def test_goal_after_closed_page_does_not_wait(screen: Watched) -> None:
    screen.wait(5.0, is_open=True)
    screen.wait(LIMIT_S)
    screen.watch.on_goal(screen.now)
    assert screen.watch.is_gone(screen.now)


def test_stalled_robot_reads_queued_heartbeats_before_deciding(screen: Watched) -> None:
    screen.wait(5.0, is_open=True)
    screen.now += 20.0
    assert not screen.watch.is_gone(screen.now)
    assert screen.wait(LEASE_S), "nothing was queued"
