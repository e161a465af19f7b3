# SPDX-License-Identifier: Apache-2.0
"""Routing of feedback to profiles: from mood rules, people and prepared lists."""

from __future__ import annotations

import itertools
import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.experiment import PreparedFeedback
from bt_agents_language.model.mood_rule import MoodAction
from feedback_node.announced_runs import AnnouncedRun, AnnouncedRuns
from feedback_node.learning.cards import AgentEntry, LearningEntry
from feedback_node.learning.feedback_controller import (
    MOST_PENDING,
    SETTLE_S,
    FeedbackController,
    FeedbackRequest,
)
from feedback_node.learning.profiles import ProfileChange, Profiles
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import LedgerError
from feedback_node.mood_trace import LeafMood
from feedback_node.simulated_feedback import SimulatedFeedback
from learning_cards import card, entry
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import age_and_mood as scene

NAN = math.nan
WORSE = restore_mood_rule(
    SPACE, when="mood.change <= -1", hold_s=1.0, give=2, action=MoodAction.CANCEL
)
GUIDE = entry(rules=(WORSE,))
EXPRESS = entry("express", (2.0, 3.0))


def run(number: int = 1, agent: str = "guide", awarded: Scene | None = None) -> AnnouncedRun:
    return AnnouncedRun(epoch="e", round=number, agent=agent, scene=awarded or scene(5.0, 4.0))


class FeedbackHarness:
    """A feedback controller on a manual clock, with the prepared feedback of an experiment."""

    def __init__(self, *agents: AgentEntry, profiles: Profiles | None = None, **prepared: Any):
        self.now = 0.0
        self.profiles = profiles or Profiles(SPACE, Ledger(":memory:"))
        ids = itertools.count(1)
        self.controller = FeedbackController(
            self.profiles,
            clock=lambda: self.now,
            new_id=lambda: f"new{next(ids)}",
            simulated=SimulatedFeedback(PreparedFeedback(**prepared)) if prepared else None,
        )
        if profiles is None:
            self.controller.register_card(card(*agents or (GUIDE, EXPRESS)))

    def give(self, **fields: Any) -> ProfileChange:
        return self.controller.give(FeedbackRequest(**fields))

    def collect(self, number: int, agent: str = "guide") -> tuple[float, ...] | None:
        """Return the prepared feedback for a run, or None."""
        change = self.controller.collect(run(number, agent))
        return None if change is None else change.target

    def at(self, now: float) -> FeedbackController:
        """Return the controller, after its clock has moved."""
        self.now = now
        return self.controller

    def profile(self, agent: str = "guide") -> tuple[float, ...]:
        return self.profiles.profile(agent)


@pytest.fixture
def harness() -> FeedbackHarness:
    return FeedbackHarness()


@pytest.fixture
def running(harness: FeedbackHarness) -> FeedbackHarness:
    """A feedback controller during a run of the guide."""
    harness.controller.on_run_started(run())
    return harness


def test_lease_change_applies_to_current_run(running):
    running.controller.receive(scene(5.0, 2.0))
    assert running.at(1.2).tick() == ()
    running.controller.set_lease(5.0)
    running.controller.receive(scene(5.0, 2.0))
    assert len(running.at(2.4).tick()) == 1


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
    found = [runs.collecting]
    # The last request is quicker than the news.
    for step in (runs.started, runs.ended, runs.expect, runs.collected, runs.expect):
        step(run())
        found.append(runs.collecting)
    assert found == [False, True, False, True, False, False]


# --- mood rules ---------------------------------------------------------------------------


def test_next_check_is_due_when_hold_time_completes(harness):
    assert harness.controller.due == math.inf
    harness.controller.on_run_started(run())
    assert harness.controller.due == math.inf
    assert harness.at(3.0).receive(scene(5.0, 2.5)) == ()
    assert harness.controller.due == 4.0
    assert len(harness.at(harness.controller.due).tick()) == 1
    assert harness.controller.due == math.inf


