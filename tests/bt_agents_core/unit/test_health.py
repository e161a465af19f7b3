# SPDX-License-Identifier: Apache-2.0
"""Health of parts: how many values are told."""

from __future__ import annotations

from bt_agents_core.health import MOST_VALUES, first_values


def test_values_are_told_as_they_are_and_of_many_the_first_with_the_number_of_the_others():
    few = {str(number): "x" for number in range(MOST_VALUES)}
    assert first_values(few) == few
    told = first_values(few | {"one": "more", "and": "another"})
    assert len(told) == MOST_VALUES
    assert told["left out"] == "3"
