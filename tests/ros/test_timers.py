# SPDX-License-Identifier: Apache-2.0
"""Steady timers: periodic ones, and one that fires once, at a time that can be moved."""

from __future__ import annotations

import math
import time
from typing import Any

from bt_agents_ros.timers import OneShot, steady_timer


def test_periodic_timers_of_process_fire_together(ros: Any) -> None:
    def fire() -> None:
        fired.append(time.monotonic())

    def is_due_together() -> bool:
        before = time.monotonic()
        first, second = (timer.time_until_next_call() * 1e-9 for timer in timers)
        slack_s = time.monotonic() - before + made_in_s + 1e-3
        apart_s = abs(first - second) % 0.1
        return min(apart_s, 0.1 - apart_s) <= slack_s

    fired: list[float] = []
    timers = [steady_timer(ros.node, 0.2, fire)]
    ros.until(lambda: fired)
    ros.until(lambda: time.monotonic() > fired[0] + 0.03)
    begun = time.monotonic()
    timers.append(steady_timer(ros.node, 0.1, fire))
    made_in_s = time.monotonic() - begun
    assert is_due_together()
    ros.until(lambda: len(fired) == 6)
    assert is_due_together()


def test_timer_fires_once_per_setting(ros: Any) -> None:
    rung: list[float] = []
    one = OneShot(ros.node, lambda: rung.append(time.monotonic()))
    at = time.monotonic() + 0.03
    one.set(at)
    one.set(at)
    ros.until(lambda: rung)
    assert rung[0] >= at - 0.001
    ros.turns(5)
    assert len(rung) == 1
    one.set(time.monotonic() - 1.0)
    ros.until(lambda: len(rung) == 2)


def test_moved_timer_fires_at_new_time_stopped_never(ros: Any) -> None:
    first, second = [], []
    moved = OneShot(ros.node, lambda: first.append(time.monotonic()))
    stopped = OneShot(ros.node, lambda: second.append(time.monotonic()))
    moved.set(time.monotonic() + 30.0)
    stopped.set(time.monotonic() + 0.01)
    stopped.set(math.inf)
    at = time.monotonic() + 0.02
    moved.set(at)
    ros.until(lambda: first)
    ros.turns(5)
    assert (len(first), second) == (1, [])


def test_timer_may_be_set_in_its_own_callback(ros: Any) -> None:
    rung: list[float] = []

    def ring() -> None:
        rung.append(time.monotonic())
        if len(rung) < 3:
            one.set(time.monotonic() + 0.001)

    one = OneShot(ros.node, ring)
    one.set(time.monotonic())
    ros.until(lambda: len(rung) == 3)
    ros.turns(5)
    assert len(rung) == 3


def test_timer_may_be_set_to_unreachable_time(ros: Any) -> None:
    rung: list[float] = []
    one = OneShot(ros.node, lambda: rung.append(time.monotonic()))
    for years in (1e3, 1e300):
        one.set(time.monotonic() + years * 3.2e7)
        ros.turns(3)
        assert rung == []
    one.set(time.monotonic())
    ros.until(lambda: rung)
