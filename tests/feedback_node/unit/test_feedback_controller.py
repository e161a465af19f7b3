# SPDX-License-Identifier: Apache-2.0
"""Which feedback reaches which profile: rules of the run, people, prepared lists."""

from __future__ import annotations

import itertools
import math
from contextlib import suppress
from dataclasses import replace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.experiment import PreparedFeedback
from bt_agents_language.model.mood_rule import MoodAction
from feedback_node.announced_runs import AnnouncedRun, AnnouncedRuns
from feedback_node.learning.cards import AgentEntry, LearningCard, LearningEntry
from feedback_node.learning.feedback_controller import (
    MOST_PENDING,
    SETTLE_S,
    FeedbackController,
    FeedbackRequest,
)
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError
from feedback_node.mood_trace import LeafMood
from feedback_node.simulated_feedback import SimulatedFeedback

NAN = math.nan
SPACE = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "mood")
    ),
    mood="mood",
)
WORSE = restore_mood_rule(
    SPACE, when="mood.change <= -1", hold_s=1.0, give=2, action=MoodAction.CANCEL
)
GUIDE = AgentEntry(name="guide", profile=(3.0, 3.0), revision=0, learning_rate=0.5, rules=(WORSE,))
PERSONS = LearningEntry(
    update="plain",
    rates=(NAN, NAN),
    width=(1.0, 1.0),
    window=5,
    drift=(NAN, NAN),
    layers=("person",),
    general=0.0,
)
EXPRESS = AgentEntry(name="express", profile=(2.0, 3.0), revision=0, learning_rate=0.5)
CARD = LearningCard(host="/agents", instance="i1", parameters=SPACE.names, agents=(GUIDE, EXPRESS))


def scene(age: float, mood: float, scene_id: str = "s1") -> Scene:
    values = tuple(
        SceneValue.missing(name)
        if math.isnan(value)
        else SceneValue(name=name, value=value, origin=Origin.MEASURED)
        for name, value in (("age", age), ("mood", mood))
    )
    return Scene(scene_id=scene_id, label="", person=True, values=values)


def run(number: int = 1, agent: str = "guide", awarded: Scene | None = None) -> AnnouncedRun:
    return AnnouncedRun(epoch="e", round=number, agent=agent, scene=awarded or scene(5.0, 4.0))


class Room:
    """A teaching core on a manual clock."""

    def __init__(
        self, simulated: SimulatedFeedback | None = None, card: LearningCard | None = CARD
    ) -> None:
        self.now = 0.0
        self.profiles = Profiles(SPACE, Ledger(":memory:"))
        ids = itertools.count(1)
        self.teaching = FeedbackController(
            self.profiles,
            clock=lambda: self.now,
            new_id=lambda: f"new{next(ids)}",
            simulated=simulated,
        )
        if card is not None:
            self.teaching.register_card(card)

    def profile(self, agent: str = "guide") -> tuple[float, ...]:
        return self.profiles.profile(agent)


def test_lease_change_applies_to_current_run():
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.set_lease(5.0)
    room.teaching.receive(scene(5.0, 2.0))
    room.now = 1.2
    assert len(room.teaching.tick()) == 1
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.receive(scene(5.0, 2.0))
    room.now = 1.2
    assert room.teaching.tick() == ()


# --- runs ---------------------------------------------------------------------------------


def test_replayed_start_after_its_end_starts_no_run():
    runs = AnnouncedRuns()
    assert not runs.ended(run())
    assert not runs.started(run())
    assert runs.current is None
    assert runs.last() == run()


def test_newer_start_replaces_run_with_missing_end():
    runs = AnnouncedRuns()
    assert runs.started(run(1))
    assert runs.started(run(2, "express"))
    assert not runs.ended(run(1))
    assert runs.current == run(2, "express")
    assert (runs.last(), runs.last("guide")) == (run(2, "express"), run(1))


def test_next_best_agent_may_run_after_lost_agent():
    runs = AnnouncedRuns()
    runs.started(run(1))
    runs.ended(run(1))
    assert runs.started(run(1, "express"))


