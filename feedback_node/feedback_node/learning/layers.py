# SPDX-License-Identifier: Apache-2.0
"""Learning in layers: the share of each layer in a feedback, and the history of each."""

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
"""Feedbacks from which the share of wrong ones is estimated."""

_IN_PART = "taught by somebody, or at a place, that has a profile of its own"


@dataclass(frozen=True, kw_only=True)
class LayerStep:
    """Step of one layer for one feedback.

    Attributes:
        false_rate: 0..1, how much of what the layer was taught, this included, seems to be
            wrong; NaN when too little is known.
        recent: What the layer was taught last, this included; see :func:`taught`.
    """

    cause: RevisionCause
    step: learning_step.Step
    false_rate: float
    recent: tuple[Vector, ...]


def shares(
    rule: LearningRule, kind: FeedbackKind, scene: Scene | None
) -> tuple[tuple[str, float], ...]:
    """Return the layers that learn from a feedback, each with its share, 0..1.

    Without the layer of a person or a place that is the profile for everybody, alone and in full;
    else it comes last, unless it learns nothing of it. What is set is set for everybody.

    Raises:
        Refused: ``BAD_LAYER`` for a person or a place whose name is none of a layer.
    """
    of_scene = {} if scene is None or kind is FeedbackKind.SET else layers_of(scene)
    own = tuple(
        (checked_layer(layer), 1.0) for one, layer in of_scene.items() if one in rule.layers
    )
    if not own:
        return ((EVERYBODY, 1.0),)
    return (*own, (EVERYBODY, rule.general)) if rule.general > 0.0 else own


def anonymous(cause: RevisionCause) -> RevisionCause:
    """Return a cause without what leads back to the person whose layer was taught as well."""
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

    The layer learns a ``share`` of it, 0..1; ``changes`` many feedbacks have led to its profile,
    which have asked for ``recent``, see :func:`taught`. The ``cause`` lacks what the step says.

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
        evidence=learning_step.Evidence(
            recent=recent[-rule.window :], changes=changes, authored=agent.authored
        ),
    )
    requested = (
        ()
        if kind is FeedbackKind.SET
        else (learning_step.requested(kind, step.before, step.target, space=space, rule=rule),)
    )
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


def taught(
    ledger: LedgerReader, agent: str, layer: str, space: SceneSpace, window: int
) -> tuple[Vector, ...]:
    """Return the targets of the last feedbacks, newest last; enough for ``window`` of them."""
    found = []
    for row in ledger.taught(agent, layer, newest=max(window, _RECENT)):
        target = space.ordered(row.cause.target)
        if row.cause.kind == FeedbackKind.NEGATIVE:
            before = ledger.before(row)
            target = learning_step.requested(
                FeedbackKind.NEGATIVE,
                space.ordered(before.profile),
                target,
                space=space,
                rule=LearningRule(retreat=row.cause.retreat),
            )
        found.append(target)
    return tuple(found)
