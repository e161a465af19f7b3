# SPDX-License-Identifier: Apache-2.0
"""Replay of the profile changes of a journal, compared to the last digit."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_lab.replay.findings import ReplayFinding, compared, not_recorded
from bt_agents_lab.replay.recording_index import RecordedFeedback
from feedback_node.learning.learning_step import Evidence, Step, requested, step

KIND = "profile change"

_History = list[tuple[int, Vector | None]]
"""Revision and target of each feedback that a profile has learned; None where it was set."""


def replay_feedback(feedbacks: Iterable[RecordedFeedback]) -> Iterator[ReplayFinding]:
    """Learn each feedback again and yield whether the profile after it is equal."""
    histories: defaultdict[tuple[str, str], _History] = defaultdict(list)
    for recorded in feedbacks:
        feedback = recorded.feedback
        whose = f"{feedback.agent}, {feedback.layer}" if feedback.layer else feedback.agent
        where = f"revision {feedback.revision} of {whose}"
        if recorded.parsed is None or recorded.card is None:
            missing = "no host has introduced the agent before"
            yield not_recorded(KIND, where, missing)
            continue
        history = histories[feedback.agent, feedback.layer]
        try:
            yield _again(recorded, recorded.parsed.space, history, where)
            kind, asked = FeedbackKind(feedback.kind), None
            if kind is not FeedbackKind.SET:
                asked = requested(
                    kind,
                    tuple(feedback.before),
                    tuple(feedback.target),
                    space=recorded.parsed.space,
                    rule=rule_of(recorded.card, recorded.parameters),
                )
            history.append((feedback.revision, asked))
        except Refused as refused:
            yield compared(KIND, where, refused.reason)
        except BtAgentsError as error:
            yield not_recorded(KIND, where, str(error))


def rule_of(card: Any, parameters: Sequence[str]) -> LearningRule:
    """Return the learning rule of an ``AgentCard``, whose values have this order."""
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
    recorded: RecordedFeedback, space: SceneSpace, history: _History, where: str
) -> ReplayFinding:
    feedback = recorded.feedback
    if list(feedback.parameters) != list(space.names):
        raise Refused(
            "BAD_RECORD",
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
        evidence=Evidence(
            recent=tuple(asked for _, asked in history if asked is not None),
            changes=_changes(feedback, rule, space),
            authored=tuple(recorded.card.profile),
        ),
    )
    difference = _difference(feedback, again, space)
    every = [revision for revision, _ in history] == list(range(1, feedback.revision))
    is_whole = every and all(asked is not None for _, asked in history)
    if difference and rule.update is Update.MEDIAN and not is_whole:
        missing = "what the agent was taught before the journal began, or was undone"
        return not_recorded(KIND, where, missing)
    return compared(KIND, where, difference)


def _changes(feedback: Any, rule: LearningRule, space: SceneSpace) -> int:
    """Return the number of changes after which an annealed rate was as recorded; else 0."""
    if rule.anneal == 0.0 or not feedback.rates:
        return 0
    for name, then in zip(space.names, feedback.rates, strict=True):
        initial = rule.rates.get(name, feedback.learning_rate) * feedback.weight
        if 0.0 < then < min(initial, 1.0):
            return max(0, round(float((initial / then - 1.0) / rule.anneal)))
    return 0


def _difference(feedback: Any, again: Step, space: SceneSpace) -> str:
    rates = list(feedback.rates) or [feedback.learning_rate] * len(space)
    for what, before, after in (
        ("", feedback.after, again.after),
        ("rate of ", rates, again.rates),
    ):
        for name, was, now in zip(space.names, before, after, strict=True):
            if was != now:
                return f"{what}{name} was {was!r}, now {now!r}"
    return ""