def test_last_run_is_expected_to_be_collected_once():
    runs = AnnouncedRuns()
    assert not runs.collecting
    runs.started(run())
    assert runs.collecting
    runs.ended(run())
    assert not runs.collecting
    runs.expect(run())
    assert runs.collecting
    runs.collected(run())
    assert not runs.collecting
    runs.expect(run())
    assert not runs.collecting, "the request was quicker than the news"


# --- mood rules ---------------------------------------------------------------------------


def test_next_check_is_due_when_hold_time_completes():
    room = Room()
    assert room.teaching.due == math.inf
    room.teaching.on_run_started(run())
    assert room.teaching.due == math.inf
    room.now = 3.0
    assert room.teaching.receive(scene(5.0, 2.5)) == ()
    assert room.teaching.due == 4.0
    room.now = room.teaching.due
    assert len(room.teaching.tick()) == 1
    assert room.teaching.due == math.inf


def test_firing_rule_moves_profile_away_and_stops_run():
    room = Room()
    room.teaching.on_run_started(run())
    assert room.teaching.watching
    assert room.teaching.receive(scene(5.0, 2.5)) == ()
    room.now = 1.0
    (outcome,) = room.teaching.tick()
    assert outcome.change is not None
    cause = outcome.change.revision.cause
    assert outcome.change.after == (2.5, 2.75)
    assert (cause.weight, cause.leaf) == (0.5, "")
    assert (cause.source, cause.kind, cause.cancels) == ("mood rule", FeedbackKind.NEGATIVE, True)
    assert cause.reason == "mood.change <= -1 held 1 s: mood 4 → 2.5"
    assert (cause.epoch, cause.round, cause.scene_id) == ("e", 1, "s1")
    assert outcome.stop is not None
    assert (outcome.stop.run, outcome.stop.live) == (run(), scene(5.0, 2.5))
    assert not room.teaching.watching


def test_firing_rule_stops_run_even_without_profile_change():
    room = Room()
    awarded = scene(NAN, NAN)
    room.teaching.on_run_started(run(awarded=awarded))
    room.teaching.receive(scene(5.0, 4.0))
    room.teaching.receive(scene(5.0, 2.0))
    room.now = 1.0
    (outcome,) = room.teaching.tick()
    assert outcome.change is None
    assert "NO_SCENE" in outcome.problem
    assert outcome.stop is not None


def test_live_scene_of_another_interaction_is_ignored():
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.receive(scene(5.0, 1.0, scene_id="s0"))
    room.now = 2.0
    assert room.teaching.tick() == ()


@pytest.mark.parametrize("end", ["on_run_ended", "on_run_cancelling"])
def test_ended_or_cancelling_run_is_not_watched(end):
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.receive(scene(5.0, 2.0))
    getattr(room.teaching, end)(run())
    room.now = 2.0
    assert room.teaching.tick() == room.teaching.receive(scene(5.0, 2.0)) == ()
    assert not room.teaching.watching


def test_events_of_another_run_change_nothing():
    room = Room()
    room.teaching.on_run_started(run(2))
    room.teaching.on_run_cancelling(run(1))
    room.teaching.on_run_ended(run(1))
    assert room.teaching.watching


def test_undecidable_rule_is_a_problem_of_its_agent():
    rule = restore_mood_rule(SPACE, when="1 / (live.mood - 3) > 0", give=2)
    room = Room(card=replace(CARD, agents=(replace(GUIDE, rules=(rule,)),)))
    room.teaching.on_run_started(run())
    [outcome] = room.teaching.receive(scene(5.0, 3.0))
    assert outcome.problem == (
        "guide: the mood rule cannot be decided: 1 / (live.mood - 3) > 0 ('/' by zero)"
    )
    assert (outcome.change, outcome.stop) == (None, None)
    assert room.teaching.receive(scene(5.0, 3.0)) == ()
    [(agent, reason)] = room.teaching.undecided
    assert f"{agent}: {reason}" == outcome.problem
    room.teaching.on_run_ended(run())
    assert room.teaching.undecided, "they are known until the next run"
    room.teaching.on_run_started(run(2))
    assert room.teaching.undecided == ()


