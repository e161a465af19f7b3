# SPDX-License-Identifier: Apache-2.0
"""Learning step of one profile: to or towards a vector, towards a scene or away from it.

Sources: direct feedback is the update of section 2.3.4 of the paper, "the positive or negative
distance of the user feedback from the corresponding parameter [...] multiplied with a factor for
the learning rate". Positive and negative feedback are its section 4.2, "shift all parameters of
the agent in the direction of the recognized scene [...] or away from the actual scene".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import MISSING, SceneSpace, Vector

WIDTH_SHARE = 1 / 4
"""Default width of ``HUBER`` as a share of a parameter's range."""

SAME_SHARE = 1 / 1000
"""Share of a parameter's range within which a profile counts as on the scene."""

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
        requested: Result of :func:`requested` for this feedback.
        text: The move in words and numbers; says why if nothing has moved.
    """

    before: Vector
    target: Vector
    rate: float
    weight: float
    rates: Vector
    retreat: Vector
    after: Vector
    requested: Vector
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
    """Move a profile by one feedback; see :meth:`ParameterRule.apply` for the formulas.

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
    of_rule = parameter_rules(rule, space)
    at_once = kind is FeedbackKind.SET
    rates = (1.0,) * len(space) if at_once else effective_rates(of_rule, rate, weight, changes)
    after = apply_update(of_rule, kind, before, wanted, rates, recent, authored or before)
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
        requested=requested(of_rule, kind, before, wanted),
        text=", ".join(moves) or f"the profile stays: {why_not}",
    )


@dataclass(frozen=True, kw_only=True)
class ParameterRule:
    """Learning rule of one parameter.

    Attributes:
        rate: Its own learning rate; NaN for the agent's rate.
        width: Width of ``HUBER``.
        window: Number of feedbacks that ``MEDIAN`` looks at.
        anneal: The rate after m changes is ``rate / (1 + anneal * m)``.
        drift: Largest distance from the authored value; NaN for no bound.
        retreat: Target of negative feedback on the scene itself; NaN for none.
        low: Lower end of the range.
        high: Upper end of the range.
    """

    update: Update
    rate: float
    width: float
    window: int
    anneal: float
    drift: float
    retreat: float
    low: float
    high: float

    def retreats(self, kind: FeedbackKind, p: float, f: float) -> bool:
        """Return whether negative feedback meets a value on the scene, and there is a retreat."""
        return (
            kind is FeedbackKind.NEGATIVE
            and not math.isnan(self.retreat)
            and abs(p - f) <= (self.high - self.low) * SAME_SHARE
        )

    def requested(self, kind: FeedbackKind, p: float, f: float) -> float:
        """Return the value that feedback asks for: f, or its mirror image if negative.

        "Away from the scene by the same step" is a step towards ``2p - f``, which may be outside
        the range; on the scene itself, it is a step towards ``retreat``.
        """
        if self.retreats(kind, p, f):
            return self.retreat
        return p - (f - p) if kind is FeedbackKind.NEGATIVE else f

    def effective_rate(self, rate: float, weight: float, changes: int) -> float:
        """Return ``min(1, η · w / (1 + a · m))``.

        Args:
            rate: Learning rate η of the agent, 0..1; the rule's own takes precedence.
            weight: Weight w of the source, 0 or more.
            changes: Number m of feedbacks that moved the profile.
        """
        own = rate if math.isnan(self.rate) else self.rate
        return min(own * weight / (1.0 + self.anneal * changes), 1.0)

    def apply(
        self,
        kind: FeedbackKind,
        p: float,
        f: float,
        rate: float,
        recent: Sequence[float],
        authored: float,
    ) -> float:
        """Return the value after one feedback: ``p ← p + η · d``, inside the range and drift.

        ``d`` is the pull of the feedback, ``f - p``, or ``-(f - p)`` if it is negative. ``HUBER``
        clips it to ±width (Huber, "Robust Estimation of a Location Parameter", 1964: the gradient
        of his loss); ``MEDIAN`` replaces ``f`` by the median of what the last feedbacks asked for.
        A positive step does not pass its target. ``SET`` is ``p ← f``, whatever the rate and the
        drift. Negative feedback on the scene itself is a step towards ``retreat`` if the rule has
        one. A value that is already farther from its file than the drift only moves nearer or
        stays.

        Args:
            kind: Kind of the feedback.
            p: The value, inside the range.
            f: Value of the feedback; NaN for no opinion.
            rate: Result of :meth:`effective_rate`.
            recent: Results of :meth:`requested` for the previous feedbacks, newest last; only
                ``MEDIAN`` uses them.
            authored: Value in the agent's file.
        """
        if math.isnan(f):
            return p
        if kind is FeedbackKind.SET:
            return _clip(f, self.low, self.high)
        retreats = self.retreats(kind, p, f)
        goal = self.retreat if retreats else f
        away = kind is FeedbackKind.NEGATIVE and not retreats
        pull = p - goal if away else goal - p
        if self.update is Update.HUBER:
            pull = _clip(pull, -self.width, self.width)
        elif self.update is Update.MEDIAN:
            asked = [*recent, self.requested(kind, p, f)][-self.window :]
            goal, away = median([value for value in asked if not math.isnan(value)]), False
            pull = goal - p
        after = p + rate * pull
        if not away:
            # Rounding may move the sum one digit past the target, which would be an overshoot.
            after = _clip(after, min(p, goal), max(p, goal))
        if not math.isnan(self.drift):
            after = _clip(after, min(p, authored - self.drift), max(p, authored + self.drift))
        return _clip(after, self.low, self.high)


def parameter_rules(rule: LearningRule, space: SceneSpace) -> tuple[ParameterRule, ...]:
    """Return a rule for each parameter of the space."""

    def of(values: Mapping[str, float], name: str) -> float:
        return values.get(name, MISSING)

    return tuple(
        ParameterRule(
            update=rule.update,
            rate=of(rule.rates, one.name),
            width=rule.width.get(one.name, (one.maximum - one.minimum) * WIDTH_SHARE),
            window=rule.window,
            anneal=rule.anneal,
            drift=of(rule.drift, one.name),
            retreat=of(rule.retreat, one.name),
            low=one.minimum,
            high=one.maximum,
        )
        for one in space.parameters
    )


def effective_rates(
    rule: Sequence[ParameterRule], rate: float, weight: float, changes: int
) -> tuple[float, ...]:
    """Return the rate of each parameter; see :meth:`ParameterRule.effective_rate`."""
    return tuple(one.effective_rate(rate, weight, changes) for one in rule)


def requested(
    rule: Sequence[ParameterRule], kind: FeedbackKind, profile: Vector, target: Vector
) -> Vector:
    """Return the profile that feedback asks for; see :meth:`ParameterRule.requested`."""
    return tuple(
        one.requested(kind, p, f) for one, p, f in zip(rule, profile, target, strict=True)
    )


def apply_update(
    rule: Sequence[ParameterRule],
    kind: FeedbackKind,
    profile: Vector,
    target: Vector,
    rates: Vector,
    recent: Sequence[Vector],
    authored: Vector,
) -> Vector:
    """Return the profile after one feedback; see :meth:`ParameterRule.apply`."""
    before = tuple(zip(*recent, strict=True)) or ((),) * len(profile)
    columns = zip(rule, profile, target, rates, before, authored, strict=True)
    return tuple(one.apply(kind, p, f, *others) for one, p, f, *others in columns)


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
    rule: Sequence[ParameterRule],
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


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
