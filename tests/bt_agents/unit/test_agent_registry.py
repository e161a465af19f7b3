# SPDX-License-Identifier: Apache-2.0
"""Agent registry: which agents bid for a scene, and why others do not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.host.agent_registry import AgentRegistry, Decline
from bt_agents_core.errors import Refused
from bt_agents_core.local_time import LocalTime
from bt_agents_core.profile_layers import MOST_LAYERS
from bt_agents_language.model.specs import AgentSpec
from tree_harness import SPACE, agent, scene


def registered(*specs: AgentSpec) -> AgentRegistry:
    registry = AgentRegistry(SPACE, specs)
    names = list(registry.members)
    registry.apply_registration(names, range(1, len(names) + 1), [""] * len(names))
    return registry


def declined(registry: AgentRegistry, **values: float) -> dict[str, str]:
    answer = registry.bids_for(scene(**values))
    bidders = {member.spec.name for member in answer.bidders.members}
    assert bidders == set(registry.members) - set(answer.declined)
    return {name: decline.reason for name, decline in answer.declined.items()}


def test_night_agent_bids_only_at_night():
    registry = registered(agent("say: x", "requires: clock.hour >= 22"))

    def reasons(hour: int) -> list[str]:
        clock = lambda: LocalTime(hour=hour, weekday="monday")  # noqa: E731
        declined = registry.bids_for(scene(age=3), clock=clock).declined
        return [one.reason for one in declined.values()]

    unmet = ["needs clock.hour >= 22"]
    assert [reasons(hour) for hour in (21, 22, 21)] == [unmet, [], unmet]
    assert declined(registry, age=3) == {"a": "needs clock.hour >= 22, but clock.hour is missing"}


@pytest.mark.parametrize(
    ("requires", "lacking"),
    [
        ("scene.age >= 1 and scene.mood > 4", "scene.mood > 4"),
        ("scene.age between 3 and 5 and scene.mood > 1", "scene.age between 3 and 5"),
        ("(scene.age > 2 or scene.mood > 4) and scene.age > 1",
         "(scene.age > 2 or scene.mood > 4)"),
        ("scene.age > 3 and scene.mood > 1 or scene.mood > 4",
         "scene.age > 3 and scene.mood > 1 or scene.mood > 4"),
        ("not (scene.age > 1 and scene.mood > 1)", "not (scene.age > 1 and scene.mood > 1)"),
    ],
)  # fmt: skip
def test_decline_names_unmet_part_of_conjunction(requires, lacking):
    registry = registered(agent("say: x", f"requires: {requires}"))
    decline = Decline(f"needs {lacking}", unmet=lacking)
    assert registry.bids_for(scene(age=2, mood=3)).declined == {"a": decline}


def test_undecidable_requirement_differs_from_unmet_one():
    registry = registered(agent("say: x", "requires: 1 / (scene.age - 3) > 0"))
    answer = registry.bids_for(scene(age=3))
    reason = "needs what cannot be decided: 1 / (scene.age - 3) > 0 ('/' by zero)"
    assert answer.declined == {"a": Decline(reason, unmet="", undecided=True)}
    assert answer.undecided == {"a": reason}
    assert registry.bids_for(scene(age=2)).undecided == {}


def test_agent_with_unoffered_skill_declines_with_reason():
    reason = "skill 'dance': no robot is bound to it"
    spec = replace(agent("say: x"), unoffered=(reason,))
    assert declined(registered(spec), age=3) == {"a": reason}


def test_leaving_agent_declines_with_its_removal_reason():
    registry = registered(agent("say: x"), replace(agent("say: x"), name="b"))
    assert declined(registry, age=3) == {}
    registry.member("b").removal_reason = "its file is gone"
    assert declined(registry, age=3) == {"b": "its file is gone"}
    registry.remove("b")
    registry.apply_registration(["b"], [7], [""])
    assert declined(registry, age=3) == {}
    assert set(registry.members) == {"a"}


def test_obstacle_makes_all_agents_decline():
    registry = registered(agent("say: x", "requires: scene.age >= 3"))
    answer = registry.bids_for(scene(age=2), obstacle="nothing publishes /clock")
    assert answer.bidders.members == ()
    assert answer.declined == {"a": Decline("nothing publishes /clock")}


def layered(kinds: str, **layers: float) -> AgentRegistry:
    registry = AgentRegistry(SPACE, [agent("say: x", f"learning: {{layers: {kinds}}}")])
    for layer, age in layers.items():
        kind, _, name = layer.partition("_")
        registry.set_profile("a", [age, 3.0, 3.0], 1, f"{kind}/{name}")
    return registry


@pytest.mark.parametrize(
    ("kinds", "person", "place", "expected"),
    [
        ("[person, place]", "anna", "lobby", 4.0),
        ("[person, place]", "bob", "lobby", 5.0),
        ("[person, place]", "", "lobby", 5.0),
        ("[person, place]", "bob", "garden", 3.0),
        ("[place]", "anna", "lobby", 5.0),
        ("[person]", "bob", "lobby", 3.0),
    ],
)
def test_bid_prefers_person_then_place_then_base_profile(kinds, person, place, expected):
    member = layered(kinds, person_anna=4.0, place_lobby=5.0).member("a")
    here = replace(scene(age=3), person_id=person, place=place)
    assert member.profile_for(here)[0] == expected


def test_unnamed_layer_is_refused():
    registry = layered("[person]", person_anna=4.0)
    for layer in ("anna", "person/"):
        with pytest.raises(Refused, match="BAD_LAYER"):
            registry.set_profile("a", [1.0, 1.0, 1.0], 2, layer)
    with pytest.raises(Refused, match="OUT_OF_RANGE"):
        registry.set_profile("a", [9.0, 3.0, 3.0], 2, "person/anna")
    assert registry.member("a").layers == {"person/anna": ((4.0, 3.0, 3.0), 1)}


def test_number_of_layers_per_agent_is_bounded():
    registry = layered("[person]")
    for number in range(MOST_LAYERS):
        registry.set_profile("a", [3.0, 3.0, 3.0], 1, f"person/{number}")
    with pytest.raises(Refused, match="TOO_MANY_LAYERS"):
        registry.set_profile("a", [3.0, 3.0, 3.0], 1, "person/more")
    registry.set_profile("a", [4.0, 3.0, 3.0], 2, "person/7")


def test_layers_are_removed_singly_or_all_together():
    registry = layered("[person, place]", person_anna=4.0, place_lobby=5.0)
    registry.remove_layer("a", "person/anna")
    registry.remove_layer("a", "person/anna")
    assert set(registry.member("a").layers) == {"place/lobby"}
    registry.remove_layer("", "")
    assert registry.member("a").layers == {}
    with pytest.raises(Refused, match="UNKNOWN_AGENT"):
        registry.remove_layer("b", "person/anna")


def test_custom_weights_are_sent_with_bids():
    heavy = replace(agent("say: x", "weights: {age: 2}"), name="b")
    registry = registered(agent("say: x"), heavy)
    of_scene = [parameter.weight for parameter in SPACE.parameters]
    assert list(registry.bids_for(scene(age=3), ["b"]).bidders.weights) == []
    assert list(registry.bids_for(scene(age=3)).bidders.weights) == [*of_scene, 2.0, *of_scene[1:]]


def test_next_answer_reflects_every_agent_change():
    registry = AgentRegistry(SPACE, [agent("say: x", "learning: {layers: [person]}")])
    anna = replace(scene(age=3), person_id="anna")

    def bid() -> list[object]:
        bidders = registry.bids_for(anna).bidders
        return [*bidders.names, *bidders.ids, *bidders.vectors]

    assert bid() == []
    registry.apply_registration(["a"], [7], [""])
    assert bid() == ["a", 7, 3.0, 3.0, 3.0]
    for age, layer in ((2.0, ""), (4.0, "person/anna"), (5.0, "person/anna")):
        registry.set_profile("a", [age, 3.0, 3.0], 1, layer)
        assert bid() == ["a", 7, age, 3.0, 3.0]
    registry.remove_layer("", "")
    assert bid() == ["a", 7, 2.0, 3.0, 3.0]
    registry.add(replace(agent("say: x"), name="b"))
    registry.apply_registration(["b"], [8], [""])
    assert bid() == ["a", "b", 7, 8, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0]
    registry.remove("a")
    assert bid() == ["b", 8, 3.0, 3.0, 3.0]
    registry.member("b").removal_reason = "its file is gone"
    assert bid() == []
    registry.member("b").removal_reason = ""
    assert bid() == ["b", 8, 3.0, 3.0, 3.0]
    registry.member("b").spec = replace(agent("say: x", "weights: {age: 2}"), name="b")
    weights = [2.0, *(parameter.weight for parameter in SPACE.parameters[1:])]
    assert list(registry.bids_for(anna).bidders.weights) == weights


def test_each_agent_evaluates_its_own_requirement():
    old = agent("say: x", "requires: scene.age >= 3")
    keen = replace(agent("say: x", "requires: scene.mood > 2"), name="c")
    registry = registered(old, replace(old, name="b"), keen)
    reason = "needs scene.age >= 3"
    assert declined(registry, age=2, mood=3) == {"a": reason, "b": reason}
    assert declined(registry, age=3, mood=1) == {"c": "needs scene.mood > 2"}