def test_replayed_ended_run_teaches_nothing_without_hold_time():
    eager = replace(WORSE, hold_s=0.0)
    room = Room(card=replace(CARD, agents=(replace(GUIDE, rules=(eager,)),)))
    room.teaching.on_run_started(run(), replayed=True)
    assert room.teaching.receive(scene(5.0, 1.0)) == ()
    room.teaching.on_run_ended(run())
    room.now = SETTLE_S
    assert room.teaching.tick() == ()


def test_replayed_active_run_is_watched_after_settling():
    room = Room()
    room.teaching.on_run_started(run(), replayed=True)
    room.teaching.receive(scene(5.0, 1.0))
    room.now = SETTLE_S
    room.teaching.receive(scene(5.0, 1.0))
    room.now = SETTLE_S + 1.0
    assert len(room.teaching.tick()) == 1


def test_run_is_watched_once_its_card_arrives():
    room = Room(card=None)
    room.teaching.on_run_started(run())
    assert not room.teaching.watching
    room.teaching.register_card(CARD)
    assert room.teaching.watching


def test_repeated_card_does_not_refire_rule():
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.receive(scene(5.0, 2.0))
    room.now = 1.0
    assert len(room.teaching.tick()) == 1
    room.teaching.register_card(CARD)
    room.teaching.receive(scene(5.0, 2.0))
    room.now = 2.5
    assert room.teaching.tick() == ()


def test_rule_teaches_run_once_across_node_restart():
    room = Room()
    for _ in range(2):
        teaching = FeedbackController(room.profiles, clock=lambda: room.now, new_id=str)
        teaching.register_card(CARD)
        teaching.on_run_started(run())
        teaching.receive(scene(5.0, 2.0))
        room.now += 1.0
        (outcome,) = teaching.tick()
        assert outcome.stop is not None
    assert outcome.change is not None
    assert not outcome.change.fresh
    assert room.profile() == (2.5, 2.75)


def test_agent_may_set_weight_of_mood_rules():
    learning = LearningEntry(update="plain", window=5, sources=("mood rule",), weights=(1.0,))
    room = Room(card=replace(CARD, agents=(replace(GUIDE, learning=learning),)))
    room.teaching.on_run_started(run())
    room.teaching.receive(scene(5.0, 2.5))
    room.now = 1.0
    room.teaching.tick()
    assert room.profile() == (2.0, 2.5)


def test_rule_firing_again_teaches_again():
    rule = restore_mood_rule(SPACE, when="mood.change <= -1", hold_s=0.5, give=2, cooldown_s=2.0)
    room = Room(card=replace(CARD, agents=(replace(GUIDE, rules=(rule,)),)))
    room.teaching.on_run_started(run(awarded=scene(3.5, 4.0)))
    ids = []
    for _ in range(100):
        outcomes = room.teaching.receive(scene(3.5, 2.0))
        ids += [one.change.revision.cause.feedback_id for one in outcomes if one.change]
        room.now += 0.1
    assert ids[:3] == ["rule/e/1/guide/0", "rule/e/1/guide/0/1", "rule/e/1/guide/0/2"]
    assert len(ids) == 4


def test_estimated_and_default_values_teach_nothing():
    doubtful = scene(5.0, 4.0)
    values = (replace(doubtful.values[0], origin=Origin.ESTIMATED), doubtful.values[1])
    room = Room()
    room.teaching.on_run_started(run(awarded=replace(doubtful, values=values)))
    room.teaching.receive(scene(5.0, 2.5))
    room.now = 1.0
    (outcome,) = room.teaching.tick()
    assert outcome.change is not None
    assert outcome.change.after == (3.0, 2.75)
    given = FeedbackRequest(kind=FeedbackKind.POSITIVE, agent="guide", source="button")
    assert room.teaching.give(given).after == (3.0, 3.375)


