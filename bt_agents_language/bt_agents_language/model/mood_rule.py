# SPDX-License-Identifier: Apache-2.0
"""A mood rule: which condition, held how long during a run, becomes feedback by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from bt_agents_core.feedback import FeedbackKind
from bt_agents_language.expression.expressions import Expression


class MoodAction(IntEnum):
    """What a mood rule does besides giving feedback; the numbers are those of ``MoodRule.msg``."""

    NONE = 0
    CANCEL = 1

    @property
    def ends_run(self) -> bool:
        """True when no rule can fire after it in the same run."""
        return self is MoodAction.CANCEL


ACTIONS: Mapping[str, tuple[MoodAction, str]] = {
    "cancel": (MoodAction.CANCEL, "stop the run and let the market ask again")
}
"""Word that ``then:`` takes → the action and what it does."""


@dataclass(frozen=True, kw_only=True)
class MoodRule:
    """Feedback that a condition on the mood gives by itself while the agent runs.

    Attributes:
        when: Condition over ``mood.change``, ``scene.*`` and ``live.*``.
        hold_s: How long it must hold without a break [s].
        give: ``POSITIVE`` moves the profile towards the scene, ``NEGATIVE`` away from it.
        baseline_s: ``mood.change`` is against the mean mood of so long at the start [s]; 0 for
            the mood of the scene as awarded.
        release: Condition after which a rule that has fired is ready again; None for none.
        cooldown_s: A rule that has fired is ready again after so long at the earliest [s].
        confidence: Moods with less confidence are not known, 0..1.
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
        """True when it can fire more than once a run."""
        return self.release is not None or self.cooldown_s > 0.0
