# SPDX-License-Identifier: Apache-2.0
"""Update rules of profiles on arrays: one profile, or the profiles of thousands of runs at once.

All functions broadcast over leading axes; each row is moved as if it were alone. Plain sums equal
those of plain Python bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bt_agents_core.feedback import FeedbackKind, LearningRule, Update
from bt_agents_core.scene import SceneSpace

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WIDTH_SHARE = 1 / 4
"""Default width of ``HUBER`` as a share of a parameter's range."""


SAME_SHARE = 1 / 1000
"""Share of a parameter's range within which a profile counts as on the scene."""


@dataclass(frozen=True, kw_only=True)
class RuleArrays:
    """A learning rule with its values in the order of the parameters.

    Attributes:
        rates: [n], learning rates; NaN for the agent's rate.
        width: [n], width of ``HUBER`` in the units of the parameters.
        anneal: The rate after m changes is ``rate / (1 + anneal * m)``.
        drift: [n], largest distance from the authored profile; NaN for no bound.
        retreat: [n], target of negative feedback on the scene itself; NaN for none.
        same: [n], largest distance from the scene at which the profile counts as on it.
    """

    update: Update
    rates: Array
    width: Array
    window: int
    anneal: float
    drift: Array
    retreat: Array
    same: Array


def arrays(rule: LearningRule, space: SceneSpace) -> RuleArrays:
    """Return a rule with its values in the order of the space."""
    return RuleArrays(
        update=rule.update,
        rates=np.array([rule.rates.get(name, np.nan) for name in space.names]),
        width=np.array(
            [
                rule.width.get(p.name, (p.maximum - p.minimum) * WIDTH_SHARE)
                for p in space.parameters
            ]
        ),
        window=rule.window,
        anneal=rule.anneal,
        drift=np.array([rule.drift.get(name, np.nan) for name in space.names]),
        retreat=np.array([rule.retreat.get(name, np.nan) for name in space.names]),
        same=np.array([(p.maximum - p.minimum) * SAME_SHARE for p in space.parameters]),
    )


def rates(rule: RuleArrays, rate: ArrayLike, weight: ArrayLike, changes: ArrayLike) -> Array:
    """Return the rate of each parameter: ``min(1, η · w / (1 + a · m))``.

    Args:
        rule: The rule; its own rates take precedence over ``rate``.
        rate: [...], learning rate η of the agent, 0..1.
        weight: [...], weight w of the source, 0 or more.
        changes: [...], number of feedbacks that moved the profile (m).

    Returns:
        [..., n], 0..1.
    """
    own = np.where(np.isnan(rule.rates), np.asarray(rate)[..., None], rule.rates)
    annealed = 1.0 + rule.anneal * np.asarray(changes, dtype=np.float64)[..., None]
    result: Array = np.minimum(own * np.asarray(weight)[..., None] / annealed, 1.0)
    return result


def retreats(kind: ArrayLike, profile: Array, target: Array, rule: RuleArrays) -> BoolArray:
    """Return where negative feedback meets a profile on the scene and the rule has a retreat.

    Arguments are those of :func:`requested`; the result is [..., n].
    """
    negative = np.asarray(kind)[..., None] == FeedbackKind.NEGATIVE
    result: BoolArray = (
        negative & ~np.isnan(rule.retreat) & (np.abs(profile - target) <= rule.same)
    )
    return result


def requested(kind: ArrayLike, profile: Array, target: Array, rule: RuleArrays) -> Array:
    """Return the profile that feedback asks for: the target, or its mirror image if negative.

    "Away from the scene by the same step" is a step towards ``2p − s``, which may be outside the
    ranges; on the scene itself, it is a step towards ``retreat``.

    Args:
        kind: [...], as :class:`bt_agents_core.feedback.FeedbackKind`.
        profile: [..., n].
        target: [..., n]; NaN for no opinion.
        rule: The learning rule, the same for all rows.
    """
    negative = np.asarray(kind)[..., None] == FeedbackKind.NEGATIVE
    asked = np.where(negative, profile - (target - profile), target)
    return np.where(retreats(kind, profile, target, rule), rule.retreat, asked)