def test_firing_rule_moves_profile_away_and_stops_run(running):
    assert running.controller.watching
    assert running.controller.receive(scene(5.0, 2.5)) == ()
    (outcome,) = running.at(1.0).tick()
    cause = outcome.change.revision.cause
    assert outcome.change.after == (2.5, 2.75)
    assert (cause.weight, cause.leaf) == (0.5, "")
    assert (cause.source, cause.kind, cause.cancels) == ("mood rule", FeedbackKind.NEGATIVE, True)
    assert cause.reason == "mood.change <= -1 held 1 s: mood 4 → 2.5"
    assert (cause.epoch, cause.round, cause.scene_id) == ("e", 1, "s1")
    assert (outcome.stop.run, outcome.stop.live) == (run(), scene(5.0, 2.5))
    assert not running.controller.watching


def test_firing_rule_stops_run_even_without_profile_change(harness):
    awarded = scene(NAN, NAN)
    harness.controller.on_run_started(run(awarded=awarded))
    harness.controller.receive(scene(5.0, 4.0))
    harness.controller.receive(scene(5.0, 2.0))
    (outcome,) = harness.at(1.0).tick()
    assert outcome.change is None
    assert "NO_SCENE" in outcome.problem
    assert outcome.stop is not None


def test_live_scene_of_another_interaction_is_ignored(running):
    running.controller.receive(scene(5.0, 1.0, scene_id="s0"))
    assert running.at(2.0).tick() == ()


@pytest.mark.parametrize("end", ["on_run_ended", "on_run_cancelling"])
def test_ended_or_cancelling_run_is_not_watched(running, end):
    running.controller.receive(scene(5.0, 2.0))
    getattr(running.controller, end)(run())
    assert running.at(2.0).tick() == running.controller.receive(scene(5.0, 2.0)) == ()
    assert not running.controller.watching


def test_events_of_another_run_change_nothing(harness):
    harness.controller.on_run_started(run(2))
    harness.controller.on_run_cancelling(run(1))
    harness.controller.on_run_ended(run(1))
    assert harness.controller.watching


def test_undecidable_rule_is_a_problem_of_its_agent():
    rule = restore_mood_rule(SPACE, when="1 / (live.mood - 3) > 0", give=2)
    harness = FeedbackHarness(entry(rules=(rule,)))
    harness.controller.on_run_started(run())
    [outcome] = harness.controller.receive(scene(5.0, 3.0))
    assert outcome.problem == (
        "guide: the mood rule cannot be decided: 1 / (live.mood - 3) > 0 ('/' by zero)"
    )
    assert (outcome.change, outcome.stop) == (None, None)
    assert harness.controller.receive(scene(5.0, 3.0)) == ()
    [(agent, reason)] = harness.controller.undecided
    assert f"{agent}: {reason}" == outcome.problem
    harness.controller.on_run_ended(run())
    assert harness.controller.undecided, "they are known until the next run"
    harness.controller.on_run_started(run(2))
    assert harness.controller.undecided == ()


def test_replayed_ended_run_teaches_nothing_without_hold_time():
    harness = FeedbackHarness(entry(rules=(replace(WORSE, hold_s=0.0),)))
    harness.controller.on_run_started(run(), replayed=True)
    assert harness.controller.receive(scene(5.0, 1.0)) == ()
    harness.controller.on_run_ended(run())
    assert harness.at(SETTLE_S).tick() == ()


def test_replayed_active_run_is_watched_after_settling(harness):
    harness.controller.on_run_started(run(), replayed=True)
    harness.controller.receive(scene(5.0, 1.0))
    harness.at(SETTLE_S).receive(scene(5.0, 1.0))
    assert len(harness.at(SETTLE_S + 1.0).tick()) == 1


def test_run_is_watched_once_its_card_arrives():
    harness = FeedbackHarness(EXPRESS)
    harness.controller.on_run_started(run())
    assert not harness.controller.watching
    harness.controller.register_card(card(GUIDE))
    assert harness.controller.watching


