# SPDX-License-Identifier: Apache-2.0
"""Kinds and sources of feedback, and the learning rule of an agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum

TUNING = "tuning"
"""Source of feedback that sets what somebody has tuned."""

BUTTON = "button"
"""Source of feedback that a person gives with a button."""

MOOD_RULE = "mood rule"
"""Source of feedback that a mood rule of the agent gives."""

FLEET = "fleet"
"""Source of the steps that other robots of the fleet have made."""

WEIGHTS: Mapping[str, float] = {BUTTON: 1.0, MOOD_RULE: 0.5}
"""How much the sources count that an agent's file does not weigh; all others count 1."""


class FeedbackKind(IntEnum):
    """Kind of feedback; the numbers are those of ``Feedback.msg``."""

    DIRECT = 0
    POSITIVE = 1
    NEGATIVE = 2
    SET = 3


class Share(StrEnum):
    """What of an agent's learning the robots of a fleet share."""

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
    """Learning rule of an agent; the defaults are the paper's formula.

    Attributes:
        rates: Learning rate of a parameter, 0..1, where it is not the agent's; 0 freezes it.
        update: ``PLAIN`` follows each feedback, ``HUBER`` no farther than ``width``, ``MEDIAN``
            the median of the last ``window``.
        width: Of ``HUBER``: largest distance that counts, by parameter, in its unit; one without
            an entry takes :data:`feedback_node.learning.updates.WIDTH_SHARE` of its range.
        window: Of ``MEDIAN``: how many of the last feedbacks count, 1 or more.
        anneal: The rate after n changes is ``rate / (1 + anneal * n)``; 0 keeps it constant.
        drift: Farthest that feedback takes the profile from its file, by parameter, in its unit.
        retreat: Value that negative feedback moves a parameter to when the profile lies on the
            scene there, so that nothing leads away; in its unit.
        weights: What the rate is multiplied by for feedback of a source, 0 or more.
        layers: What the agent learns apart: ``person``, ``place``.
        general: How much of what a layer learns the profile for everybody learns, too, 0..1.
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
