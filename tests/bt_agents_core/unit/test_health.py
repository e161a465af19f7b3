# SPDX-License-Identifier: Apache-2.0
"""Health of parts: the number of published values."""

from __future__ import annotations

from bt_agents_core.health import MOST_VALUES, first_values


def test_excess_values_are_dropped_and_counted():
    few = {str(number): "x" for number in range(MOST_VALUES)}
    assert first_values(few) == few
    told = first_values(few | {"one": "more", "and": "another"})
    assert len(told) == MOST_VALUES
    assert told["left out"] == "3"
