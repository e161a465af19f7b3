# SPDX-License-Identifier: Apache-2.0
"""Decisions of the market in a terminal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from bt_agents_core.scene_labels import SceneLabels
from bt_agents_interfaces.msg import Auction, Run, Scene
from bt_agents_ros.messages import to_time
from bt_agents_tools.cli.decisions import show_decision, stop_texts
from market_harness import scene
from marketplace_node.effects import PublishAuction
from marketplace_node.node.messages import auction_to_msg
from marketplace_node.round.decision import External
from ranked_rounds import bids, decided, terms

STARTED = {"event": Run.STARTED}
STOPPING = {"event": Run.CANCELLING, "stopped_by": Run.OPERATOR, "stop_reason": "it is late"}
BY_HOST = {"event": Run.ENDED, "outcome": Run.CANCELLED, "stop_cause": Run.BY_HOST}


@pytest.mark.parametrize(
    ("events", "texts"),
    [
        ([STARTED, {"event": Run.ENDED, "outcome": Run.SUCCEEDED}], []),
        ([STARTED, STOPPING], ["a was told to stop (operator): it is late"]),
        (
            [STOPPING, STOPPING | {"event": Run.ENDED, "outcome": Run.CANCELLED}],
            ["a was stopped (operator): it is late"],
        ),
        (
            [STOPPING | {"stopped_by": Run.OTHER_SCENE, "stop_reason": "for scene 's9'"}],
            ["a was told to stop (other scene): for scene 'a child'"],
        ),
        ([BY_HOST | {"message": "it shuts down"}], ["a was stopped (host): it shuts down"]),
        (
            [BY_HOST | {"stop_cause": Run.MARKET_LOST, "message": "silence"}],
            ["a was stopped: silence"],
        ),
        ([STOPPING | {"round": 2}, STOPPING | {"epoch": "other"}], []),
        (
            [STOPPING, STOPPING | {"agent": "b", "stopped_by": 77}],
            ["a was told to stop (operator): it is late", "b was told to stop: it is late"],
        ),
    ],
)
def test_decision_names_who_stopped_run_and_why(
    events: list[dict[str, Any]], texts: list[str]
) -> None:
    names = SceneLabels()
    names.add(Scene(scene_id="s9", label="a child"))
    runs = [Run(**({"epoch": "e", "round": 1, "agent": "a"} | event)) for event in events]
    assert stop_texts(runs, Auction(epoch="e", round=1), names) == texts


@pytest.mark.parametrize(
    ("strategy", "external", "times"),
    [("ucb", None, 1), ("external", External(ranking=("b",)), 0), ("manhattan", None, 0)],
)
def test_exploration_bonus_is_shown_once_for_exploring_strategies(
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
