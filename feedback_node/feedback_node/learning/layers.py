# SPDX-License-Identifier: Apache-2.0
"""Learning in layers: the share of each layer in a feedback, and its history."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bt_agents_core.feedback import FeedbackKind, LearningRule
from bt_agents_core.profile_layers import EVERYBODY, checked_layer, layers_of
from bt_agents_core.scene import Scene, SceneSpace, Vector
from feedback_node.learning import learning_step
from feedback_node.learning.cards import Agent
from feedback_node.ledger.reading import LedgerReader
from feedback_node.ledger.rows import RevisionCause, hidden

_RECENT = 30
"""The share of wrong feedback is estimated from this number of feedbacks."""

_IN_PART = "taught by somebody, or at a place, that has a profile of its own"


@dataclass(frozen=True, kw_only=True)
class LayerStep:
    """Step of one layer for one feedback.

    Attributes:
        false_rate: Estimated share of wrong feedback for the layer, including this one, 0..1; NaN
            for too little feedback.
        recent: The latest targets for the layer, including this one; see :func:`past_targets`.
    """

    cause: RevisionCause
    step: learning_step.Step
    false_rate: float
    recent: tuple[Vector, ...]


def shares(
    rule: LearningRule, kind: FeedbackKind, scene: Scene | None
) -> tuple[tuple[str, float], ...]:
    """Return the layers that learn from a feedback, each with its share (0..1).

    Without a layer for the person or the place, this is only the profile for everybody, with its
    full share; otherwise that profile comes last, unless it learns nothing. ``SET`` always sets
    the profile for everybody.

    Raises:
        Refused: ``BAD_LAYER``; the name of the person or place cannot be the name of a layer.
    """
    of_scene = {} if scene is None or kind is FeedbackKind.SET else layers_of(scene)
    own = tuple(
        (checked_layer(layer), 1.0) for one, layer in of_scene.items() if one in rule.layers
    )
    if not own:
        return ((EVERYBODY, 1.0),)
    return (*own, (EVERYBODY, rule.general)) if rule.general > 0.0 else own


def anonymous(cause: RevisionCause) -> RevisionCause:
    """Return a cause without references to the person whose layer also learned."""
    assert cause.feedback_id is not None
    feedback_id = hidden(cause.feedback_id)
    return replace(cause, reason=_IN_PART, scene_id="", leaf="", feedback_id=feedback_id)


def layer_step(
    kind: FeedbackKind,
    profile: Vector,
    target: Vector,
    *,
    agent: Agent,
    share: float,
    cause: RevisionCause,
    changes: int,
    recent: tuple[Vector, ...],
    space: SceneSpace,
) -> LayerStep:
    """Return the step of one layer of an agent for one feedback.

    The layer learns the ``share`` (0..1) of it. ``changes`` is the number of feedbacks that led to
    its profile, and ``recent`` their targets, see :func:`past_targets`. The step completes
    ``cause``.

    Raises:
        Refused: As in :func:`learning_step.step`.
    """
    rule = agent.learning
    step = learning_step.step(
        kind,
        profile,
        target,
        rate=agent.entry.learning_rate,
        space=space,
        rule=rule,
        weight=rule.weight(cause.source) * share,
        recent=recent[-rule.window :],
        changes=changes,
        authored=agent.authored,
    )
    requested = () if kind is FeedbackKind.SET else (step.requested,)
    of_rate = all(rate == step.rate for rate in step.rates)
    return LayerStep(
        cause=replace(
            cause,
            rate=step.rate,
            weight=step.weight,
            rates={} if of_rate else space.named(step.rates),
            target=space.named(step.target),
            retreat=space.named(step.retreat),
            changes=changes + (kind is not FeedbackKind.SET),
        ),
        step=step,
        false_rate=learning_step.false_rate((*recent[-_RECENT:], *requested), space),
        recent=(*recent, *requested)[-max(rule.window, _RECENT) :],
    )


def past_targets(
    ledger: LedgerReader, agent: str, layer: str, space: SceneSpace, window: int
) -> tuple[Vector, ...]:
    """Return the targets of the last feedbacks, newest last; at least ``window`` if there are."""
    found = []
    for row in ledger.taught(agent, layer, newest=max(window, _RECENT)):
        target = space.ordered(row.cause.target)
        if row.cause.kind == FeedbackKind.NEGATIVE:
            before = ledger.before(row)
            rules = learning_step.parameter_rules(LearningRule(retreat=row.cause.retreat), space)
            profile = space.ordered(before.profile)
            target = learning_step.requested(rules, FeedbackKind.NEGATIVE, profile, target)
        found.append(target)
    return tuple(found)
