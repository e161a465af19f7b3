# SPDX-License-Identifier: Apache-2.0
"""Laws of mood rules, for every course of the mood and every rate of checks."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Origin, Scene
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.mood_rule import MoodRule
from feedback_node.rules import MIN_REPEAT_S, Fired, Watch
from scene_spaces import AGE_AND_MOOD as SPACE
from scene_spaces import age_and_mood

START = 4.0
LEASE_S = 1.0


@dataclass(frozen=True)
class Look:
    """One live scene, or, without a mood, a moment in which only time passes."""

    after_ms: int
    mood: float | None
    origin: Origin = Origin.MEASURED
    person: bool = True
    person_id: str = "anna"
    confidence: float = 1.0

    @property
    def low(self) -> bool:
        """Whether the mood of the right person is known to be low."""
        known = (
            self.origin in (Origin.MEASURED, Origin.GIVEN, Origin.TOLD) and self.confidence >= 0.5
        )
        there = self.person and self.person_id in ("anna", "")
        return known and there and self.mood is not None and self.mood <= START - 1.0

    def scene(self) -> Scene:
        assert self.mood is not None
        return age_and_mood(
            3.0,
            self.mood,
            origin=self.origin,
            confidence=self.confidence,
            person=self.person,
            person_id=self.person_id,
        )


moods = st.sampled_from([1.0, 2.9, 3.0, 3.1, 5.0])
often = st.builds(Look, st.integers(0, 1500), moods | st.none())
looks = st.lists(
    often
    | st.builds(
        Look,
        st.integers(0, 1500),
        moods,
        st.sampled_from([one for one in Origin if one is not Origin.MISSING]),
        st.booleans(),
        st.sampled_from(["anna", "ben", ""]),
        st.sampled_from([0.4, 0.5, 1.0]),
    ),
    max_size=40,
)
seconds = st.sampled_from([0.0, 0.5, 1.0, 3.0])


@st.composite
def rules(draw: st.DrawFn) -> MoodRule:
    return restore_mood_rule(
        SPACE,
        when="mood.change <= -1",
        hold_s=draw(seconds),
        give=FeedbackKind.NEGATIVE,
        release=draw(st.sampled_from(["", "mood.change > -1", "live.person"])),
        cooldown_s=draw(seconds),
        confidence=0.5,
    )


def firings(rule: MoodRule, course: list[Look]) -> list[tuple[float, Fired]]:
    """Return when a rule fires in a run that begins at 0 s."""
    now = 0.0
    awarded = age_and_mood(3.0, START, person_id="anna")
    watch = Watch([rule], awarded, SPACE, lambda: now, lease_s=LEASE_S)
    found = []
    for look in course:
        now += look.after_ms / 1000
        fired = watch.tick() if look.mood is None else watch.receive(look.scene())
        found += [(now, one) for one in fired]
    return found


@given(rules(), looks)
def test_firings_are_at_least_hold_and_cooldown_apart(rule, course):
    moments = [at for at, _ in firings(rule, course)]
    if not rule.repeats:
        assert len(moments) <= 1
    for earlier, later in itertools.pairwise(moments):
        assert later - earlier >= max(rule.cooldown_s, MIN_REPEAT_S) + rule.hold_s - 1e-9


@given(rules(), looks)
def test_condition_of_firing_held_the_whole_time(rule, course):
    ends = list(itertools.accumulate(look.after_ms / 1000 for look in course))
    seen = [(at, look) for at, look in zip(ends, course, strict=True) if look.mood is not None]
    for at, one in firings(rule, course):
        assert at - one.since >= rule.hold_s
        before = [pair for pair in seen if pair[0] < one.since]
        # Several scenes may come in one instant; it may have fired between two of them.
        then = [pair for pair in seen if pair[0] == one.since]
        began = [pair for pair in [*before[-1:], *then] if pair[1].low]
        assert began
        during = [pair for pair in seen if one.since < pair[0] < at]
        counted = [began[-1], *during]
        assert all(look.low for _, look in counted)
        moments = [moment for moment, _ in counted]
        for earlier, later in itertools.pairwise([*moments, at]):
            assert later - earlier <= LEASE_S + 1e-9


@given(rules(), looks)
def test_rule_never_fires_on_lost_or_other_person(rule, course):
    hidden = [
        Look(look.after_ms, look.mood, Origin.DEFAULT if index % 2 else Origin.MEASURED,
             bool(index % 2), "anna")
        for index, look in enumerate(course)
    ]  # fmt: skip
    assert firings(rule, hidden) == []


@given(looks, st.sampled_from([0.5, 2.0]))
def test_baseline_lies_between_observed_moods(course, baseline_s):
    rule = restore_mood_rule(
        SPACE,
        when="mood.change <= 0 or mood.change >= 0",
        give=FeedbackKind.NEGATIVE,
        baseline_s=baseline_s,
        confidence=0.5,
    )
    moods = [look.mood for look in course if look.mood is not None]
    for at, one in firings(rule, course):
        start = float(one.reason.rpartition("mood ")[2].split()[0])
        assert at >= baseline_s
        assert min(moods) - 1e-3 <= start <= max(moods) + 1e-3
