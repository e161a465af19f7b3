# SPDX-License-Identifier: Apache-2.0
"""Update rules of profiles on arrays: one profile, or those of thousands of runs at once.

All functions broadcast over leading axes, so that each row is moved as if it were alone. Plain
sums are those of plain Python, bit for bit.
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
"""Share of a parameter's range that is the width of ``HUBER`` where none is given."""


SAME_SHARE = 1 / 1000
"""Share of a parameter's range within which a profile lies on the scene."""


@dataclass(frozen=True, kw_only=True)
class RuleArrays:
    """A learning rule with its values in the order of the parameters.

    Attributes:
        rates: [n], learning rates; NaN for the agent's.
        width: [n], of ``HUBER``; in the units of the parameters.
        anneal: The rate after m changes is ``rate / (1 + anneal * m)``.
        drift: [n], farthest from the authored profile; NaN for no bound.
        retreat: [n], where negative feedback leads on the scene itself; NaN for nowhere.
        same: [n], distance from the scene up to which the profile lies on it.
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
        rule: The rule; its own rates go before ``rate``.
        rate: [...], learning rate η of the agent, 0..1.
        weight: [...], weight w of the source, 0 or more.
        changes: [...], how often feedback has moved the profile (m).

    Returns:
        [..., n], 0..1.
    """
    own = np.where(np.isnan(rule.rates), np.asarray(rate)[..., None], rule.rates)
    annealed = 1.0 + rule.anneal * np.asarray(changes, dtype=np.float64)[..., None]
    result: Array = np.minimum(own * np.asarray(weight)[..., None] / annealed, 1.0)
    return result


def retreats(kind: ArrayLike, profile: Array, target: Array, rule: RuleArrays) -> BoolArray:
    """Return where negative feedback finds the profile on the scene and the rule says where to.

    Arguments are those of :func:`requested`; the result is [..., n].
    """
    negative = np.asarray(kind)[..., None] == FeedbackKind.NEGATIVE
    result: BoolArray = (
        negative & ~np.isnan(rule.retreat) & (np.abs(profile - target) <= rule.same)
    )
    return result


def requested(kind: ArrayLike, profile: Array, target: Array, rule: RuleArrays) -> Array:
    """Return the profile that feedback asks for: the target, or for negative its mirror image.

    "Away from the scene by the same step" is the step towards ``2p − s``, which may lie outside
    of the ranges; on the scene itself it is that towards ``retreat``.

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
    """Return profiles after one feedback each: ``p ← p + η · d``, inside of ranges and drift.

    ``d`` is the pull of the feedback, ``f − p``, or ``−(f − p)`` when it is negative. ``HUBER``
    clips it to ±width (Huber, "Robust Estimation of a Location Parameter", 1964: the step that
    his loss has as its gradient); ``MEDIAN`` takes the median of what the last feedbacks asked
    for instead of ``f``. A positive step does not pass what it goes to. ``SET`` is ``p ← f``,
    whatever rate and drift. Negative feedback on the scene itself is a step towards ``retreat``
    where the rule has one. A profile that is already farther from its file than the drift comes
    nearer or stays.

    Args:
        kind: [...], as :class:`bt_agents_core.feedback.FeedbackKind`.
        profile: [..., n], inside the ranges.
        target: [..., n]; NaN leaves its parameter alone.
        rate: [..., n], as of :func:`rates`.
        rule: The learning rule, the same for all rows.
        recent: [..., k, n], what the feedbacks before this one asked for as of :func:`requested`,
            newest last, NaN for none; only ``MEDIAN`` looks at it.
        authored: [..., n], profile of the agent's file.
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
    # Rounding may carry the sum one digit past the target, which would be an overshoot.
    nearer = np.clip(after, np.minimum(profile, goal), np.maximum(profile, goal))
    after = _bounded(np.where(mirrored, after, nearer), profile, authored, rule.drift)
    after = np.clip(np.where(kinds == FeedbackKind.SET, target, after), low, high)
    return np.where(np.isnan(target), profile, after)


def median(samples: Array) -> Array:
    """Return the median of samples [..., k, n] over k, NaN left out; NaN where all are."""
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
