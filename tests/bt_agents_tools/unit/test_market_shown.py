# SPDX-License-Identifier: Apache-2.0
"""The market in a terminal: its activity and its decisions."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from bt_agents_core.scene_labels import SceneLabels
from bt_agents_interfaces import msg
from bt_agents_interfaces.msg import Run
from bt_agents_ros.messages import header_at, to_time
from bt_agents_tools.cli.commands import status
from bt_agents_tools.cli.decisions import show_decision, stop_texts
from bt_agents_tools.cli.formatting import node_names, since_text
from market_harness import scene
from marketplace_node.effects import PublishAuction
from marketplace_node.node.messages import auction_to_msg
from marketplace_node.round.decision import External
from ranked_rounds import bids, decided, terms

SINCE_S = time.mktime((2026, 5, 4, 10, 11, 12, 0, 0, -1))


def text_of(names: SceneLabels | None = None, *, is_end_shown: bool = False, **fields: Any) -> str:
    market = msg.MarketStatus(header=header_at(to_time(SINCE_S)), **fields)
    known = names or SceneLabels()
    return status.market_text(market, known, SINCE_S + 75.0, is_end_shown=is_end_shown)


def test_run_shows_its_start_time_and_scene():
    shown = text_of(
        state=msg.MarketStatus.RUNNING,
        scene_id="scene-7",
        scene_label="an elderly lady",
        message="attentive_guide is running",
    )
    assert shown == (
        "running since 10:11:12, for 1 min 15 s: 'an elderly lady', attentive_guide is running"
    )


def test_unlabelled_scene_is_named_by_values_not_id():
    names = SceneLabels()
    age = msg.SceneValue(name="age", value=4.5)
    names.add(msg.Scene(scene_id="scene-7", person=True, values=[age]))
    shown = text_of(
        names,
        state=msg.MarketStatus.COLLECTING,
        scene_id="scene-7",
        message="scene 'scene-7' has ended; collecting feedback",
    )
    assert shown.endswith(": 'age 4.5', scene 'age 4.5' has ended; collecting feedback")


def test_scene_label_cache_keeps_latest_labels():
    names = SceneLabels()
    for number in range(1_001):
        names.add(msg.Scene(scene_id=f"scene-{number}", label=f"{number}" + "a" * 1_000))
    assert names.name_of("scene-0") == "scene-0"
    assert names.name_of("scene-1000") == "1000" + "a" * 195 + "…"
    names.add(msg.Scene(scene_id="s" * 20_000, label="a child"))
    assert names.name_of("s" * 20_000) == "s" * 20_000


@pytest.mark.parametrize("heard", [["scene-7", "scene-7+1"], ["scene-7+1", "scene-7"]])
def test_later_rounds_use_label_of_their_scene(heard):
    labels = {"scene-7": "a child", "scene-7+1": "sad"}
    names = SceneLabels()
    for name in heard:
        names.add(msg.Scene(scene_id=name, label=labels[name]))
    assert [names.name_of(name) for name in labels] == ["a child", "sad"]
    for other in ("scene-7+2", "scene-7+award2", "scene-7+award2+again+1"):
        assert names.name_of(other) == "a child"
    assert names.name_of("scene-8+award2") == "scene-8+award2"


def test_idle_market_shows_last_end_unless_shown_elsewhere():
    over = "scene 'lady' is over: succeeded"
    assert text_of(message=over).endswith(f"for 1 min 15 s: {over}")
    assert text_of(message=over, is_end_shown=True) == "idle since 10:11:12, for 1 min 15 s"
    assert text_of(queued=2, message="waits", is_end_shown=True).endswith("15 s: waits")


@pytest.mark.parametrize(
    ("lasted_s", "text"),
    [(-5.0, "for 0 s"), (59.0, "for 59 s"), (3600.0, "for 1 h"), (7384.0, "for 2 h 3 min")],
)
def test_duration_has_at_most_two_units(lasted_s, text):
    assert since_text(to_time(SINCE_S), SINCE_S + lasted_s) == f"since 10:11:12, {text}"


def test_simulated_stamp_has_no_duration():
    assert since_text(to_time(60.0), SINCE_S) == "since 60 s of simulated time"


def test_node_names_come_from_latest_trees_of_agent():
    def trees(name: str) -> msg.Trees:
        nodes = [msg.TreeNode(path="tree", name=name)]
        return msg.Trees(trees=[msg.Tree(agent=agent, nodes=nodes) for agent in ("a", "b")])

    assert node_names([[trees("old"), trees("new")], []], "a") == {"tree": "new"}
    assert node_names([], "a") == {}


@pytest.mark.parametrize(("most", "shown"), [(5, [3, 2, 0]), (3, [3, 0, 0]), (100, [3, 3, 3])])
def test_only_the_first_agents_are_shown(most, shown):
    cards = [msg.HostCard(agents=[msg.AgentCard()] * 3)] * 3
    assert [len(agents) for agents in status.shown_agents(cards, most)] == shown


def test_problems_of_rules_and_profiles_are_reported():
    market = SimpleNamespace(problems=["of the market"])
    profiles = SimpleNamespace(problems=["of a mood rule"], differing=["guide"])
    assert status.rule_problems(market, profiles) == ["of the market", "of a mood rule"]
    assert status.rule_problems(market, None) == ["of the market"]
    assert (status.differing_agents(profiles), status.differing_agents(None)) == (["guide"], ())


STARTED = {"event": Run.STARTED}
STOPPING = {"event": Run.CANCELLING, "stopped_by": Run.OPERATOR, "stop_reason": "it is late"}
STOPPED = STOPPING | {"event": Run.ENDED, "outcome": Run.CANCELLED}
FOR_OTHER = STOPPING | {"stopped_by": Run.OTHER_SCENE, "stop_reason": "for scene 's9'"}
BY_HOST = {"event": Run.ENDED, "outcome": Run.CANCELLED, "stop_cause": Run.BY_HOST}

MARKET_LOST = BY_HOST | {"stop_cause": Run.MARKET_LOST, "message": "silence"}


@pytest.mark.parametrize(
    ("events", "texts"),
    [
        ([STARTED, {"event": Run.ENDED, "outcome": Run.SUCCEEDED}], []),
        ([STARTED, STOPPING], ["a was told to stop (operator): it is late"]),
        ([STOPPING, STOPPED], ["a was stopped (operator): it is late"]),
        ([FOR_OTHER], ["a was told to stop (other scene): for scene 'a child'"]),
        ([BY_HOST | {"message": "it shuts down"}], ["a was stopped (host): it shuts down"]),
        ([MARKET_LOST], ["a was stopped: silence"]),
        ([STOPPING | {"round": 2}, STOPPING | {"epoch": "other"}], []),
        (
            [STOPPING, STOPPING | {"agent": "b", "stopped_by": 77}],
            ["a was told to stop (operator): it is late", "b was told to stop: it is late"],
        ),
    ],
)
def test_decision_names_stopper_and_reason(events: list[dict[str, Any]], texts: list[str]) -> None:
    names = SceneLabels()
    names.add(msg.Scene(scene_id="s9", label="a child"))
    runs = [Run(**({"epoch": "e", "round": 1, "agent": "a"} | event)) for event in events]
    assert stop_texts(runs, msg.Auction(epoch="e", round=1), names) == texts


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
