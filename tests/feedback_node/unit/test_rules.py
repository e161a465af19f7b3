# SPDX-License-Identifier: Apache-2.0
"""Mood rules: when they fire, on a manual clock."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Origin, Scene, SceneSpace
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.mood_rule import MoodAction, MoodRule
from feedback_node.rules import MIN_REPEAT_S, Watch
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import age_and_mood

NAN = math.nan


def scene(mood: float, *, age: float = 3.0, **fields: Any) -> Scene:
    return age_and_mood(age, mood, **fields)


def rule(when: str, hold_s: float = 1.0, **more: Any) -> MoodRule:
    return restore_mood_rule(SPACE, when=when, hold_s=hold_s, give=FeedbackKind.NEGATIVE, **more)


class Story:
    """A run whose lines are timed from its start."""

    def __init__(
        self,
        *rules: MoodRule,
        awarded: Scene | None = None,
        settle_s: float = 0.0,
        lease_s: float = 1.0,
    ) -> None:
        self.now = 100.0
        awarded = awarded or scene(4.0)
        self.watch = Watch(rules, awarded, SPACE, lambda: self.now, settle_s, lease_s)

    def see(self, at: float, live: Scene) -> list[tuple[int, str]]:
        self.now = 100.0 + at
        return [(one.index, one.reason) for one in self.watch.receive(live)]

    def tick(self, at: float) -> list[tuple[int, str]]:
        self.now = 100.0 + at
        return [(one.index, one.reason) for one in self.watch.tick()]


WORSE = "mood.change <= -1.0"


def test_undecidable_condition_never_fires_and_reports_once():
    story = Story(rule("1 / (live.mood - 3) > 0"))
    story.see(0.0, scene(4.0))
    assert story.watch.take_undecided() == ()
    assert story.see(0.5, scene(3.0)) == []
    assert story.see(0.6, scene(3.0)) == []
    assert story.watch.take_undecided() == (
        "the mood rule cannot be decided: 1 / (live.mood - 3) > 0 ('/' by zero)",
    )
    story.see(0.7, scene(4.0))
    assert story.tick(1.6) == []
    assert len(story.tick(1.7)) == 1
    assert story.watch.take_undecided() == ()


@pytest.mark.parametrize(
    "gap",
    [
        scene(NAN),
        scene(2.5, person=False),
        scene(2.5, origin=Origin.ESTIMATED),
        scene(2.5, origin=Origin.DEFAULT),
        scene(2.5, person_id="ben"),
        scene(3.5),
    ],
)
def test_unknown_or_better_mood_restarts_hold_time(gap):
    story = Story(rule(WORSE), awarded=scene(4.0, person_id="anna"))
    story.see(0.0, scene(2.5))
    assert story.see(0.9, gap) == story.see(1.0, scene(2.5)) == []
    assert story.tick(1.9) == []
    assert len(story.tick(2.0)) == 1


@pytest.mark.parametrize(
    ("lease_s", "seen", "fires"),
    [
        # A rule that must hold for 2 s; times of the live scenes, and of the firing.
        (1.0, (0.0, 0.5, 1.0, 1.5, 2.0), 2.0),
        (1.0, (0.0, 1.0, 2.0), 2.0),
        (1.0, (0.0, 1.0), 2.0),
        (1.0, (0.0, 0.5), None),
        (1.0, (0.0, 1.5, 2.0), None),
        (1.0, (0.0, 0.9, 2.0, 2.5, 3.0, 3.5, 4.0), 4.0),
        (1.0, (0.0, 0.5, 0.9, 3.0, 3.5, 4.0, 4.5), 5.0),
        (1.0, (0.0, 1.9, 60.0), None),
        (3.0, (0.0,), 2.0),
        (0.2, (0.0, 0.5, 1.0, 1.5, 2.0, 2.5), None),
    ],
)
def test_silence_beyond_lease_breaks_hold_time(lease_s, seen, fires):
    story = Story(rule(WORSE, 2.0), lease_s=lease_s)
    fired = []
    for tenth in range(round(seen[-1] * 10) + 30):
        at = tenth / 10
        trace = story.see(at, scene(2.5)) if at in seen else story.tick(at)
        fired += [at for _ in trace]
    assert fired == ([] if fires is None else [fires])


def test_rule_without_hold_ignores_scene_before_silence():
    story = Story(rule(WORSE, 0.0), settle_s=5.0)
    story.see(0.0, scene(2.0))
    assert story.tick(5.0) == story.see(6.0, scene(4.0)) == []
    assert len(story.see(7.0, scene(2.0))) == 1


def test_stale_scene_does_not_fire_lost_person_rule():
    story = Story(rule("not live.person", 2.0), rule("live.stale", 0.0))
    story.see(0.0, scene(4.0))
    assert [story.tick(at / 2) for at in range(20)] == [[]] * 20
    assert story.see(10.0, scene(4.0)) == []


def test_hold_completed_before_next_scene_still_fires():
    story = Story(rule(WORSE))
    story.see(0.0, scene(2.5))
    assert story.see(1.0, scene(4.0)) == [(0, "mood.change <= -1.0 held 1 s: mood 4 → 2.5")]


def test_no_rule_fires_before_first_live_scene():
    story = Story(rule("scene.age >= 1", 0.0))
    assert story.tick(10.0) == []
    assert len(story.see(11.0, scene(4.0))) == 1


def test_rules_fire_in_order_until_one_cancels():
    rules = (rule(WORSE, 1.0), rule(WORSE, 1.0, action=MoodAction.CANCEL), rule(WORSE, 2.0))
    story = Story(*rules)
    story.see(0.0, scene(2.0))
    assert [index for index, _ in story.tick(1.0)] == [0, 1]
    assert story.watch.over
    assert story.tick(5.0) == []


def test_replayed_run_settles_before_hold_time_starts():
    story = Story(rule(WORSE, 0.0), settle_s=0.5)
    assert story.see(0.1, scene(2.0)) == []
    assert story.tick(0.4) == []
    assert len(story.tick(0.5)) == 1


@pytest.mark.parametrize(
    ("when", "live", "fires"),
    [
        ("live.mood < 2", scene(1.5), True),
        ("live.mood < 2", scene(2.0), False),
        ("scene.mood == 4 and live.age == 5", scene(3.0, age=5.0), True),
        ("live.person", scene(3.0), True),
        ("not live.person", scene(3.0, person=False), True),
        ("scene.person and not live.person", scene(NAN, person=False), True),
        ("live.age >= 1", scene(3.0, age=NAN), False),
        ("live.mood < 2", scene(1.0, person=False), False),
        ("live.mood < 2", scene(1.0, origin=Origin.DEFAULT), False),
        ("live.age >= 1", scene(3.0, origin=Origin.ESTIMATED), False),
        ("not live.age >= 1", scene(3.0, age=NAN), False),
        ("1 / mood.change < 0", scene(4.0), False),
        ("1 / mood.change < 0", scene(3.0), True),
    ],
)
def test_condition_reads_awarded_and_live_scene(when, live, fires):
    assert bool(Story(rule(when, 0.0)).see(0.0, live)) is fires


def test_first_live_mood_replaces_missing_awarded_mood():
    story = Story(rule(WORSE, 0.0), awarded=scene(NAN))
    assert story.see(0.0, scene(3.0)) == []
    assert story.see(1.0, scene(2.0)) == [(0, "mood.change <= -1.0 held 0 s: mood 3 → 2")]


def test_another_person_counts_only_as_absence():
    rules = (rule("live.age == 5", 0.0), rule("live.mood < 2", 0.0), rule("not live.person", 0.0))
    story = Story(*rules, awarded=scene(4.0, person_id="anna"))
    fired = story.see(0.0, scene(1.0, age=5.0, person_id="ben"))
    assert [index for index, _ in fired] == [2]


def test_rule_confidence_excludes_doubtful_moods():
    story = Story(rule(WORSE, 0.0, confidence=0.6), rule(WORSE, 0.0))
    fired = [story.see(at, scene(2.0, confidence=0.5 + at / 10)) for at in range(3)]
    assert [[index for index, _ in one] for one in fired] == [[1], [0], []]


def test_baseline_is_mean_mood_of_first_seconds():
    story = Story(rule(WORSE, 1.0, baseline_s=2.0), awarded=scene(5.0))
    for tenth in range(20):
        assert story.see(tenth / 10, scene(3.0 if tenth < 10 else 2.0)) == []
    assert story.see(2.0, scene(1.5)) == []
    assert story.watch.due == 103.0
    assert story.tick(2.9) == []
    assert story.tick(3.0) == [(0, "mood.change <= -1.0 held 1 s: mood 2.5 → 1.5")]


# --- rules that fire again ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("how", "moods", "fired"),
    [
        # Moods second by second, and the times of the firings.
        ({"hold_s": 1.0, "cooldown_s": 3.0}, [2.0] * 11, [1.0, 5.0, 9.0]),
        (
            {"hold_s": 1.0, "release": "mood.change >= -0.5"},
            [2.0, 2.0, 2.9, 2.0, 2.0, 3.4, 2.0, 2.0, 3.5, 2.0, 2.0, 2.0],
            [1.0, 10.0],
        ),
        # A release counts only after the cooldown, and one that is always true only after 1 s.
        ({"release": "mood.change > -1", "cooldown_s": 5.0}, [2.0, 4.0, *[2.0] * 7], [0.0, 5.0]),
        ({"release": "live.person"}, [2.0] * 4, [0.0, MIN_REPEAT_S, 2.0, 3.0]),
    ],
)
def test_rule_fires_again_after_release_and_cooldown(how, moods, fired):
    story = Story(rule(WORSE, **{"hold_s": 0.0} | how))
    found = []
    for tick in range((len(moods) - 1) * 20 + 1):
        found += [tick / 20 for _ in story.see(tick / 20, scene(moods[tick // 20]))]
    assert found == fired
    assert not story.watch.over


def test_firing_states_start_of_hold_and_previous_count():
    story = Story(rule(WORSE, 1.0, cooldown_s=2.0))
    trace = []
    for tick in range(120):
        story.now = 100.0 + tick / 20
        trace += [(one.since, one.count) for one in story.watch.receive(scene(2.0))]
    assert trace == [(100.0, 0), (103.0, 1)]


def test_next_due_time_is_known():
    story = Story(rule(WORSE, 1.0, cooldown_s=3.0))
    story.see(0.0, scene(2.0))
    assert story.watch.due == 101.0
    story.tick(1.0)
    assert story.watch.due == 104.0
    story.see(1.5, scene(4.0))
    assert story.watch.due == 104.0
    for second in (2.0, 3.0, 4.0):
        story.see(second, scene(4.0))
    assert story.watch.due == math.inf


@pytest.mark.parametrize(
    "fields",
    [
        {"when": "mood.change <="},
        {"when": ""},
        {"when": "mood.chnage <= 1"},
        {"when": "__import__('os')"},
        {"when": "live.mood"},
        {"hold_s": -1.0},
        {"hold_s": NAN},
        {"baseline_s": -1.0},
        {"cooldown_s": math.inf},
        {"give": 0},
        {"give": 3},
        {"confidence": 1.1},
        {"confidence": NAN},
        {"release": "live.mood"},
        {"action": 2},
    ],
)
def test_meaningless_rule_is_rejected(fields):
    fields = {"when": WORSE, "give": 2, **fields}
    with pytest.raises(Refused, match=rf"^BAD_RULE: .*{re.escape(fields['when'])}"):
        restore_mood_rule(SPACE, **fields)


def test_space_without_mood_has_no_mood_change():
    space = SceneSpace(parameters=SPACE.parameters, mood=None)
    with pytest.raises(Refused, match="BAD_RULE"):
        restore_mood_rule(space, when=WORSE, hold_s=1.0, give=FeedbackKind.NEGATIVE)
