# SPDX-License-Identifier: Apache-2.0
"""Layers for a person or a place, and their effect on everybody's profile."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random

import pytest

from bt_agents_core import profile_layers as layers_module
from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning import profiles as profiles_module
from feedback_node.learning.cards import LearningEntry
from feedback_node.learning.profiles import Delivery, ProfileChange, Profiles
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.rows import IMPORT, RevisionCause
from learning_cards import card, entry
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import age_and_mood

NAN = math.nan
ANNA, LOBBY = "person/anna", "place/lobby"


def learning(*layers: str, general: float = 0.0, **fields: object) -> LearningEntry:
    described = {"update": "plain", "window": 5, "layers": layers, "general": general}
    return LearningEntry(**described | fields)


PERSON = learning("person")


def known(learning: LearningEntry = PERSON, ledger: Ledger | None = None) -> Profiles:
    made = Profiles(SPACE, ledger or Ledger(":memory:"))
    assert made.register_card(card(entry(learning=learning)))[1] == ()
    return made


def run(person: str = "", place: str = "") -> AnnouncedRun:
    scene = age_and_mood(3.0, 3.0, "scene-of-anna", person_id=person, place=place)
    return AnnouncedRun(epoch="e", round=1, agent="guide", scene=scene)


def teach(
    profiles: Profiles,
    feedback_id: str,
    *,
    age: float = 5.0,
    kind: FeedbackKind = FeedbackKind.DIRECT,
    where: AnnouncedRun | None = None,
) -> ProfileChange:
    return profiles.apply(
        "guide",
        kind,
        (age, NAN),
        feedback_id=feedback_id,
        source="program",
        reason="anna said so",
        run=where,
    )


def ages(profiles: Profiles) -> dict[str, float]:
    return {layer: vector[0] for _, layer, _, vector in profiles.table()}


@pytest.mark.parametrize(
    ("learning", "where", "expected"),
    [
        (PERSON, run("anna"), {"": 3.0, ANNA: 4.0}),
        (PERSON, run(), {"": 4.0}),
        (PERSON, None, {"": 4.0}),
        (learning(), run("anna", "lobby"), {"": 4.0}),
        (learning("place"), run("anna", "lobby"), {"": 3.0, LOBBY: 4.0}),
        (learning("person", "place"), run("anna", "lobby"), {"": 3.0, ANNA: 4.0, LOBBY: 4.0}),
        (learning("person", general=0.25), run("anna"), {"": 3.25, ANNA: 4.0}),
        (learning("person", general=1.0), run("anna"), {"": 4.0, ANNA: 4.0}),
    ],
)
def test_feedback_moves_scene_layers_and_partly_general_profile(learning, where, expected):
    profiles = known(learning)
    change = teach(profiles, "f1", where=where)
    assert ages(profiles) == expected
    moved = {layer for layer, age in expected.items() if age != 3.0}
    assert {one.revision.layer for one in change.all} == moved


def test_layer_starts_from_general_profile_then_diverges():
    profiles = known()
    teach(profiles, "f1")
    teach(profiles, "f2", where=run("anna"), age=1.0)
    teach(profiles, "f3")
    assert ages(profiles) == {"": 4.5, ANNA: 2.5}
    history = profiles._ledger.history("guide", ANNA)
    assert [(row.cause.cause, row.profile["age"]) for row in history] == [
        ("layer", 4.0),
        ("feedback", 2.5),
    ]


def test_set_feedback_sets_only_general_profile():
    profiles = known(learning("person", general=0.1))
    teach(profiles, "f1", kind=FeedbackKind.SET, where=run("anna"))
    assert ages(profiles) == {"": 5.0}


def test_texts_and_deliveries_name_every_layer():
    profiles = known(learning("person", general=0.5))
    change = teach(profiles, "f1", where=run("anna"))
    assert change.text == "for person/anna age 3 → 4; for everybody age 3 → 3.5"
    assert profiles.deliveries(change.all) == (
        Delivery(host="/agents", agent="guide", layer=ANNA, values=(4.0, 3.0), revision=1),
        Delivery(host="/agents", agent="guide", values=(3.5, 3.0), revision=1),
    )


def test_general_share_does_not_reveal_the_person():
    profiles = known(learning("person", general=0.5))
    teach(profiles, "of-anna", where=run("anna"))
    cause = profiles._ledger.history("guide")[-1].cause
    assert "anna" not in repr(cause)
    assert cause.weight == 0.5


def test_repeated_feedback_returns_revisions_of_all_layers():
    profiles = known(learning("person", general=0.5))
    first = teach(profiles, "f1", where=run("anna"))
    again = teach(profiles, "f1", where=run("anna"))
    assert not again.fresh
    assert [one.revision for one in again.all] == [one.revision for one in first.all]


def test_lessons_of_forgotten_layer_do_not_affect_successor():
    ledger = Ledger(":memory:")
    profiles = known(learning("person", update="median", window=3), ledger)
    teach(profiles, "f1", age=5.0, where=run("anna"))
    ledger.forget([("guide", ANNA)])
    profiles.on_erased([("guide", ANNA)])
    middle = {"age": 3.0, "mood": 3.0}
    cause = RevisionCause(cause=IMPORT, kind=FeedbackKind.SET, target=middle)
    taken_in = LedgerEntry(agent="guide", layer=ANNA, profile=middle, cause=cause)
    profiles.on_recorded(ledger.record([profiles.first_layer_entry("guide", ANNA), taken_in])[1:])
    teach(profiles, "f2", age=1.0, where=run("anna"))
    assert ages(profiles)[ANNA] == 2.0


def test_each_layer_anneals_and_averages_its_own_feedback():
    profiles = known(learning("person", anneal=1.0))
    for number in range(2):
        teach(profiles, f"f{number}")
    change = teach(profiles, "a", where=run("anna"))
    assert change.rates == () or change.rates[0] == 0.5
    profiles = known(learning("person", update="median", window=3))
    for number, age in enumerate((5.0, 5.0, 1.0)):
        teach(profiles, f"f{number}", age=age)
    assert ages(profiles)[""] == 4.75
    teach(profiles, "a", age=1.0, where=run("anna"))
    assert ages(profiles)[ANNA] == (4.75 + 1.0) / 2


def test_restarted_host_drops_layers_and_receives_existing_ones():
    ledger = Ledger(":memory:")
    profiles = known(ledger=ledger)
    guide = entry(learning=PERSON)
    assert profiles.register_card(card(guide, instance="i2"))[0] == ()
    teach(profiles, "f1", where=run("anna"))
    for fresh in (profiles, Profiles(SPACE, ledger)):
        deliveries, _ = fresh.register_card(card(guide, instance="i3"))
        assert deliveries == (Delivery(host="/agents", agent="", remove=True),)
        assert [(d.layer, d.values) for d in fresh.layers_at("/agents")] == [(ANNA, (4.0, 3.0))]
        # A card of the same start has nothing new.
        assert fresh.register_card(card(guide, instance="i3"))[0] == ()


def test_author_edit_reaches_layers_at_host():
    profiles = known()
    teach(profiles, "f1", where=run("anna"))
    edited = entry(profile=(3.0, 1.5), learning=PERSON)
    deliveries, _ = profiles.register_card(card(edited))
    assert [(d.layer, d.values) for d in deliveries] == [("", (3.0, 1.5)), (ANNA, (4.0, 1.5))]


def test_layers_are_bounded_and_existing_ones_still_learn(monkeypatch):
    monkeypatch.setattr(profiles_module, "MOST_LAYERS", 2)
    assert layers_module.MOST_LAYERS == 1000
    profiles = known()
    for name in ("anna", "bob"):
        teach(profiles, name, where=run(name))
    with pytest.raises(Refused, match=r"TOO_MANY_LAYERS: guide has .* 2 persons and places"):
        teach(profiles, "carl", where=run("carl"))
    assert set(ages(profiles)) == {"", ANNA, "person/bob"}
    # If everybody's profile learns as well, only the person's own is omitted.
    profiles.register_card(card(entry(learning=learning("person", general=0.5))))
    before = ages(profiles)
    change = teach(profiles, "dora", where=run("dora"))
    assert set(ages(profiles)) == set(before)
    assert ages(profiles)[""] != before[""]
    assert "2 persons and places" in change.text
    assert change.revision.cause.scene_id == ""
    assert not teach(profiles, "dora", where=run("dora")).fresh
    assert teach(profiles, "again", where=run("bob")).fresh


def test_wrong_share_is_reported_per_layer():
    profiles = known()
    for number in range(10):
        odd = number % 5 == 4
        change = teach(profiles, f"f{number}", age=5.0 if odd else 2.0, where=run("anna"))
    assert change.false_rate == pytest.approx(0.2)
    assert profiles.false_rate("guide", ANNA) == pytest.approx(0.2)
    assert math.isnan(profiles.false_rate("guide"))


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[2J", "a\0b"])
def test_person_with_invalid_layer_name_is_rejected(name):
    profiles = known()
    with pytest.raises(Refused, match="BAD_LAYER"):
        teach(profiles, "f1", where=run(name))
    assert set(ages(profiles)) == {""}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The requests for earlier feedback of a profile."""
    asked, found = [], profiles_module.past_targets
    monkeypatch.setattr(
        profiles_module, "past_targets", lambda *args: asked.append(args) or found(*args)
    )
    return asked