# --- credit to the nodes of the tree --------------------------------------------------------


def test_mood_change_is_credited_to_leaf_running_then():
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.on_leaf(run().key, "tree/0.say")
    room.now = 0.5
    room.teaching.receive(scene(5.0, 2.5))
    room.now = 1.0
    room.teaching.on_leaf(run().key, "tree/1.ask")
    room.now = 1.5
    (outcome,) = room.teaching.tick()
    assert outcome.change is not None
    assert outcome.change.revision.cause.leaf == "tree/0.say"


def test_feedback_is_credited_to_running_or_named_leaf():
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.on_leaf(run().key, "tree/0.say")
    given = FeedbackRequest(kind=FeedbackKind.POSITIVE, source="button")
    assert room.teaching.give(given).revision.cause.leaf == "tree/0.say"
    named = replace(given, leaf="tree/4.ask")
    assert room.teaching.give(named).revision.cause.leaf == "tree/4.ask"
    room.teaching.on_run_ended(run())
    assert room.teaching.give(given).revision.cause.leaf == ""


def test_run_end_reports_mood_per_leaf():
    room = Room()
    room.teaching.on_leaf(run().key, "tree/0.say")  # heard before the start
    room.teaching.on_run_started(run())
    room.teaching.on_leaf(run(7).key, "tree/9.log")
    room.now = 1.0
    room.teaching.receive(scene(5.0, 3.5))
    room.now = 2.0
    leaves = room.teaching.on_run_ended(run())
    assert leaves == (LeafMood(leaf="tree/0.say", seconds=2.0, mean=3.75, change=-0.5),)
    assert room.teaching.on_run_ended(run()) == ()
    assert not room.teaching.wants("s1")


def test_run_without_rules_is_followed_too():
    room = Room()
    room.teaching.on_run_started(run(agent="express"))
    assert not room.teaching.watching
    assert room.teaching.wants("s1")
    assert not room.teaching.wants("s2")


# --- given feedback -----------------------------------------------------------------------


def test_unnamed_feedback_goes_to_running_or_last_agent():
    room = Room()
    room.teaching.on_run_started(run(1))
    room.teaching.on_run_ended(run(1))
    assert room.teaching.give(FeedbackRequest(kind=1)).revision.agent == "guide"
    room.teaching.on_run_started(run(2, "express"))
    assert room.teaching.give(FeedbackRequest(kind=1)).revision.agent == "express"


def test_relative_feedback_uses_last_scene_of_named_agent():
    room = Room()
    room.teaching.on_run_started(run(1))
    room.teaching.on_run_started(run(2, "express", scene(1.0, 1.0)))
    change = room.teaching.give(FeedbackRequest(agent="guide", kind=1, source="button"))
    assert change.after == (4.0, 3.5)
    assert change.revision.cause.round == 1
    assert room.teaching.give(FeedbackRequest(agent="guide", kind=2)).after == (3.5, 3.25)


LATE = scene(1.0, 2.0, "s0")


@pytest.mark.parametrize("ran_since", [True, False])
def test_late_feedback_moves_towards_its_own_scene(ran_since):
    room = Room()
    if ran_since:
        room.teaching.on_run_started(run(7))
    change = room.teaching.give(FeedbackRequest(agent="guide", kind=1, scene=LATE))
    assert change.after == (2.0, 2.5)
    cause = change.revision.cause
    assert (cause.scene_id, cause.epoch, cause.round) == ("s0", "", 0)


def test_feedback_about_last_runs_scene_belongs_to_run():
    room = Room()
    room.teaching.on_run_started(run(7))
    change = room.teaching.give(FeedbackRequest(agent="guide", kind=2, scene=scene(5.0, 4.0)))
    assert (change.after, change.revision.cause.round) == ((2.0, 2.5), 7)


