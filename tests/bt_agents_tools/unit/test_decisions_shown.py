# SPDX-License-Identifier: Apache-2.0
"""Decisions of the market as a terminal shows them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents_ros.messages import to_time
from bt_agents_tools.cli.decisions import show_decision
from market_harness import scene
from marketplace_node.effects import PublishAuction
from marketplace_node.node.messages import auction_to_msg
from marketplace_node.round.decision import External
from ranked_rounds import bids, decided, terms


@pytest.mark.parametrize(
    ("strategy", "external", "times"),
    [("ucb", None, 1), ("external", External(ranking=("b",)), 0), ("manhattan", None, 0)],
)
def test_what_exploration_takes_off_is_told_once_and_only_where_something_explores(
    strategy: str, external: External | None, times: int, capsys: pytest.CaptureFixture[str]
) -> None:
    of = replace(
        terms(scene("s", 3.0, 3.0, 3.0), strategy=strategy), runs={"b": 2, "a": 1}, rounds_run=3
    )
    decision = decided(of, bids({"a": (3.0, 3.0, 4.0), "b": (3.0, 3.0, 5.0)}), external=external)
    show_decision(auction_to_msg(PublishAuction(decision=decision), to_time(1.0)))

    for line in capsys.readouterr().out.splitlines()[1:3]:
        assert line.count("less") == times
        assert "for exploring" not in line
