# SPDX-License-Identifier: Apache-2.0
"""Converts cards, runs and feedback from and to messages; checks scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import LONGEST_NAME, is_full_name
from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import quote
from bt_agents_interfaces.msg import (
    AgentCard,
    Feedback,
    FileProblem,
    HostCard,
    Learning,
    MoodTrace,
    NodeValue,
)
from bt_agents_interfaces.msg import MoodRule as MoodRuleMsg
from bt_agents_interfaces.msg import Profiles as ProfilesMsg
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.srv import CollectFeedback, GiveFeedback
from bt_agents_language.files.mood_rule_reader import restore_mood_rule
from bt_agents_language.model.mood_rule import MoodRule
from bt_agents_ros.messages import header_at, scene_from_msg, to_time
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning.cards import AgentEntry, LearningCard, LearningEntry
from feedback_node.learning.feedback_controller import FeedbackRequest
from feedback_node.learning.profiles import ProfileChange, Table
from feedback_node.mood_trace import LeafMood

_OUTCOMES = (RunMsg.SUCCEEDED, RunMsg.FAILED, RunMsg.CANCELLED, RunMsg.LOST)


def set_profile_name(host: str) -> str:
    """Return the name of the service that sets profiles of a host."""
    return f"{host}/set_profile"


def card_from_msg(message: HostCard, space: SceneSpace) -> LearningCard:
    """Return the card of a host.

    Raises:
        Refused: ``BAD_NAME``; the name of the host is invalid.
    """
    if not is_full_name(message.host):
        raise Refused(
            RefusalCode.BAD_NAME,
            f"card of {quote(message.host)}: expected a full name like /agents",
        )
    return LearningCard(
        host=message.host,
        instance=message.host_instance,
        parameters=tuple(message.parameters),
        agents=tuple(_agent_from_msg(agent, space) for agent in message.agents),
    )


def _agent_from_msg(message: AgentCard, space: SceneSpace) -> AgentEntry:
    rules: list[MoodRule] = []
    invalid_rules: list[Refused] = []
    for rule in message.rules:
        try:
            rules.append(rule_from_msg(rule, space))
        except Refused as refusal:
            invalid_rules.append(refusal)
    return AgentEntry(
        name=message.name,
        profile=tuple(message.profile),
        revision=message.revision,
        learning_rate=message.learning_rate,
        current=tuple(message.current),
        learning=_learning_from_msg(message.learning),
        rules=tuple(rules),
        invalid_rules=tuple(invalid_rules),
    )


def _learning_from_msg(message: Learning) -> LearningEntry:
    return LearningEntry(
        update=message.update,
        rates=tuple(message.rates),
        width=tuple(message.width),
        window=message.window,
        anneal=message.anneal,
        drift=tuple(message.drift),
        retreat=tuple(message.retreat),
        sources=tuple(message.sources),
        weights=tuple(message.weights),
        layers=tuple(message.layers),
        general=message.general,
    )


def rule_from_msg(message: MoodRuleMsg, space: SceneSpace) -> MoodRule:
    """Return the mood rule of a message.

    Raises:
        Refused: ``BAD_RULE``.
    """
    return restore_mood_rule(
        space,
        when=message.when,
        hold_s=message.hold_s,
        give=message.give,
        action=message.action,
        baseline_s=message.baseline_s,
        release=message.release,
        cooldown_s=message.cooldown_s,
        confidence=message.confidence,
    )


def run_from_msg(message: RunMsg | CollectFeedback.Request, space: SceneSpace) -> AnnouncedRun:
    """Return the run of an event.

    Raises:
        Refused: ``TOO_LONG``, or as in :func:`scene_from_msg`.
    """
    for field in ("epoch", "agent"):
        if len(text := getattr(message, field)) > LONGEST_NAME:
            raise Refused(
                RefusalCode.TOO_LONG,
                f"run: {field} has {len(text)} characters, expected {LONGEST_NAME} at most",
            )
    return AnnouncedRun(
        epoch=message.epoch,
        round=message.round,
        agent=message.agent,
        scene=scene_from_msg(message.scene, space),
    )


def collected_from_msg(request: CollectFeedback.Request, space: SceneSpace) -> AnnouncedRun:
    """Return the run that feedback is collected for.

    Raises:
        Refused: ``UNKNOWN_OUTCOME``, or as in :func:`scene_from_msg`.
    """
    if request.outcome not in _OUTCOMES:
        raise Refused(
            RefusalCode.UNKNOWN_OUTCOME, f"feedback: outcome {request.outcome}, expected 1 to 4"
        )
    return run_from_msg(request, space)


def given_from_msg(request: GiveFeedback.Request, space: SceneSpace) -> FeedbackRequest:
    """Return the feedback of a request."""
    return FeedbackRequest(
        feedback_id=request.feedback_id,
        agent=request.agent,
        kind=request.kind,
        values=tuple(request.values),
        expected=tuple(request.expected),
        source=request.source,
        reason=request.reason,
        leaf=request.leaf,
        scene=scene_from_msg(request.scene, space) if request.scene.scene_id else None,
    )


def feedback_to_msg(change: ProfileChange, space: SceneSpace) -> Feedback:
    """Return the message of a recorded change."""
    cause = change.revision.cause
    return Feedback(
        header=header_at(to_time(change.revision.stamp)),
        feedback_id=cause.feedback_id or "",
        agent=change.revision.agent,
        kind=cause.kind,
        source=cause.source,
        reason=cause.reason,
        epoch=cause.epoch,
        round=cause.round,
        parameters=space.names,
        before=change.before,
        after=change.after,
        target=change.target,
        rates=change.rates,
        weight=cause.weight,
        learning_rate=cause.rate,
        revision=change.revision.revision,
        layer=change.revision.layer,
        leaf=cause.leaf,
        false_rate=change.false_rate,
        cancels=cause.cancels,
    )


def taught_text(agent: str, taught: Sequence[ProfileChange]) -> str:
    """Return in words who taught an agent in a run without collected feedback."""
    if not taught:
        return f"no feedback for {agent}"
    sources = dict.fromkeys(one.revision.cause.source or "somebody" for one in taught)
    times = "once" if len(taught) == 1 else f"{len(taught)} times"
    return f"{agent} was given feedback {times} during its run ({', '.join(sources)})"


def mood_trace_to_msg(
    run: AnnouncedRun,
    leaves: Sequence[LeafMood],
    values: Mapping[tuple[str, str], str],
    stamp: Any,
) -> MoodTrace:
    """Return the message of the mood trace of a run that ended at a time."""
    return MoodTrace(
        header=header_at(stamp),
        epoch=run.epoch,
        round=run.round,
        agent=run.agent,
        person_id=run.scene.person_id,
        leaves=[one.leaf for one in leaves],
        seconds=[one.seconds for one in leaves],
        mean=[one.mean for one in leaves],
        change=[one.change for one in leaves],
        values=[
            NodeValue(path=path, name=name, value=value, written=True)
            for (path, name), value in values.items()
        ],
    )


def table_to_msg(
    table: Table, undecided: Iterable[tuple[str, str]], differing: Iterable[str], space: SceneSpace
) -> ProfilesMsg:
    """Return the message of all current profiles, undecided rules and differing agents."""
    return ProfilesMsg(
        parameters=space.names,
        agents=[name for name, _, _, _ in table],
        layers=[layer for _, layer, _, _ in table],
        revisions=[revision for _, _, revision, _ in table],
        vectors=[value for _, _, _, vector in table for value in vector],
        differing=list(differing),
        problems=[FileProblem(agent=agent, message=reason) for agent, reason in undecided],
    )