def test_wrong_share_is_computed_once_per_revision(asked):
    profiles = known()
    for number in range(9):
        teach(profiles, f"f{number}", age=2.0 + number % 2, where=run("anna"))
    asked.clear()
    first = profiles.false_rate("guide", ANNA)
    assert (profiles.false_rate("guide", ANNA), asked) == (first, [])
    fresh = Profiles(SPACE, profiles._ledger)
    assert [fresh.false_rate("guide", ANNA) for _ in range(2)] == [first, first]
    assert len(asked) == 1


def test_retreat_target_counts_after_restart_and_file_change():
    for later in (1.0, 5.0):
        ledger = Ledger(":memory:")
        rules = [learning(update="median", window=3, retreat=(age, NAN)) for age in (1.0, later)]
        before = known(rules[0], ledger)
        teach(before, "f1", age=3.0, kind=FeedbackKind.NEGATIVE, where=run())
        assert ages(before)[""] == 2.0
        assert teach(known(rules[1], ledger), "f2", age=4.0).after[0] == 2.25


# --- cached feedback ------------------------------------------------------------------------


def give(profiles: Profiles, number: int, random: Random) -> None:
    kind, values = random.choice([*FeedbackKind]), (random.uniform(1, 5), random.uniform(1, 5))
    told = {"feedback_id": f"f{number}", "source": "me", "reason": "", "run": None}
    profiles.apply("guide", kind, values, **told)


def test_cached_and_reread_feedback_teach_the_same():
    histories = []
    for forgets in (False, True):
        random, ledger = Random(3), Ledger(":memory:")
        rule = learning(update="median")
        profiles = known(rule, ledger)
        for number in range(60):
            if number == 40:
                rule = replace(rule, window=9)
                profiles.register_card(card(entry(learning=rule)))
            if forgets:
                profiles = known(rule, ledger)
            if number % 17 == 16:
                profiles.on_recorded([ledger.undo("guide")])
            give(profiles, number, random)
        histories.append([(row.profile, row.cause) for row in ledger.history("guide")])
    assert histories[0] == histories[1]


def test_feedback_reads_no_earlier_feedback(asked):
    profiles, random = known(learning(update="median")), Random(1)
    for number in range(5):
        give(profiles, number, random)
    assert len(asked) == 1
    profiles.on_recorded([profiles._ledger.undo("guide")])
    asked.clear()
    for number in (8, 9):
        give(profiles, number, random)
    assert len(asked) == 1