def test_repeated_card_does_not_refire_rule(running):
    running.controller.receive(scene(5.0, 2.0))
    assert len(running.at(1.0).tick()) == 1
    running.controller.register_card(card(GUIDE, EXPRESS))
    running.controller.receive(scene(5.0, 2.0))
    assert running.at(2.5).tick() == ()


def test_rule_teaches_run_once_across_node_restart(harness):
    for _ in range(2):
        controller = FeedbackController(harness.profiles, clock=lambda: harness.now, new_id=str)
        controller.register_card(card(GUIDE))
        controller.on_run_started(run())
        controller.receive(scene(5.0, 2.0))
        harness.now += 1.0
        (outcome,) = controller.tick()
        assert outcome.stop is not None
    assert not outcome.change.fresh
    assert harness.profile() == (2.5, 2.75)


def test_agent_may_set_weight_of_mood_rules():
    learning = LearningEntry(update="plain", window=5, sources=("mood rule",), weights=(1.0,))
    harness = FeedbackHarness(replace(GUIDE, learning=learning))
    harness.controller.on_run_started(run())
    harness.controller.receive(scene(5.0, 2.5))
    harness.at(1.0).tick()
    assert harness.profile() == (2.0, 2.5)


def test_rule_firing_again_teaches_again():
    rule = restore_mood_rule(SPACE, when="mood.change <= -1", hold_s=0.5, give=2, cooldown_s=2.0)
    harness = FeedbackHarness(entry(rules=(rule,)))
    harness.controller.on_run_started(run(awarded=scene(3.5, 4.0)))
    ids = []
    for _ in range(100):
        outcomes = harness.controller.receive(scene(3.5, 2.0))
        ids += [one.change.revision.cause.feedback_id for one in outcomes if one.change]
        harness.now += 0.1
    assert ids[:3] == ["rule/e/1/guide/0", "rule/e/1/guide/0/1", "rule/e/1/guide/0/2"]
    assert len(ids) == 4


def test_estimated_values_teach_nothing(harness):
    doubtful = scene(5.0, 4.0)
    values = (replace(doubtful.values[0], origin=Origin.ESTIMATED), doubtful.values[1])
    harness.controller.on_run_started(run(awarded=replace(doubtful, values=values)))
    harness.controller.receive(scene(5.0, 2.5))
    (outcome,) = harness.at(1.0).tick()
    assert outcome.change.after == (3.0, 2.75)
    assert harness.give(agent="guide", kind=1).after == (3.0, 3.375)


# --- credit to the nodes of the tree --------------------------------------------------------


def test_mood_change_is_credited_to_leaf_running_then(running):
    running.controller.on_leaf(run().key, "tree/0.say")
    running.at(0.5).receive(scene(5.0, 2.5))
    running.at(1.0).on_leaf(run().key, "tree/1.ask")
    (outcome,) = running.at(1.5).tick()
    assert outcome.change.revision.cause.leaf == "tree/0.say"


def test_feedback_is_credited_to_running_or_named_leaf(running):
    running.controller.on_leaf(run().key, "tree/0.say")
    assert running.give(kind=1).revision.cause.leaf == "tree/0.say"
    assert running.give(kind=1, leaf="tree/4.ask").revision.cause.leaf == "tree/4.ask"
    running.controller.on_run_ended(run())
    assert running.give(kind=1).revision.cause.leaf == ""


def test_run_end_reports_mood_per_leaf(harness):
    harness.controller.on_leaf(run().key, "tree/0.say")  # received before the start
    harness.controller.on_run_started(run())
    harness.controller.on_leaf(run(7).key, "tree/9.log")
    harness.at(1.0).receive(scene(5.0, 3.5))
    leaves = harness.at(2.0).on_run_ended(run())
    assert leaves == (LeafMood(leaf="tree/0.say", seconds=2.0, mean=3.75, change=-0.5),)
    assert harness.controller.on_run_ended(run()) == ()
    assert not harness.controller.wants("s1")


def test_run_without_rules_is_followed_too(harness):
    harness.controller.on_run_started(run(agent="express"))
    assert not harness.controller.watching
    assert harness.controller.wants("s1")
    assert not harness.controller.wants("s2")