def apply_update(
    kind: ArrayLike,
    profile: Array,
    target: Array,
    rate: Array,
    rule: RuleArrays,
    recent: Array,
    authored: Array,
    low: Array,
    high: Array,
) -> Array:
    """Return profiles after one feedback each: ``p ← p + η · d``, inside the ranges and drift.

    ``d`` is the pull of the feedback, ``f − p``, or ``−(f − p)`` if it is negative. ``HUBER``
    clips it to ±width (Huber, "Robust Estimation of a Location Parameter", 1964: the gradient of
    his loss); ``MEDIAN`` replaces ``f`` by the median of what the last feedbacks asked for. A
    positive step does not pass its target. ``SET`` is ``p ← f``, whatever the rate and the drift.
    Negative feedback on the scene itself is a step towards ``retreat`` if the rule has one. A
    profile that is already farther from its file than the drift only moves nearer or stays.

    Args:
        kind: [...], as :class:`bt_agents_core.feedback.FeedbackKind`.
        profile: [..., n], inside the ranges.
        target: [..., n]; NaN leaves its parameter alone.
        rate: [..., n], result of :func:`rates`.
        rule: The learning rule, the same for all rows.
        recent: [..., k, n], results of :func:`requested` for the previous feedbacks, newest last,
            NaN for none; only ``MEDIAN`` uses it.
        authored: [..., n], profile in the agent's file.
        low: [n], lower ends of the ranges.
        high: [n], upper ends of the ranges.
    """
    kinds = np.asarray(kind)[..., None]
    retreating = retreats(kind, profile, target, rule)
    mirrored = (kinds == FeedbackKind.NEGATIVE) & ~retreating & (rule.update != Update.MEDIAN)
    goal = np.where(retreating, rule.retreat, target)
    pull = goal - profile
    pull = np.where(mirrored, -pull, pull)
    if rule.update == Update.HUBER:
        pull = np.clip(pull, -rule.width, rule.width)
    elif rule.update == Update.MEDIAN:
        goal = _median_target(requested(kind, profile, target, rule), recent, rule.window)
        pull = goal - profile
    after = profile + rate * pull
    # Rounding may move the sum one digit past the target, which would be an overshoot.
    nearer = np.clip(after, np.minimum(profile, goal), np.maximum(profile, goal))
    after = _bounded(np.where(mirrored, after, nearer), profile, authored, rule.drift)
    after = np.clip(np.where(kinds == FeedbackKind.SET, target, after), low, high)
    return np.where(np.isnan(target), profile, after)


def median(samples: Array) -> Array:
    """Return the median of samples [..., k, n] over k, ignoring NaN; NaN where all are NaN."""
    ordered = np.sort(samples, axis=-2)
    count = np.sum(~np.isnan(samples), axis=-2, keepdims=True)
    below = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis=-2)
    above = np.take_along_axis(ordered, np.minimum(count // 2, samples.shape[-2] - 1), axis=-2)
    middle = np.where(below == above, below, (below + above) / 2.0)
    result: Array = middle[..., 0, :]
    return result


def _median_target(requested_now: Array, recent: Array, window: int) -> Array:
    before = recent[..., max(recent.shape[-2] - (window - 1), 0) :, :]
    wide = np.broadcast_shapes(before.shape[:-2], requested_now.shape[:-1])
    samples = np.concatenate(
        [
            np.broadcast_to(before, (*wide, *before.shape[-2:])),
            np.broadcast_to(requested_now, (*wide, requested_now.shape[-1]))[..., None, :],
        ],
        axis=-2,
    )
    return median(samples)


def _bounded(after: Array, before: Array, authored: Array, drift: Array) -> Array:
    if np.isnan(drift).all():
        return after
    least = np.fmin(before, authored - drift)
    most = np.fmax(before, authored + drift)
    bounded = np.clip(after, least, most)
    return np.where(np.isnan(drift), after, bounded)
