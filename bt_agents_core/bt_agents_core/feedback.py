# SPDX-License-Identifier: Apache-2.0
"""Kinds and sources of feedback, and the learning rule of an agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum

TUNING = "tuning"
"""Source of feedback that applies a tuning."""

BUTTON = "button"
"""Source of feedback that a person gives with a button."""

MOOD_RULE = "mood rule"
"""Source of feedback that a mood rule of the agent gives."""

FLEET = "fleet"
"""Source of the learning steps of other robots in the fleet."""

WEIGHTS: Mapping[str, float] = {BUTTON: 1.0, MOOD_RULE: 0.5}
"""Default weights of sources that an agent's file does not weigh; others weigh 1."""


class FeedbackKind(IntEnum):
    """Kind of feedback; the numbers match ``Feedback.msg``."""

    DIRECT = 0
    POSITIVE = 1
    NEGATIVE = 2
    SET = 3


class Share(StrEnum):
    """Part of an agent's learning that the robots of a fleet share."""

    EVERYTHING = "everything"
    PLACE = "place"
    NOTHING = "nothing"


class Update(StrEnum):
    """Update rule of a profile: plain, or robust against wrong feedback."""

    PLAIN = "plain"
    HUBER = "huber"
    MEDIAN = "median"


@dataclass(frozen=True, kw_only=True)
class LearningRule:
    """Learning rule of an agent; the defaults give the paper's formula.

    Attributes:
        rates: Learning rates that override the agent's, by parameter, 0..1; 0 freezes it.
        update: ``PLAIN`` follows each feedback, ``HUBER`` at most as far as ``width``, ``MEDIAN``
            the median of the last ``window``.
        width: For ``HUBER``: largest distance that counts, by parameter, in its unit; without an
            entry it is a quarter of the range.
        window: For ``MEDIAN``: how many of the last feedbacks count, 1 or more.
        anneal: The rate after n changes is ``rate / (1 + anneal * n)``; 0 keeps it constant.
        drift: Farthest that feedback moves the profile from its file, by parameter, in its unit.
        retreat: Value that negative feedback moves a parameter to when profile and scene are
            equal there, so that no direction leads away; in its unit.
        weights: Factor on the rate for feedback from a source, 0 or more.
        layers: What the agent learns separately: ``person``, ``place``.
        general: Share of a layer's learning that also applies to the profile for everybody, 0..1.
        share: What the robots of a fleet learn together: all but persons, places, or nothing.
    """

    rates: Mapping[str, float] = field(default_factory=dict)
    update: Update = Update.PLAIN
    width: Mapping[str, float] = field(default_factory=dict)
    window: int = 5
    anneal: float = 0.0
    drift: Mapping[str, float] = field(default_factory=dict)
    retreat: Mapping[str, float] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    layers: tuple[str, ...] = ()
    general: float = 1.0
    share: Share = Share.NOTHING

    def weight(self, source: str) -> float:
        """Return the weight of feedback from a source."""
        return self.weights.get(source, WEIGHTS.get(source, 1.0))