# --- given feedback -----------------------------------------------------------------------


def test_unnamed_feedback_goes_to_running_or_last_agent(running):
    running.controller.on_run_ended(run())
    assert running.give(kind=1).revision.agent == "guide"
    running.controller.on_run_started(run(2, "express"))
    assert running.give(kind=1).revision.agent == "express"


def test_relative_feedback_uses_last_scene_of_named_agent(running):
    running.controller.on_run_started(run(2, "express", scene(1.0, 1.0)))
    change = running.give(agent="guide", kind=1)
    assert (change.after, change.revision.cause.round) == ((4.0, 3.5), 1)
    assert running.give(agent="guide", kind=2).after == (3.5, 3.25)


LATE = scene(1.0, 2.0, "s0")


@pytest.mark.parametrize("ran_since", [True, False])
def test_late_feedback_moves_towards_its_own_scene(harness, ran_since):
    if ran_since:
        harness.controller.on_run_started(run(7))
    change = harness.give(agent="guide", kind=1, scene=LATE)
    assert change.after == (2.0, 2.5)
    cause = change.revision.cause
    assert (cause.scene_id, cause.epoch, cause.round) == ("s0", "", 0)


def test_feedback_about_last_runs_scene_belongs_to_run(running):
    change = running.give(agent="guide", kind=2, scene=scene(5.0, 4.0))
    assert (change.after, change.revision.cause.round) == ((2.0, 2.5), 1)


def test_run_stays_taught_until_next_run_is_taught(running):
    taught = running.controller.taught
    assert taught(run(1)) == ()
    tree = running.give(kind=2, source="tree", feedback_id="f1")
    running.give(kind=2, source="tree", feedback_id="f1")
    running.controller.receive(scene(5.0, 2.0))
    (fired,) = running.at(1.0).tick()
    running.give(kind=2, scene=scene(2.0, 2.0, "of last week"))
    assert taught(run(1)) == (tree, fired.change)

    running.controller.on_run_started(run(2))
    assert taught(run(2)) == ()
    again = running.give(kind=2)
    assert (taught(run(2)), taught(run(1))) == ((again,), ())


def test_set_feedback_applies_to_expected_values_once(harness):
    given = {"agent": "guide", "kind": 3, "values": (NAN, 4.5), "expected": (NAN, 3.0)}
    change = harness.give(feedback_id="t1", source="tuning", **given)
    cause = change.revision.cause
    assert (change.fresh, change.before, change.after) == (True, (3.0, 3.0), (3.0, 4.5))
    assert (cause.kind, cause.rate, cause.source) == (FeedbackKind.SET, 1.0, "tuning")
    assert change.text == "mood 3 → 4.5"
    assert not harness.give(feedback_id="t1", **given).fresh
    with pytest.raises(Refused, match=r"_MEANWHILE: mood of guide is 4\.5 now, expected 3$"):
        harness.give(feedback_id="t2", **given)
    assert harness.profile() == (3.0, 4.5)


def test_direct_feedback_needs_no_run(harness):
    change = harness.give(agent="guide", kind=0, values=(5.0, NAN))
    cause = change.revision.cause
    assert change.after == (4.0, 3.0)
    assert (cause.feedback_id, cause.epoch, cause.round) == ("new1", "", 0)


TOLD = {"agent": "guide", "kind": 0, "values": (5.0, NAN)}


def test_control_characters_are_stripped_from_reason(harness):
    change = harness.give(**TOLD, reason="so\n \x1b[2J far")
    assert change.revision.cause.reason == "so [2J far"


