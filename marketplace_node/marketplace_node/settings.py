# SPDX-License-Identifier: Apache-2.0
"""What can be set about the market while it works, checked as a whole before it counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from bt_agents.errors import Refused
from marketplace_node.strategies import STRATEGIES

ON_NEW_SCENE: Final = ("queue", "reject", "preempt")
TIE_BREAKS: Final = ("least_recently_run", "name")
MAX_QUEUE: Final = 100
MAX_MARGIN: Final = 100.0

SECONDS: Final = {
    "bid_deadline_s": (0.01, 60.0),
    "host_lease_s": (0.5, 60.0),
    "goal_deadline_s": (0.1, 60.0),
    "cancel_deadline_s": (0.1, 600.0),
    "collect_deadline_s": (0.05, 600.0),
    "preempt_cooldown_s": (0.0, 600.0),
}
"""Allowed range of each duration [s]."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the market decides and how long it waits.

    Attributes:
        strategy: Name of the ranking function.
        bid_deadline_s: From the call to the close of a round [s].
        host_lease_s: A host without a heartbeat for this long is gone [s].
        goal_deadline_s: Time for a host to take or refuse a goal [s].
        cancel_deadline_s: Time for a run to end after it was told to stop; longer than what a
            host needs for clean-up and open goals together [s].
        collect_deadline_s: Time for the feedback service to answer [s].
        on_new_scene: What happens to a scene that comes during an interaction.
        queue_limit: How many scenes may wait.
        preempt_margin: A running agent is stopped for another one that is nearer to the new scene
            by at least this distance.
        preempt_cooldown_s: After such a stop there is none other for this long [s].
        tie_break: Which of equally distant bids wins.

    Raises:
        Refused: ``UNKNOWN_CHOICE`` or ``OUT_OF_RANGE``.
    """

    strategy: str = "manhattan"
    bid_deadline_s: float = 0.5
    host_lease_s: float = 0.8
    goal_deadline_s: float = 2.0
    cancel_deadline_s: float = 6.5
    collect_deadline_s: float = 2.0
    on_new_scene: str = "queue"
    queue_limit: int = 10
    preempt_margin: float = 1.0
    preempt_cooldown_s: float = 5.0
    tie_break: str = "least_recently_run"

    def __post_init__(self) -> None:
        """Check every value."""
        _check_choice("strategy", self.strategy, tuple(STRATEGIES))
        _check_choice("on_new_scene", self.on_new_scene, ON_NEW_SCENE)
        _check_choice("tie_break", self.tie_break, TIE_BREAKS)
        for name, (least, most) in SECONDS.items():
            _check_range(name.removesuffix("_s"), getattr(self, name), least, most, " s")
        _check_range("queue_limit", self.queue_limit, 0, MAX_QUEUE, "")
        _check_range("preempt_margin", self.preempt_margin, 0.0, MAX_MARGIN, "")


def _check_choice(name: str, found: str, choices: tuple[str, ...]) -> None:
    if found not in choices:
        raise Refused("UNKNOWN_CHOICE", f"{name}: '{found}', expected one of {', '.join(choices)}")


def _check_range(name: str, found: float, least: float, most: float, unit: str) -> None:
    if not (math.isfinite(found) and least <= found <= most):
        raise Refused(
            "OUT_OF_RANGE", f"{name}: {found:g}{unit}, expected {least:g} to {most:g}{unit}"
        )
