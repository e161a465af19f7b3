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


@pytest.mark.parametrize(
    ("beats_until", "is_on_graph", "after", "until", "refused_for"),
    [
        (0.0, False, 0.0, LISTEN_S, ""),
        (0.8, False, 0.0, LEAVE_S, ""),
        (0.0, True, LISTEN_S, LEAVE_S, ""),
        (9.0, False, 0.0, LEAVE_S, "old"),
    ],
    ids=["no other", "an ending one is awaited", "a dead one delays", "a live one forbids"],
)
def test_market_starts_unless_another_lives(
    beats_until: float, is_on_graph: bool, after: float, until: float, refused_for: str
) -> None:
    check = StartCheck(0.0)
    now = 0.0
    while not check.is_over(now, is_on_graph=is_on_graph):
        if now < beats_until:
            check.on_heartbeat("old", now)
        now += 0.1
    assert after < now <= until + 0.1
    assert check.is_refused(now) == bool(refused_for)
    assert not refused_for or check.alive == refused_for


def test_supervised_market_starts_without_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RESTARTED, "yes")
    refuse_second_market()  # without rclpy.init it cannot listen


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