@pytest.mark.parametrize(
    ("given", "code"),
    [
        *(
            (FeedbackRequest(**TOLD | {field: "x" * 1001}), f"TOO_LONG: feedback: {field}")
            for field in ("feedback_id", "source", "reason")
        ),
        (FeedbackRequest(**TOLD, source="a\x1b"), "BAD_TEXT"),
        (FeedbackRequest(**TOLD, feedback_id="a\0"), "BAD_TEXT"),
        (FeedbackRequest(**TOLD, leaf="a\n"), "BAD_TEXT"),
        # Ids like this are kept of forgotten feedback.
        (FeedbackRequest(**TOLD, feedback_id="sha256:00"), "RESERVED_ID"),
        (FeedbackRequest(kind=0, values=(5.0, 3.0)), "NO_AGENT"),
        (FeedbackRequest(agent="ghost", kind=1), "UNKNOWN_AGENT: .*; known are: express, guide$"),
        (FeedbackRequest(agent="guide", kind=1), "NO_SCENE"),
        (FeedbackRequest(agent="guide", kind=7), "UNKNOWN_KIND"),
        (FeedbackRequest(agent="guide", kind=1, values=(3.0, 3.0)), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=1, scene=scene(NAN, NAN)), "NO_SCENE"),
        (FeedbackRequest(agent="guide", kind=3, values=(3.0,)), "WRONG_LENGTH"),
        (FeedbackRequest(agent="guide", kind=3, values=(NAN, NAN)), "NO_OPINION"),
        (FeedbackRequest(agent="guide", kind=3, values=(3.0, 5.1)), "OUT_OF_RANGE"),
        (FeedbackRequest(agent="guide", kind=3, values=(-math.inf, 3.0)), "NOT_FINITE"),
        (FeedbackRequest(agent="guide", kind=1, scene=LATE, expected=(3.0,)), "WRONG_LENGTH"),
        (FeedbackRequest(agent="ghost", kind=3, expected=(3.0, 3.0)), "UNKNOWN_AGENT"),
        (
            FeedbackRequest(agent="guide", kind=3, values=(2.0, 3.0), expected=(NAN, 3.1)),
            "CHANGED_MEANWHILE",
        ),
        (FeedbackRequest(agent="guide", kind=0), "WRONG_LENGTH"),
    ],
)
def test_inapplicable_feedback_is_rejected_and_changes_nothing(harness, given, code):
    before = harness.profiles.table()
    with pytest.raises(Refused, match=rf"^{code}\b"):
        harness.controller.give(given)
    assert harness.profiles.table() == before


def test_same_feedback_id_is_applied_once_across_agents(running):
    first = running.give(feedback_id="b1", kind=1)
    running.controller.on_run_started(run(2, "express"))
    again = running.give(feedback_id="b1", kind=1)
    assert (again.fresh, again.revision) == (False, first.revision)
    assert (again.before, again.after) == (first.before, first.after)
    assert running.profile("express") == (2.0, 3.0)


@pytest.mark.parametrize("other", [{"agent": "express", "kind": 1}, {"kind": 2}])
def test_feedback_id_of_other_feedback_is_rejected(running, other):
    running.give(feedback_id="b1", kind=1)
    with pytest.raises(Refused, match="FEEDBACK_ID_TAKEN"):
        running.give(feedback_id="b1", **other)


# --- prepared feedback --------------------------------------------------------------------


def test_prepared_list_uses_one_row_per_run():
    harness = FeedbackHarness(sequence=((5.0, 5.0), (1.0, 1.0)))
    first, again = harness.controller.collect(run(1)), harness.controller.collect(run(1))
    assert (first.after, first.revision.cause.source) == ((4.0, 4.0), "simulated")
    assert (again.fresh, again.revision) == (False, first.revision)
    assert harness.profile() == (4.0, 4.0)
    assert harness.controller.collect(run(2)).after == (2.5, 2.5)


@pytest.mark.parametrize("prepared", [{}, {"each": {"express": (5.0, 5.0)}}])
def test_no_feedback_is_applied_without_prepared_feedback(prepared):
    assert FeedbackHarness(**prepared).controller.collect(run(1)) is None


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (run(0), "NO_RUN"),
        (replace(run(1), epoch=""), "NO_RUN"),
        (run(1, "ghost"), "UNKNOWN_AGENT"),
    ],
)
def test_rejected_collection_uses_no_row(asked, code):
    harness = FeedbackHarness(sequence=((5.0, 5.0),))
    with pytest.raises(Refused, match=f"^{code}:"):
        harness.controller.collect(asked)
    assert harness.controller.collect(run(1)) is not None


