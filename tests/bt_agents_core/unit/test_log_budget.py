# SPDX-License-Identifier: Apache-2.0
"""Log lines caused by other processes: bounded, with a note about omitted ones."""

from __future__ import annotations

from bt_agents_core.log_budget import LogBudget


def test_last_line_of_period_announces_suppressed_lines() -> None:
    now_s = 100.0
    budget = LogBudget(2, 5.0, lambda: now_s)
    assert budget.line("one") == "one"
    now_s = 101.0
    assert budget.line("two") == "two (others are left out for 4.0 s)"
    assert budget.line("three") == ""
    now_s = 105.0
    assert budget.line("four") == "four"
