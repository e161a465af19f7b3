# SPDX-License-Identifier: Apache-2.0
"""When a run is ticked next, in tables of events on a clock turned by hand."""

from __future__ import annotations

import pytest

from bt_agents.engine.tick_scheduler import REST_S, TickScheduler


def test_regular_ticks_stay_on_their_grid_however_long_they_take() -> None:
    pace = TickScheduler(0.1, now=0.0)
    due = []
    for _ in range(4):
        due.append(pace.due)
        pace.started()
        pace.finished(pace.due, pace.due + 0.03)
    assert due == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_a_late_tick_is_followed_by_the_next_one_of_the_grid_and_not_by_those_it_missed() -> None:
    pace = TickScheduler(0.1, now=0.0)
    pace.started()
    pace.finished(5.03, 5.04)
    assert pace.due == pytest.approx(5.1)


def test_an_overrun_leaves_out_what_it_has_missed() -> None:
    pace = TickScheduler(0.1, now=0.0)
    pace.started()
    pace.finished(0.0, 0.25)
    assert pace.due == pytest.approx(0.3)


def test_news_make_an_extra_tick_at_once_and_the_grid_stays() -> None:
    pace = TickScheduler(1.0, now=0.0)
    pace.started()
    pace.finished(0.0, 0.001)
    pace.request(0.4)
    assert pace.due == 0.4
    pace.started()
    pace.finished(0.4, 0.401)
    assert pace.due == 1.0


def test_news_soon_after_a_tick_wait_for_a_rest_as_long_as_the_tick() -> None:
    pace = TickScheduler(1.0, now=0.0)
    pace.started()
    pace.finished(0.0, 0.05)
    pace.request(0.06)
    assert pace.due == pytest.approx(0.1)
    pace.started()
    pace.finished(0.1, 0.1)
    pace.request(0.1)
    assert pace.due == pytest.approx(0.1 + REST_S)


def test_news_during_a_tick_are_not_lost() -> None:
    pace = TickScheduler(1.0, now=0.0)
    pace.started()
    pace.request(0.002)
    pace.finished(0.0, 0.01)
    assert pace.due == pytest.approx(0.02)


def test_a_flood_of_news_makes_one_tick_and_takes_at_most_half_of_the_time() -> None:
    pace = TickScheduler(1.0, now=0.0)
    now, ticked_s, ticks = 0.0, 0.0, 0
    while now < 1.0:
        pace.request(now)
        if pace.due <= now:
            pace.started()
            pace.finished(now, now + 0.005)
            now += 0.005
            ticked_s += 0.005
            ticks += 1
        now += 0.001
    assert ticked_s <= 0.51
    assert ticks >= 50


def test_whoever_hurries_does_not_wait_for_a_rest() -> None:
    pace = TickScheduler(1.0, now=0.0)
    pace.started()
    pace.finished(0.0, 0.05)
    pace.now(0.06)
    assert pace.due == 0.06


def test_a_deadline_between_two_ticks_is_kept() -> None:
    pace = TickScheduler(1.0, now=0.0)
    pace.started()
    pace.finished(0.0, 0.001, latest=0.3)
    assert pace.due == 0.3
    pace.started()
    pace.finished(0.3, 0.301, latest=0.2)
    assert pace.due == pytest.approx(0.301)


def test_another_rate_acts_at_once() -> None:
    pace = TickScheduler(1.0, now=0.0)
    pace.started()
    pace.finished(0.0, 0.001)
    pace.change(0.1, 0.2)
    assert pace.due == pytest.approx(0.3)
