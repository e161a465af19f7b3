# SPDX-License-Identifier: Apache-2.0
"""Whoever was held up waits a while before acting, in tables on a clock turned by hand."""

from __future__ import annotations

import pytest

from bt_agents.held_up import HeldUp


@pytest.mark.parametrize(
    ("looks", "wait_s", "lasted_s"),
    [
        ([], 0.0, 0.0),
        ([0.1, 0.2, 0.3], 0.0, 0.0),
        ([0.1, 0.6], 0.0, 0.0),
        ([0.1, 2.4], 0.3, 2.3),
        ([0.1, 2.4, 2.5], 0.2, 2.3),
        ([0.1, 2.4, 2.7], 0.0, 2.3),
        ([0.1, 2.4, 2.9], 0.0, 2.3),
        ([0.1, 2.4, 2.5, 4.0], 0.3, 1.5),
    ],
)
def test_after_a_gap_it_is_waited_for_news(
    looks: list[float], wait_s: float, lasted_s: float
) -> None:
    held_up = HeldUp(0.0, limit_s=0.55, calm_s=0.3)
    found = 0.0
    for now in looks:
        found = held_up.wait_s(now)
    assert found == pytest.approx(wait_s)
    assert held_up.lasted_s == pytest.approx(lasted_s)
