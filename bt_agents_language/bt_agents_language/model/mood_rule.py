# SPDX-License-Identifier: Apache-2.0
"""Mood rules: conditions that give feedback when they hold long enough during a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from bt_agents_core.feedback import FeedbackKind
from bt_agents_language.expression.expressions import Expression


class MoodAction(IntEnum):
    """Further effect of a mood rule; the numbers match ``MoodRule.msg``."""

    NONE = 0
    CANCEL = 1

    @property
    def ends_run(self) -> bool:
        """True if no rule can fire after it in the same run."""
        return self is MoodAction.CANCEL


ACTIONS: Mapping[str, tuple[MoodAction, str]] = {
    "cancel": (MoodAction.CANCEL, "stop the run and let the market ask again")
}
"""Value of ``then:`` → the action and its description."""


@dataclass(frozen=True, kw_only=True)
class MoodRule:
    """Rule that gives feedback when a condition on the mood holds while the agent runs.

    Attributes:
        when: Condition over ``mood.change``, ``scene.*`` and ``live.*``.
        hold_s: How long it must hold without a break [s].
        give: ``POSITIVE`` moves the profile towards the scene, ``NEGATIVE`` away from it.
        baseline_s: Initial time whose mean mood is the reference of ``mood.change`` [s]; 0 for
            the mood of the scene as awarded.
        release: Condition after which a rule that has fired is ready again; None for none.
        cooldown_s: Shortest time after which a rule that has fired is ready again [s].
        confidence: Moods with less confidence count as unknown, 0..1.
    """

    when: Expression
    hold_s: float = 0.0
    give: FeedbackKind
    action: MoodAction = MoodAction.NONE
    baseline_s: float = 0.0
    release: Expression | None = None
    cooldown_s: float = 0.0
    confidence: float = 0.0

    @property
    def repeats(self) -> bool:
        """True if it can fire more than once per run."""
        return self.release is not None or self.cooldown_s > 0.0