@pytest.mark.parametrize("repeat", [False, True])
def test_restarted_node_continues_list_and_repeats_applied_answers(repeat):
    rows = ((5.0, 5.0), (1.0, 1.0), (3.0, 3.0))
    prepared = {"each": {"express": (4.0, 4.0)}, "sequence": rows, "repeat": repeat}
    harness = FeedbackHarness(**prepared)
    harness.collect(1), harness.collect(2, "express"), harness.collect(3)
    again = FeedbackHarness(profiles=harness.profiles, **prepared)
    found = [again.collect(number) for number in (3, 4, 5, 1)]
    assert found == [rows[1], rows[2], rows[0] if repeat else None, rows[0]]
    assert len(harness.profiles._ledger.history("guide")) == (5 if repeat else 4)


def test_list_starts_at_first_row_for_another_market():
    harness = FeedbackHarness(sequence=((5.0, 5.0),))
    harness.controller.collect(run(1))
    other = FeedbackHarness(profiles=harness.profiles, sequence=((1.0, 1.0),))
    assert other.controller.collect(replace(run(1), epoch="another")) is not None


def full(harness: FeedbackHarness, on: bool) -> None:
    database = harness.profiles._ledger._database
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    database.execute(f"PRAGMA max_page_count = {pages if on else 1_000_000}")
    for reason in ("long" * 200, "") if on else ():
        with suppress(LedgerError):
            for _ in range(1000):
                harness.give(agent="express", kind=3, values=(2.0, 3.0), reason=reason)


def test_lesson_during_full_disk_is_recorded_later(running):
    running.controller.receive(scene(5.0, 2.5))
    full(running, on=True)
    (outcome,) = running.at(1.0).tick()
    assert outcome.change is None
    assert "STORAGE_FULL" in outcome.problem
    assert outcome.problem.endswith("; it is tried again until there is room")
    assert outcome.stop is not None
    assert running.controller.retry() == ()
    running.controller.on_run_ended(run())
    full(running, on=False)
    (late,) = running.controller.retry()
    assert (late.change.after, late.stop) == ((2.5, 2.75), None)
    assert running.profiles.recorded("rule/e/1/guide/0") is not None
    assert running.controller.retry() == ()


def test_pending_lessons_during_full_disk_are_bounded(harness):
    full(harness, on=True)
    problems = []
    for number in range(1, MOST_PENDING + 2):
        harness.controller.on_run_started(run(number))
        harness.controller.receive(scene(5.0, 2.5))
        harness.now += 1.0
        problems += [outcome.problem for outcome in harness.controller.tick()]
        harness.controller.on_run_ended(run(number))
    lost = ["the feedback on guide in round 1 is lost" in one for one in problems]
    assert lost == [*[False] * MOST_PENDING, True]
    full(harness, on=False)
    assert len(harness.controller.retry()) == MOST_PENDING


def test_full_disk_uses_no_row_of_prepared_list():
    harness = FeedbackHarness(sequence=((1.0, NAN), (2.0, NAN), (5.0, NAN)))
    assert harness.controller.collect(run(1)) is not None
    full(harness, on=True)
    with pytest.raises(Refused, match="STORAGE_FULL"):
        harness.controller.collect(run(2))
    full(harness, on=False)
    assert harness.controller.collect(run(2)).target[0] == 2.0


