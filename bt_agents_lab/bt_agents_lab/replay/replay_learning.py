# SPDX-License-Identifier: Apache-2.0
"""Replay of the profile changes in a journal, compared to the last digit."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_lab.replay.findings import ReplayFinding, compared, not_recorded
from bt_agents_lab.replay.recording_index import RecordedFeedback
from bt_agents_language.files.learning_reader import MAX_WINDOW
from feedback_node.learning.learning_step import Step, parameter_rules, requested, step

KIND = "profile change"


@dataclass(frozen=True, kw_only=True)
class ProfileState:
    """Revision of a profile, with the feedback that led to it.

    Attributes:
        revision: Its number, or the number of the revision that it restores.
        recent: Targets of the last feedbacks that led to it, as of :func:`with_newest`.
        known: False if some of these may not be recorded.
    """

    revision: int
    profile: Vector
    recent: tuple[Vector, ...] = ()
    known: bool = True


class ProfileHistory:
    """Announced revisions of one profile, as far as later ones depend on them.

    Revisions without feedback, when the author edits the profile or the layer begins, are not
    announced: their numbers are missing.
    """

    def __init__(self) -> None:
        self._states: dict[int, ProfileState] = {}

    def before(self, feedback: Any, authored: Sequence[float]) -> ProfileState:
        """Return the state before a feedback; ``authored`` is the profile in the file."""
        number, profile = feedback.revision - 1, tuple(feedback.before)
        if next(reversed(self._states), -1) > number:
            # The layer was forgotten and begins again.
            self._states.clear()
        if number not in self._states:
            known = number == 0 or profile == tuple(authored)
            self._states[number] = ProfileState(revision=number, profile=profile, known=known)
        return self._states[number]

    def add(
        self, feedback: Any, before: ProfileState, space: SceneSpace, rule: LearningRule
    ) -> ProfileState:
        """Add the revision that results from a feedback and a rule; return its state."""
        number, kind = feedback.revision, FeedbackKind(feedback.kind)
        profile = tuple(feedback.after)
        if kind is not FeedbackKind.SET:
            found, target = tuple(feedback.before), tuple(feedback.target)
            asked = requested(parameter_rules(rule, space), kind, found, target)
            recent = with_newest(before.recent, asked)
            state = ProfileState(
                revision=number, profile=profile, recent=recent, known=before.known
            )
        elif not is_managed(feedback):
            state = replace(before, revision=number, profile=profile)
        elif feedback.feedback_id:
            state = ProfileState(revision=number, profile=profile)
        else:
            state = self._restored(number, profile, before)
        self._states[number] = state
        return state

    def _restored(self, number: int, profile: Vector, before: ProfileState) -> ProfileState:
        """Return the state after an undo or a reset, which begins again."""
        undone = self._states.get(before.revision - 1)
        if undone is not None and undone.profile == profile:
            return undone
        known = undone is not None or before.revision == 0
        return ProfileState(revision=number, profile=profile, known=known)


def with_newest(recent: tuple[Vector, ...], asked: Vector) -> tuple[Vector, ...]:
    """Add the target of a feedback to those before; keep as many as the widest median needs."""
    return (*recent, asked)[-MAX_WINDOW:]


def is_managed(feedback: Any) -> bool:
    """Return whether a change is an undo, a reset or an import; only an import has an id."""
    return feedback.kind == FeedbackKind.SET and not feedback.learning_rate


def replay_feedback(feedbacks: Iterable[RecordedFeedback]) -> Iterator[ReplayFinding]:
    """Learn each feedback again and yield whether the resulting profile is equal."""
    histories: defaultdict[tuple[str, str], ProfileHistory] = defaultdict(ProfileHistory)
    for recorded in feedbacks:
        feedback = recorded.feedback
        whose = f"{feedback.agent}, {feedback.layer}" if feedback.layer else feedback.agent
        where = f"revision {feedback.revision} of {whose}"
        if recorded.space is None or recorded.card is None:
            missing = "no host has introduced the agent before"
            yield not_recorded(KIND, where, missing)
            continue
        history = histories[feedback.agent, feedback.layer]
        before = history.before(feedback, recorded.card.profile)
        try:
            yield _again(recorded, recorded.space.profiles, before, where)
            rule = rule_of(recorded.card, recorded.parameters)
            history.add(feedback, before, recorded.space.profiles, rule)
        except Refused as refused:
            yield compared(KIND, where, refused.reason)
        except BtAgentsError as error:
            yield not_recorded(KIND, where, str(error))


def rule_of(card: Any, parameters: Sequence[str]) -> LearningRule:
    """Return the learning rule of an ``AgentCard`` whose values have this order."""
    learning = card.learning

    def named(values: Sequence[float]) -> dict[str, float]:
        pairs = zip(parameters, values, strict=True) if values else ()
        return {name: value for name, value in pairs if not math.isnan(value)}

    return LearningRule(
        rates=named(learning.rates),
        update=Update(learning.update or Update.PLAIN),
        width=named(learning.width),
        window=max(learning.window, 1),
        anneal=learning.anneal,
        drift=named(learning.drift),
        retreat=named(learning.retreat),
        weights=dict(zip(learning.sources, learning.weights, strict=True)),
        layers=tuple(learning.layers),
        general=learning.general,
    )


def _again(
    recorded: RecordedFeedback, space: SceneSpace, before: ProfileState, where: str
) -> ReplayFinding:
    feedback = recorded.feedback
    if list(feedback.parameters) != list(space.names):
        raise Refused(
            RefusalCode.BAD_RECORD,
            f"it has the parameters {', '.join(feedback.parameters)}, expected "
            f"{', '.join(space.names)}",
        )
    rule = rule_of(recorded.card, recorded.parameters)
    again = step(
        FeedbackKind(feedback.kind),
        tuple(feedback.before),
        tuple(feedback.target),
        rate=feedback.learning_rate,
        space=space,
        rule=rule,
        weight=feedback.weight,
        recent=before.recent,
        changes=_changes(feedback, rule, space),
        authored=tuple(recorded.card.profile),
    )
    difference = _difference(feedback, again, space)
    if difference and rule.update is Update.MEDIAN and not before.known:
        missing = "what the agent was taught before the journal began"
        return not_recorded(KIND, where, missing)
    return compared(KIND, where, difference)


def _changes(feedback: Any, rule: LearningRule, space: SceneSpace) -> int:
    """Return the number of changes that gives the recorded annealed rate; else 0."""
    if rule.anneal == 0.0 or not feedback.rates:
        return 0
    for name, then in zip(space.names, feedback.rates, strict=True):
        initial = rule.rates.get(name, feedback.learning_rate) * feedback.weight
        if 0.0 < then < min(initial, 1.0):
            return max(0, round(float((initial / then - 1.0) / rule.anneal)))
    return 0


def _difference(feedback: Any, again: Step, space: SceneSpace) -> str:
    rate = again.rate if is_managed(feedback) else feedback.learning_rate
    rates = list(feedback.rates) or [rate] * len(space)
    for what, before, after in (
        ("", feedback.after, again.after),
        ("rate of ", rates, again.rates),
    ):
        for name, was, now in zip(space.names, before, after, strict=True):
            if was != now:
                return f"{what}{name} was {was!r}, now {now!r}"
    return ""
