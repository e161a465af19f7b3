# SPDX-License-Identifier: Apache-2.0
"""Update rules: where one feedback moves one profile."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.scene import MISSING, SceneSpace, Vector

WIDTH_SHARE = 1 / 4
"""Default width of ``HUBER`` as a share of a parameter's range."""

SAME_SHARE = 1 / 1000
"""Share of a parameter's range within which a profile counts as on the scene."""


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
            goal, away = self._median([*recent, self.requested(kind, p, f)]), False
            pull = goal - p
        after = p + rate * pull
        if not away:
            # Rounding may move the sum one digit past the target, which would be an overshoot.
            after = _clip(after, min(p, goal), max(p, goal))
        if not math.isnan(self.drift):
            after = _clip(after, min(p, authored - self.drift), max(p, authored + self.drift))
        return _clip(after, self.low, self.high)

    def _median(self, asked: Sequence[float]) -> float:
        return median([value for value in asked[-self.window :] if not math.isnan(value)])


def in_order(rule: LearningRule, space: SceneSpace) -> tuple[ParameterRule, ...]:
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


def rates(
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


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