def test_late_repetition_of_forgotten_feedback_is_recognised():
    persons = LearningEntry(update="plain", window=5, layers=("person",), general=0.5)
    harness = FeedbackHarness(entry(learning=persons), EXPRESS)
    anna = scene(5.0, 4.0, person_id="anna")
    given = FeedbackRequest(feedback_id="x", agent="guide", kind=1, scene=anna)
    assert harness.controller.give(given).fresh
    assert harness.profile() == (3.5, 3.25)
    harness.profiles._ledger.forget([("guide", "person/anna")])
    harness.profiles.on_erased([("guide", "person/anna")])
    again = harness.controller.give(given)
    assert (again.fresh, "forgotten since" in again.text) == (False, True)
    assert harness.profile() == (3.5, 3.25)
    with pytest.raises(Refused, match="FEEDBACK_ID_TAKEN"):
        harness.controller.give(replace(given, agent="express"))


# --- parameters outside profiles ----------------------------------------------------------

PAIN = SceneParameter(name="pain", minimum=0.0, maximum=10.0, default=0.0, profiled=False)
BESIDE = SceneSpace(
    parameters=(SPACE.parameters[0], replace(SPACE.parameters[1], profiled=False), PAIN),
    mood="mood",
)


def hurting(age: float, mood: float, pain: float, scene_id: str = "s1") -> Scene:
    of = scene(age, mood, scene_id)
    pained = SceneValue(name="pain", value=pain, origin=Origin.TOLD)
    return replace(of, values=BESIDE.scene((*of.values, pained)))


@pytest.fixture
def nursing() -> FeedbackHarness:
    """A feedback controller whose profiles have only the age, during a run of the nurse."""
    harness = FeedbackHarness(profiles=Profiles(BESIDE, Ledger(":memory:")))
    how = {"hold_s": 0.0, "give": 2, "action": MoodAction.CANCEL}
    conditions = ("live.pain > 7", "mood.change <= -1")
    rules = tuple(restore_mood_rule(BESIDE, when=when, **how) for when in conditions)
    nurse = entry("nurse", (3.0,), rules=rules)
    harness.controller.register_card(card(nurse, parameters=BESIDE.profiles.names))
    harness.controller.on_run_started(run(1, "nurse", hurting(5.0, 4.0, 2.0)))
    return harness


def test_feedback_moves_only_profiled_parameters(nursing):
    change = nursing.give(kind=1)
    assert (change.before, change.target, change.after) == ((3.0,), (5.0,), (4.0,))
    assert change.revision.profile == {"age": 4.0}


def test_scene_without_known_profiled_values_teaches_nothing(nursing):
    with pytest.raises(Refused, match=r"^NO_SCENE:"):
        nursing.give(kind=1, scene=hurting(NAN, 4.0, 2.0, "s2"))


@pytest.mark.parametrize("now", [(5.0, 4.0, 8.0), (5.0, 2.0, 2.0)])
def test_rules_may_read_unprofiled_parameters_including_mood(nursing, now):
    (fired,) = nursing.controller.receive(hurting(*now))
    assert fired.stop is not None
    assert fired.change.after < (3.0,)


# --- values that the person tells in a run ------------------------------------------------


def telling(age: float, person_id: str = "") -> Scene:
    live = scene(3.0, 4.0)
    told = SceneValue(name="age", value=age, origin=Origin.TOLD)
    return replace(live, values=(told, live.values[1]), person_id=person_id)


@pytest.mark.parametrize("ended", [False, True])
def test_told_values_count_in_feedback_about_their_run(harness, ended):
    harness.controller.on_run_started(run(awarded=scene(3.0, 4.0)))
    assert harness.give(agent="guide", kind=2).target == (3.0, 4.0)
    harness.controller.receive(telling(4.0))
    harness.controller.receive(scene(2.0, 1.0))  # later measured values do not count
    if ended:
        harness.controller.on_run_ended(run(awarded=scene(3.0, 4.0)))
    assert harness.give(agent="guide", kind=2).target == (4.0, 4.0)


def test_values_told_by_another_person_are_ignored(harness):
    harness.controller.on_run_started(run(awarded=scene(3.0, 4.0, person_id="anna")))
    harness.controller.receive(telling(5.0, "bert"))
    assert harness.give(agent="guide", kind=2).target == (3.0, 4.0)
    harness.controller.receive(telling(4.0, "anna"))
    assert harness.give(agent="guide", kind=2).target == (4.0, 4.0)
