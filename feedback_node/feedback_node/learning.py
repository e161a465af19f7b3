# SPDX-License-Identifier: Apache-2.0
"""How feedback moves a profile: to or towards a wanted vector, towards a scene or away from it.

Sources: direct feedback is the update of section 2.3.4 of the paper, "the positive or negative
distance of the user feedback from the corresponding parameter [...] multiplied with a factor for
the learning rate". Positive and negative feedback are its section 4.2, "shift all parameters of
the agent in the direction of the recognized scene [...] or away from the actual scene".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from bt_agents.errors import Refused
from bt_agents.feedback import Kind
from bt_agents.scene import SceneSpace, Vector


@dataclass(frozen=True, kw_only=True)
class Step:
    """One move of a profile; all vectors in the order of the space.

    Attributes:
        kind: What was asked for.
        before: Profile before.
        target: Vector moved towards or away from; NaN for no opinion.
        rate: Learning rate η that was used, 0..1.
        after: Profile after, inside the ranges.
        words: The move in words and numbers; says why when nothing has moved.
    """

    kind: Kind
    before: Vector
    target: Vector
    rate: float
    after: Vector
    words: str


def direct(profile: Vector, target: Vector, rate: float, space: SceneSpace) -> Step:
    """Move a profile towards a wanted vector: ``p ← p + η·(f − p)``.

    Args:
        profile: Profile p.
        target: Wanted vector f; NaN leaves its parameter alone.
        rate: Learning rate η.
        space: The parameters and their ranges.

    Raises:
        Refused: ``NO_OPINION`` when all of ``target`` is NaN, ``BAD_RATE``, or as in
            :meth:`SceneSpace.vector`.
    """
    return _step(Kind.DIRECT, profile, _opinion(target, space), rate, space)


def assigned(profile: Vector, target: Vector, _rate: float, space: SceneSpace) -> Step:
    """Set a profile to a wanted vector at once: ``p ← f``, whatever the learning rate.

    Raises:
        Refused: As in :func:`direct`.
    """
    return _step(Kind.SET, profile, _opinion(target, space), 1.0, space)


def positive(profile: Vector, scene: Vector, rate: float, space: SceneSpace) -> Step:
    """Move a profile towards a scene: ``p ← p + η·(s − p)``; missing values have no opinion.

    Raises:
        Refused: ``NO_SCENE`` when the scene knows no value, else as in :func:`direct`.
    """
    return _step(Kind.POSITIVE, profile, _known(scene, space), rate, space)


def negative(profile: Vector, scene: Vector, rate: float, space: SceneSpace) -> Step:
    """Move a profile away from a scene by the same step: ``p ← p − η·(s − p)``.

    A profile that lies exactly on the scene has no direction away from it and stays.

    Raises:
        Refused: ``NO_SCENE`` when the scene knows no value, else as in :func:`direct`.
    """
    return _step(Kind.NEGATIVE, profile, _known(scene, space), rate, space)


def checked_rate(rate: float, *, what: str = "feedback") -> float:
    """Return a learning rate that is finite and in 0..1.

    Raises:
        Refused: ``BAD_RATE``.
    """
    if not 0.0 <= rate <= 1.0:
        raise Refused("BAD_RATE", f"{what}: learning rate {rate:g}, expected a number from 0 to 1")
    return rate


def _opinion(target: Vector, space: SceneSpace) -> Vector:
    vector = space.vector(target, missing=True, what="feedback")
    if all(math.isnan(value) for value in vector):
        raise Refused(
            "NO_OPINION",
            f"feedback: every value is NaN; give a number for at least one of "
            f"{', '.join(space.names)}",
        )
    return vector


def _known(scene: Vector, space: SceneSpace) -> Vector:
    vector = space.vector(scene, missing=True, what="scene")
    if all(math.isnan(value) for value in vector):
        raise Refused(
            "NO_SCENE",
            "scene: every value is missing, so there is nothing to move towards or away from; "
            "give DIRECT feedback or wait until the scene layer measures something",
        )
    return vector


def _step(kind: Kind, profile: Vector, target: Vector, rate: float, space: SceneSpace) -> Step:
    before = space.vector(profile, what="profile")
    checked_rate(rate)
    after = space.clamp([_moved(kind, p, f, rate) for p, f in zip(before, target, strict=True)])
    moves = [
        f"{name} {old:.4g} → {new:.4g}"
        for name, old, new in zip(space.names, before, after, strict=True)
        if old != new
    ]
    words = ", ".join(moves) or f"the profile stays: {_why_not(kind, before, target, rate)}"
    return Step(kind=kind, before=before, target=target, rate=rate, after=after, words=words)


def _moved(kind: Kind, value: float, target: float, rate: float) -> float:
    if math.isnan(target):
        return value
    if kind is Kind.SET:
        return target
    distance = target - value
    if kind is Kind.NEGATIVE:
        return value - rate * distance
    # Rounding may carry the sum one digit past the target, which would be an overshoot.
    low, high = min(value, target), max(value, target)
    return min(max(value + rate * distance, low), high)


def _why_not(kind: Kind, before: Vector, target: Vector, rate: float) -> str:
    if rate == 0.0:
        return "the learning rate is 0"
    if any(f != p for p, f in zip(before, target, strict=True) if not math.isnan(f)):
        return (
            "it is at the edge of the ranges" if kind is Kind.NEGATIVE else "the step is too small"
        )
    if kind is Kind.NEGATIVE:
        return "it lies exactly on the scene, so no direction leads away"
    return "it is there already"
