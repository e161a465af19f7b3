# SPDX-License-Identifier: Apache-2.0
"""Two marketplaces with one name: the younger one ends, and a dead one causes no harm."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_agents_ros.node_main import RESTARTED
from marketplace_node.node.second_market import refuse_second_market
from marketplace_node.other_market import LEAVE_S, LISTEN_S, OtherMarket, StartCheck

ages = st.integers(min_value=2, max_value=2**31)


def end_of(check: StartCheck, beats_until: float, *, is_on_graph: bool = False) -> float:
    now = 0.0
    while not check.is_over(now, is_on_graph=is_on_graph):
        if now < beats_until:
            check.on_heartbeat("old", now)
        now += 0.1
    return now


def test_market_hearing_no_other_starts_quickly() -> None:
    check = StartCheck(0.0)
    now = end_of(check, beats_until=0.0)
    assert now <= LISTEN_S + 0.1
    assert not check.is_refused(now)


def test_ending_market_is_awaited() -> None:
    check = StartCheck(0.0)
    now = end_of(check, beats_until=0.8)
    assert not check.is_refused(now)


def test_dead_market_on_graph_only_delays_start() -> None:
    check = StartCheck(0.0)
    now = end_of(check, beats_until=0.0, is_on_graph=True)
    assert LISTEN_S < now <= LEAVE_S + 0.1
    assert not check.is_refused(now)


def test_supervised_market_starts_without_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RESTARTED, "yes")
    refuse_second_market()  # without rclpy.init it cannot listen


def test_second_market_does_not_start_beside_live_one() -> None:
    check = StartCheck(0.0)
    now = end_of(check, beats_until=9.0)
    assert now <= LEAVE_S + 0.1
    assert check.is_refused(now)
    assert check.alive == "old"


def test_market_ignores_own_and_final_heartbeats() -> None:
    watch = OtherMarket("b")
    assert not watch.gives_way("b", 50, 1)
    assert not watch.gives_way("a", 100, 2)
    assert not watch.gives_way("a", 100, 3)
    assert watch.gives_way("a", 101, 4)


@given(ages, ages)
def test_younger_of_two_markets_gives_way(one: int, two: int) -> None:
    here, there = OtherMarket("a"), OtherMarket("b")
    here.gives_way("b", two - 1, one)
    there.gives_way("a", one - 1, two)
    ends = (here.gives_way("b", two, one), there.gives_way("a", one, two))
    assert sum(ends) == 1
    if abs(one - two) > 3:
        assert ends == (one < two, two < one)
