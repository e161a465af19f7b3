# SPDX-License-Identifier: Apache-2.0
"""Learning step of one profile: to or towards a vector, towards a scene or away from it.

Sources: direct feedback is the update of section 2.3.4 of the paper, "the positive or negative
distance of the user feedback from the corresponding parameter [...] multiplied with a factor for
the learning rate". Positive and negative feedback are its section 4.2, "shift all parameters of
the agent in the direction of the recognized scene [...] or away from the actual scene".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import MISSING, SceneSpace, Vector
from feedback_node.learning import updates

FEWEST_SAMPLES = 8
"""Fewest feedbacks for an estimate of the share of wrong ones."""

OUTLIER_DEVIATIONS = 3.5
"""Number of deviations from the median beyond which a value is an outlier."""

_MAD_TO_DEVIATION = 1.4826
_LEAST_DEVIATION_SHARE = 1 / 40

PLAIN = LearningRule()
"""The paper's formula."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """Move of a profile; all vectors in the order of the space.

    Attributes:
        target: Vector that the profile moved towards or away from; NaN for no opinion.
        rate: Learning rate η of the agent, 0..1.
        weight: Weight of the source of the feedback.
        rates: Effective rate of each parameter, from its own rate, weight and annealing, 0..1.
        retreat: Target of negative feedback given on the scene itself; NaN for none.
        after: Resulting profile, inside the ranges.
        text: The move in words and numbers; says why if nothing has moved.
    """

    before: Vector
    target: Vector
    rate: float
    weight: float
    rates: Vector
    retreat: Vector
    after: Vector
    text: str


def step(
    kind: FeedbackKind,
    profile: Vector,
    target: Vector,
    *,
    rate: float,
    space: SceneSpace,
    rule: LearningRule = PLAIN,
    weight: float = 1.0,
    recent: tuple[Vector, ...] = (),
    changes: int = 0,
    authored: Vector = (),
) -> Step:
    """Move a profile by one feedback; see :meth:`updates.ParameterRule.apply` for the formulas.

    The target f is a wanted profile, or the scene that the profile p moves towards or away from;
    NaN leaves its parameter alone. ``SET`` means ``p ← f`` at once, whatever the learning rate η,
    the weight of the source (0 or more) and the drift.

    ``recent`` are the results of :func:`requested` for the last feedbacks except ``SET``, newest
    last; as many as the rule's ``window`` are enough. ``changes`` is the number of feedbacks that
    moved the profile, without ``SET``, and ``authored`` the profile in the agent's file; empty if
    it bounds nothing.

    Raises:
        Refused: ``NO_OPINION`` or ``NO_SCENE`` if all of ``target`` is NaN, ``OUT_OF_RANGE``,
            or as in :meth:`SceneSpace.vector`.
    """
    before = space.vector(profile, what="profile")
    wanted = _target(kind, target, space)
    check_rate(rate)
    if not 0.0 <= weight < math.inf:
        raise Refused(
            RefusalCode.OUT_OF_RANGE,
            f"feedback: weight {weight:g} of its source, expected a number from 0",
        )
    of_rule = updates.in_order(rule, space)
    at_once = kind is FeedbackKind.SET
    rates = (1.0,) * len(space) if at_once else updates.rates(of_rule, rate, weight, changes)
    after = updates.apply_update(of_rule, kind, before, wanted, rates, recent, authored or before)
    moves = [
        f"{name} {old:.4g} → {new:.4g}"
        for name, old, new in zip(space.names, before, after, strict=True)
        if old != new
    ]
    retreat = tuple(
        one.retreat if one.retreats(kind, p, f) else MISSING
        for one, p, f in zip(of_rule, before, wanted, strict=True)
    )
    why_not = _why_not(kind, before, wanted, rates, of_rule, authored, space)
    return Step(
        before=before,
        target=wanted,
        rate=1.0 if at_once else rate,
        weight=1.0 if at_once else weight,
        rates=rates,
        retreat=retreat,
        after=after,
        text=", ".join(moves) or f"the profile stays: {why_not}",
    )


def requested(
    kind: FeedbackKind,
    profile: Vector,
    target: Vector,
    *,
    space: SceneSpace,
    rule: LearningRule = PLAIN,
) -> Vector:
    """Return the profile that a feedback other than ``SET`` asked for, as ``recent`` for later."""
    return updates.requested(updates.in_order(rule, space), kind, profile, target)


def false_rate(recent: Sequence[Vector], space: SceneSpace) -> float:
    """Estimate the share of wrong feedbacks: those far from the others.

    A feedback is an outlier if one of its values is farther from the median than
    :data:`OUTLIER_DEVIATIONS` robust standard deviations, ``1.4826 · MAD`` (Iglewicz and Hoaglin,
    "How to Detect and Handle Outliers", 1993), where a deviation is at least 1/40 of the range. It
    can detect up to half of the feedbacks as wrong. ``recent`` are results of :func:`requested`,
    NaN for no opinion.

    Returns:
        The share, 0..1; NaN for fewer than :data:`FEWEST_SAMPLES` feedbacks.
    """
    if len(recent) < FEWEST_SAMPLES:
        return math.nan
    far = [False] * len(recent)
    for parameter, values in zip(space.parameters, zip(*recent, strict=True), strict=True):
        known = [value for value in values if not math.isnan(value)]
        if not known:
            continue
        middle = median(known)
        least = (parameter.maximum - parameter.minimum) * _LEAST_DEVIATION_SHARE
        deviation = _MAD_TO_DEVIATION * median([abs(value - middle) for value in known])
        limit = OUTLIER_DEVIATIONS * max(deviation, least)
        far = [was or abs(value - middle) > limit for was, value in zip(far, values, strict=True)]
    return sum(far) / len(far)


def check_rate(rate: float, *, what: str = "feedback") -> None:
    """Check that a learning rate is finite and in 0..1.

    Raises:
        Refused: ``OUT_OF_RANGE``.
    """
    if not 0.0 <= rate <= 1.0:
        raise Refused(
            RefusalCode.OUT_OF_RANGE,
            f"{what}: learning rate {rate:g}, expected a number from 0 to 1",
        )


def _target(kind: FeedbackKind, target: Vector, space: SceneSpace) -> Vector:
    of_scene = kind in (FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE)
    vector = space.vector(target, missing=True, what="scene" if of_scene else "feedback")
    if not all(math.isnan(value) for value in vector):
        return vector
    if of_scene:
        raise Refused(
            RefusalCode.NO_SCENE,
            "scene: nothing of it was measured or given, so there is nothing to move towards or "
            "away from; give DIRECT feedback or wait until the scene layer measures something",
        )
    raise Refused(
        RefusalCode.NO_OPINION,
        f"feedback: every value is NaN; give a number for at least one of "
        f"{', '.join(space.names)}",
    )


def _why_not(
    kind: FeedbackKind,
    before: Vector,
    target: Vector,
    rates: Vector,
    rule: Sequence[updates.ParameterRule],
    authored: Vector,
    space: SceneSpace,
) -> str:
    opinions = [i for i, value in enumerate(target) if not math.isnan(value)]
    if all(rates[i] == 0.0 for i in opinions):
        return "the learning rate is 0"
    if all(target[i] == before[i] for i in opinions):
        if kind is FeedbackKind.NEGATIVE:
            learning = [space.names[i] for i in opinions if rates[i] > 0.0]
            if not any(math.isnan(rule[space.names.index(name)].retreat) for name in learning):
                return "it has retreated as far as its file says"
            return (
                "it lies exactly on the scene, so no direction leads away and negative feedback "
                f"moves nothing; 'retreat' under 'learning' in its file declares where to, for "
                f"{' and '.join(learning)}; direct feedback with other values moves it, too, and "
                "a veto stops its bids"
            )
        return "it is there already"
    if rule[0].update is Update.MEDIAN:
        return "it is where most of the last feedbacks want it"
    if authored and any(abs(before[i] - authored[i]) >= rule[i].drift for i in opinions):
        return "it may not get farther from its file"
    if kind is FeedbackKind.NEGATIVE:
        return "it is at the edge of the ranges"
    return "the step is too small"
