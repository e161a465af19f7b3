# SPDX-License-Identifier: Apache-2.0
"""Tick scheduler: the time of the next tick, in tables of events on a manual clock."""

from __future__ import annotations

import pytest

from bt_agents.engine.ticker import REST_S, TickScheduler


@pytest.fixture
def pace() -> TickScheduler:
    return TickScheduler(1.0, now=0.0)


def tick(pace: TickScheduler, began: float, ended: float, **latest: float) -> None:
    pace.started()
    pace.finished(began, ended, **latest)


@pytest.mark.parametrize(
    ("began", "ended", "due"), [(0.0, 0.03, 0.1), (5.03, 5.04, 5.1), (0.0, 0.25, 0.3)]
)
def test_ticks_stay_on_grid_and_skip_missed_ones(began: float, ended: float, due: float) -> None:
    pace = TickScheduler(0.1, now=0.0)
    assert pace.due == 0.0
    tick(pace, began, ended)
    assert pace.due == pytest.approx(due)


def test_request_adds_immediate_tick_and_keeps_grid(pace: TickScheduler) -> None:
    tick(pace, 0.0, 0.001)
    pace.request(0.4)
    assert pace.due == 0.4
    tick(pace, 0.4, 0.401)
    assert pace.due == 1.0


def test_early_request_waits_as_long_as_last_tick(pace: TickScheduler) -> None:
    tick(pace, 0.0, 0.05)
    for now in (0.06, 0.07):
        pace.request(now)
        assert pace.due == pytest.approx(0.1)
    tick(pace, 0.1, 0.1)
    pace.request(0.1)
    assert pace.due == pytest.approx(0.1 + REST_S)


def test_request_during_tick_is_not_lost(pace: TickScheduler) -> None:
    pace.started()
    pace.request(0.002)
    pace.finished(0.0, 0.01)
    assert pace.due == pytest.approx(0.02)


def test_urgent_tick_skips_rest(pace: TickScheduler) -> None:
    tick(pace, 0.0, 0.05)
    pace.now(0.06)
    assert pace.due == 0.06


def test_deadline_between_ticks_is_met(pace: TickScheduler) -> None:
    tick(pace, 0.0, 0.001, latest=0.3)
    assert pace.due == 0.3
    tick(pace, 0.3, 0.301, latest=0.2)
    assert pace.due == pytest.approx(0.301)


def test_rate_change_takes_effect_immediately(pace: TickScheduler) -> None:
    tick(pace, 0.0, 0.001)
    pace.change(0.1, 0.2)
    assert pace.due == pytest.approx(0.3)