def test_run_stays_taught_until_next_run_is_taught():
    room = Room()
    room.teaching.on_run_started(run(1))
    assert room.teaching.taught(run(1)) == ()
    kind = FeedbackKind.NEGATIVE
    tree = room.teaching.give(FeedbackRequest(kind=kind, source="tree", feedback_id="f1"))
    room.teaching.give(FeedbackRequest(kind=kind, source="tree", feedback_id="f1"))
    room.teaching.receive(scene(5.0, 2.0))
    room.now = 1.0
    (fired,) = room.teaching.tick()
    late = FeedbackRequest(kind=kind, scene=scene(2.0, 2.0, "of last week"))
    room.teaching.give(late)
    assert room.teaching.taught(run(1)) == (tree, fired.change)

    room.teaching.on_run_started(run(2))
    assert room.teaching.taught(run(2)) == ()
    again = room.teaching.give(FeedbackRequest(kind=kind))
    assert room.teaching.taught(run(2)) == (again,)
    assert room.teaching.taught(run(1)) == ()


def test_set_feedback_ignores_learning_rate():
    room = Room()
    change = room.teaching.give(
        FeedbackRequest(
            feedback_id="t1", agent="guide", kind=3, values=(NAN, 4.5), source="tuning"
        )
    )
    cause = change.revision.cause
    assert (change.before, change.after) == ((3.0, 3.0), (3.0, 4.5))
    assert (cause.kind, cause.rate, cause.source) == (FeedbackKind.SET, 1.0, "tuning")
    assert change.text == "mood 3 → 4.5"
    assert not room.teaching.give(
        FeedbackRequest(feedback_id="t1", agent="guide", kind=3, values=(NAN, 4.5))
    ).fresh
    assert room.profile() == (3.0, 4.5)


def test_direct_feedback_needs_no_run():
    room = Room()
    change = room.teaching.give(FeedbackRequest(agent="guide", kind=0, values=(5.0, NAN)))
    assert change.after == (4.0, 3.0)
    assert change.revision.cause.feedback_id == "new1"
    assert (change.revision.cause.epoch, change.revision.cause.round) == ("", 0)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        (FeedbackRequest(kind=0, values=(5.0, 3.0)), "NO_AGENT"),
        (FeedbackRequest(agent="ghost", kind=1), "UNKNOWN_AGENT"),
        (FeedbackRequest(agent="guide", kind=1), "NO_SCENE"),
        (FeedbackRequest(agent="guide", kind=2), "NO_SCENE"),
        (FeedbackRequest(agent="guide", kind=7), "UNKNOWN_KIND"),
        (FeedbackRequest(agent="guide", kind=1, values=(3.0, 3.0)), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=1, scene=scene(NAN, NAN)), "NO_SCENE"),
        (FeedbackRequest(agent="guide", kind=3), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=3, values=(3.0,)), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=3, values=(NAN, NAN)), "NO_OPINION"),
        (FeedbackRequest(agent="guide", kind=3, values=(3.0, 5.1)), "OUT_OF_RANGE"),
        (FeedbackRequest(agent="guide", kind=3, values=(-math.inf, 3.0)), "NOT_FINITE"),
        (FeedbackRequest(agent="guide", kind=0), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=0, values=(1.0, 2.0, 3.0)), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=0, values=(NAN, NAN)), "NO_OPINION"),
        (FeedbackRequest(agent="guide", kind=0, values=(math.inf, 3.0)), "NOT_FINITE"),
        (FeedbackRequest(agent="guide", kind=0, values=(3.0, 0.9)), "OUT_OF_RANGE"),
    ],
)
def test_inapplicable_feedback_is_rejected_and_changes_nothing(given, code):
    room = Room()
    before = room.profiles.table()
    with pytest.raises(Refused) as refusal:
        room.teaching.give(given)
    assert refusal.value.code == code
    assert room.profiles.table() == before


def test_unknown_agent_error_lists_known_agents():
    with pytest.raises(Refused, match="known are: express, guide"):
        Room().teaching.give(FeedbackRequest(agent="ghost", kind=1))


