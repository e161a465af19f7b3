# SPDX-License-Identifier: Apache-2.0
"""`bt-agents status`: the market's current activity."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest

from bt_agents_core.scene_labels import SceneLabels
from bt_agents_interfaces.msg import (
    AgentCard,
    HostCard,
    MarketStatus,
    Scene,
    SceneValue,
    Tree,
    TreeNode,
    Trees,
)
from bt_agents_ros.messages import header_at, to_time
from bt_agents_tools.cli.commands.status import (
    differing_agents,
    market_text,
    rule_problems,
    shown_agents,
)
from bt_agents_tools.cli.formatting import node_names, since_text

SINCE_S = time.mktime((2026, 5, 4, 10, 11, 12, 0, 0, -1))


def text_of(names: SceneLabels | None = None, *, is_end_shown: bool = False, **fields: Any) -> str:
    status = MarketStatus(header=header_at(to_time(SINCE_S)), **fields)
    known = names or SceneLabels()
    return market_text(status, known, SINCE_S + 75.0, is_end_shown=is_end_shown)


def test_run_shows_its_start_time_and_scene():
    shown = text_of(
        state=MarketStatus.RUNNING,
        scene_id="scene-7",
        scene_label="an elderly lady",
        message="attentive_guide is running",
    )
    assert shown == (
        "running since 10:11:12, for 1 min 15 s: 'an elderly lady', attentive_guide is running"
    )


def test_unlabelled_scene_is_named_by_values_not_id():
    names = SceneLabels()
    names.add(Scene(scene_id="scene-7", person=True, values=[SceneValue(name="age", value=4.5)]))
    shown = text_of(
        names,
        state=MarketStatus.COLLECTING,
        scene_id="scene-7",
        message="scene 'scene-7' has ended; collecting feedback",
    )
    assert shown.endswith(": 'age 4.5', scene 'age 4.5' has ended; collecting feedback")


def test_operator_award_uses_label_of_its_scene():
    names = SceneLabels()
    names.add(Scene(scene_id="scene-7", label="a child"))
    assert names.name_of("scene-7+award2") == "a child"
    assert names.name_of("scene-7+award2+again+1") == "a child"
    assert names.name_of("scene-8+award2") == "scene-8+award2"


def test_scene_label_cache_keeps_latest_labels():
    names = SceneLabels()
    for number in range(1_001):
        names.add(Scene(scene_id=f"scene-{number}", label=f"{number}" + "a" * 1_000))
    assert names.name_of("scene-0") == "scene-0"
    assert names.name_of("scene-1000") == "1000" + "a" * 195 + "…"
    names.add(Scene(scene_id="s" * 20_000, label="a child"))
    assert names.name_of("s" * 20_000) == "s" * 20_000


def test_waiting_market_always_names_awaited_host():
    shown = text_of(queued=2, message="waiting for /agents", is_end_shown=True)
    assert shown.endswith("for 1 min 15 s: waiting for /agents")


@pytest.mark.parametrize("follow_up_is_first", [False, True])
def test_follow_up_round_uses_label_of_own_scene(follow_up_is_first):
    scenes = [Scene(scene_id="scene-7", label="a child"), Scene(scene_id="scene-7+1", label="sad")]
    names = SceneLabels()
    for scene in scenes[:: -1 if follow_up_is_first else 1]:
        names.add(scene)
    assert [names.name_of(one) for one in ("scene-7", "scene-7+1", "scene-7+2")] == [
        "a child",
        "sad",
        "a child",
    ]


def test_idle_market_shows_last_end_unless_shown_elsewhere():
    over = "scene 'lady' is over: succeeded"
    assert text_of(message=over).endswith(f"for 1 min 15 s: {over}")
    assert text_of(message=over, is_end_shown=True) == "idle since 10:11:12, for 1 min 15 s"


@pytest.mark.parametrize(
    ("lasted_s", "text"),
    [
        (-5.0, "for 0 s"),
        (0.2, "for 0 s"),
        (59.0, "for 59 s"),
        (60.0, "for 1 min"),
        (3600.0, "for 1 h"),
        (7384.0, "for 2 h 3 min"),
    ],
)
def test_duration_has_at_most_two_units(lasted_s, text):
    assert since_text(to_time(SINCE_S), SINCE_S + lasted_s) == f"since 10:11:12, {text}"


def test_node_names_come_from_latest_trees_of_agent():
    def trees(name: str) -> Trees:
        nodes = [TreeNode(path="tree", name=name)]
        return Trees(trees=[Tree(agent="a", nodes=nodes), Tree(agent="b", nodes=nodes)])

    assert node_names([[trees("old"), trees("new")], []], "a") == {"tree": "new"}
    assert node_names([], "a") == {}


@pytest.mark.parametrize(("most", "shown"), [(5, [3, 2, 0]), (3, [3, 0, 0]), (100, [3, 3, 3])])
def test_only_the_first_agents_are_shown(most, shown):
    cards = [HostCard(agents=[AgentCard()] * 3)] * 3
    assert [len(agents) for agents in shown_agents(cards, most)] == shown


def test_undecidable_market_and_mood_rules_are_reported():
    of_market = SimpleNamespace(file="market.yaml", line=4, message="rule 1 cannot be decided")
    of_mood = SimpleNamespace(file="", line=0, message="the mood rule cannot be decided")
    market = SimpleNamespace(problems=[of_market])
    assert rule_problems(market, SimpleNamespace(problems=[of_mood])) == [of_market, of_mood]
    assert rule_problems(market, None) == [of_market]


def test_agents_bidding_with_differing_profile_are_listed():
    assert differing_agents(SimpleNamespace(differing=["guide"])) == ["guide"]
    assert differing_agents(None) == ()