def test_same_feedback_id_is_applied_once_across_agents():
    room = Room()
    room.teaching.on_run_started(run(1))
    first = room.teaching.give(FeedbackRequest(feedback_id="b1", kind=1))
    room.teaching.on_run_started(run(2, "express"))
    again = room.teaching.give(FeedbackRequest(feedback_id="b1", kind=1))
    assert (again.fresh, again.revision) == (False, first.revision)
    assert room.profile("express") == (2.0, 3.0)


@pytest.mark.parametrize("other", [{"agent": "express", "kind": 1}, {"kind": 2}])
def test_feedback_id_of_other_feedback_is_rejected(other):
    room = Room()
    room.teaching.on_run_started(run(1))
    room.teaching.give(FeedbackRequest(feedback_id="b1", kind=1))
    with pytest.raises(Refused, match="FEEDBACK_ID_TAKEN"):
        room.teaching.give(FeedbackRequest(feedback_id="b1", **other))


# --- prepared feedback --------------------------------------------------------------------


def test_prepared_list_uses_one_row_per_run():
    room = Room(SimulatedFeedback(PreparedFeedback(sequence=((5.0, 5.0), (1.0, 1.0)))))
    first, again = room.teaching.collect(run(1)), room.teaching.collect(run(1))
    assert first is not None
    assert again is not None
    assert (first.after, first.revision.cause.source) == ((4.0, 4.0), "simulated")
    assert (again.fresh, again.revision) == (False, first.revision)
    assert room.profile() == (4.0, 4.0)
    second = room.teaching.collect(run(2))
    assert second is not None
    assert second.after == (2.5, 2.5)


@pytest.mark.parametrize(
    "simulated", [None, SimulatedFeedback(PreparedFeedback(each={"express": (5.0, 5.0)}))]
)
def test_no_feedback_is_applied_without_prepared_feedback(simulated):
    assert Room(simulated).teaching.collect(run(1)) is None


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (run(0), "NO_RUN"),
        (replace(run(1), epoch=""), "NO_RUN"),
        (run(1, "ghost"), "UNKNOWN_AGENT"),
    ],
)
def test_rejected_collection_uses_no_row(asked, code):
    room = Room(SimulatedFeedback(PreparedFeedback(sequence=((5.0, 5.0),))))
    with pytest.raises(Refused) as refusal:
        room.teaching.collect(asked)
    assert refusal.value.code == code
    assert room.teaching.collect(run(1)) is not None


@pytest.mark.parametrize("repeat", [False, True])
def test_restarted_node_continues_list_and_repeats_applied_answers(repeat):
    rows = ((5.0, 5.0), (1.0, 1.0), (3.0, 3.0))

    def prepared() -> SimulatedFeedback:
        return SimulatedFeedback(
            PreparedFeedback(each={"express": (4.0, 4.0)}, sequence=rows, repeat=repeat)
        )

    def collected(room: Room, number: int, agent: str = "guide") -> tuple[float, ...] | None:
        change = room.teaching.collect(run(number, agent))
        return None if change is None else change.target

    room = Room(prepared())
    collected(room, 1), collected(room, 2, "express"), collected(room, 3)
    again = Room(prepared(), None)
    again.teaching.profiles = room.profiles
    assert collected(again, 3) == rows[1]
    assert collected(again, 4) == rows[2]
    assert collected(again, 5) == (rows[0] if repeat else None)
    assert collected(again, 1) == rows[0]
    assert len(room.profiles._ledger.history("guide")) == (5 if repeat else 4)


def test_list_starts_at_first_row_for_another_market():
    room = Room(SimulatedFeedback(PreparedFeedback(sequence=((5.0, 5.0),))))
    room.teaching.collect(run(1))
    other = FeedbackController(
        room.profiles,
        clock=lambda: 0.0,
        new_id=str,
        simulated=SimulatedFeedback(PreparedFeedback(sequence=((1.0, 1.0),))),
    )
    assert other.collect(replace(run(1), epoch="another")) is not None


def test_third_paper_experiment_keeps_agents_on_own_feedback():
    simulated = SimulatedFeedback(
        PreparedFeedback(each={"guide": (5.0, 5.0), "express": (1.0, 1.0)})
    )
    room = Room(simulated)
    for number in range(1, 41):
        room.teaching.collect(run(number, "guide" if number % 2 else "express"))
    assert room.profile("guide") == pytest.approx((5.0, 5.0), abs=1e-4)
    assert room.profile("express") == pytest.approx((1.0, 1.0), abs=1e-4)


def full(room: Room, on: bool) -> None:
    database = room.profiles._ledger._database
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    database.execute(f"PRAGMA max_page_count = {pages if on else 1_000_000}")
    given = FeedbackRequest(agent="express", kind=3, values=(2.0, 3.0), source="t")
    for reason in ("long" * 200, "") if on else ():
        with suppress(LedgerError):
            for _ in range(1000):
                room.teaching.give(replace(given, reason=reason))


def test_lesson_during_full_disk_is_recorded_later():
    room = Room()
    room.teaching.on_run_started(run())
    room.teaching.receive(scene(5.0, 2.5))
    full(room, on=True)
    room.now = 1.0
    (outcome,) = room.teaching.tick()
    assert outcome.change is None
    assert "STORAGE_FULL" in outcome.problem
    assert outcome.problem.endswith("; it is tried again until there is room")
    assert outcome.stop is not None
    assert room.teaching.retry() == ()
    room.teaching.on_run_ended(run())
    full(room, on=False)
    (late,) = room.teaching.retry()
    assert late.change is not None
    assert (late.change.after, late.stop) == ((2.5, 2.75), None)
    assert room.profiles.recorded("rule/e/1/guide/0") is not None
    assert room.teaching.retry() == ()


def test_pending_lessons_during_full_disk_are_bounded():
    room = Room()
    full(room, on=True)
    problems = []
    for number in range(1, MOST_PENDING + 2):
        room.teaching.on_run_started(run(number))
        room.teaching.receive(scene(5.0, 2.5))
        room.now += 1.0
        problems += [outcome.problem for outcome in room.teaching.tick()]
        room.teaching.on_run_ended(run(number))
    assert len(problems) == MOST_PENDING + 1
    assert ["lost is that of guide in round 1" in one for one in problems[-2:]] == [False, True]
    full(room, on=False)
    assert len(room.teaching.retry()) == MOST_PENDING


def test_full_disk_uses_no_row_of_prepared_list():
    rows = SimulatedFeedback(PreparedFeedback(sequence=((1.0, NAN), (2.0, NAN), (5.0, NAN))))
    room = Room(rows)
    assert room.teaching.collect(run(1)) is not None
    full(room, on=True)
    with pytest.raises(Refused, match="STORAGE_FULL"):
        room.teaching.collect(run(2))
    full(room, on=False)
    change = room.teaching.collect(run(2))
    assert change is not None
    assert change.target[0] == 2.0


def test_late_repetition_of_forgotten_feedback_is_recognised():
    room = Room(card=replace(CARD, agents=(replace(GUIDE, learning=PERSONS), EXPRESS)))
    anna = replace(scene(5.0, 4.0), person_id="anna")
    given = FeedbackRequest(feedback_id="x", agent="guide", kind=1, source="me", scene=anna)
    assert room.teaching.give(given).fresh
    room.profiles._ledger.forget([("guide", "person/anna")])
    room.profiles.on_erased([("guide", "person/anna")])
    again = room.teaching.give(given)
    assert (again.fresh, "forgotten since" in again.text) == (False, True)
    with pytest.raises(Refused, match="FEEDBACK_ID_TAKEN"):
        room.teaching.give(replace(given, agent="express"))


# --- what no profile has ------------------------------------------------------------------

PAIN = SceneParameter(name="pain", minimum=0.0, maximum=10.0, default=0.0, profiled=False)
BESIDE = SceneSpace(
    parameters=(SPACE.parameters[0], replace(SPACE.parameters[1], profiled=False), PAIN),
    mood="mood",
)


def hurting(age: float, mood: float, pain: float) -> Scene:
    of = scene(age, mood)
    pained = SceneValue(name="pain", value=pain, origin=Origin.TOLD)
    return replace(of, values=BESIDE.scene((*of.values, pained)))


class Ward(Room):
    """A teaching core whose profiles have the age alone."""

    def __init__(self) -> None:
        super().__init__(card=None)
        self.profiles = Profiles(BESIDE, Ledger(":memory:"))
        self.teaching = FeedbackController(
            self.profiles, clock=lambda: self.now, new_id=lambda: "new"
        )
        nurse = AgentEntry(
            name="nurse",
            profile=(3.0,),
            revision=0,
            learning_rate=0.5,
            rules=(
                restore_mood_rule(
                    BESIDE, when="live.pain > 7", hold_s=0.0, give=2, action=MoodAction.CANCEL
                ),
                restore_mood_rule(
                    BESIDE, when="mood.change <= -1", hold_s=0.0, give=2, action=MoodAction.CANCEL
                ),
            ),
        )
        self.teaching.register_card(
            LearningCard(
                host="/agents", instance="i1", parameters=BESIDE.profiles.names, agents=(nurse,)
            )
        )


def test_feedback_moves_only_profiled_parameters():
    ward = Ward()
    ward.teaching.on_run_started(run(1, "nurse", hurting(5.0, 4.0, 2.0)))
    change = ward.teaching.give(
        FeedbackRequest(
            feedback_id="", agent="nurse", kind=FeedbackKind.POSITIVE, values=(), source="person"
        )
    )
    assert (change.before, change.target, change.after) == ((3.0,), (5.0,), (4.0,))
    assert change.revision.profile == {"age": 4.0}


def test_scene_without_known_profiled_values_teaches_nothing():
    ward = Ward()
    ward.teaching.on_run_started(run(1, "nurse", hurting(NAN, 4.0, 2.0)))
    with pytest.raises(Refused) as refused:
        ward.teaching.give(
            FeedbackRequest(
                feedback_id="", agent="nurse", kind=FeedbackKind.POSITIVE, values=(), source="p"
            )
        )
    assert refused.value.code == "NO_SCENE"


@pytest.mark.parametrize("now", [(5.0, 4.0, 8.0), (5.0, 2.0, 2.0)])
def test_rules_may_read_unprofiled_parameters_including_mood(now):
    ward = Ward()
    ward.teaching.on_run_started(run(1, "nurse", hurting(5.0, 4.0, 2.0)))
    (fired,) = ward.teaching.receive(hurting(*now))
    assert fired.stop is not None
    assert fired.change is not None
    assert fired.change.after < (3.0,)


# --- what the person tells in a run -------------------------------------------------------


def telling(age: float, person_id: str = "") -> Scene:
    live = scene(3.0, 4.0)
    told = SceneValue(name="age", value=age, origin=Origin.TOLD)
    return replace(live, values=(told, live.values[1]), person_id=person_id)


def negative(room: Room) -> tuple[float, ...]:
    request = FeedbackRequest(
        feedback_id="", agent="guide", kind=FeedbackKind.NEGATIVE, values=(), source="person"
    )
    return room.teaching.give(request).target


@pytest.mark.parametrize("ended", [False, True])
def test_told_values_count_in_feedback_about_their_run(ended):
    room = Room()
    room.teaching.on_run_started(run(awarded=scene(3.0, 4.0)))
    assert negative(room) == (3.0, 4.0)
    room.teaching.receive(telling(4.0))
    room.teaching.receive(scene(2.0, 1.0))  # what is only measured later does not count
    if ended:
        room.teaching.on_run_ended(run(awarded=scene(3.0, 4.0)))
    assert negative(room) == (4.0, 4.0)


def test_values_told_by_another_person_are_ignored():
    room = Room()
    room.teaching.on_run_started(run(awarded=replace(scene(3.0, 4.0), person_id="anna")))
    room.teaching.receive(telling(5.0, "bert"))
    assert negative(room) == (3.0, 4.0)
    room.teaching.receive(telling(4.0, "anna"))
    assert negative(room) == (4.0, 4.0)
