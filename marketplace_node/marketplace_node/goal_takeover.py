# SPDX-License-Identifier: Apache-2.0
"""Goals that the starts of hosts have open, and what becomes of them when their host is gone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from bt_agents_core.open_goals import OpenGoal, name_goals
from marketplace_node.effects import CancelOpenGoals

MOST_STARTS = 200
"""Starts of hosts whose open goals are known; the oldest that was never registered makes room."""


@dataclass(eq=False, kw_only=True)
class _Start:
    """One start of a host: what it has open, and whether it was ever alive at this market."""

    goals: tuple[OpenGoal, ...]
    was_live: bool = False


@dataclass(eq=False)
class GoalTakeover:
    """State machine of the goals of all hosts; nobody acts before those of the dead have ended.

    A start that was never registered at this market is none of its business: it may be winding up
    a run of an earlier one.
    """

    _open: dict[tuple[str, str], _Start] = field(default_factory=dict)
    _ending: dict[tuple[str, str], tuple[OpenGoal, ...]] = field(default_factory=dict)
    _unconfirmed: list[str] = field(default_factory=list)

    def store(self, host: str, instance: str, goals: tuple[OpenGoal, ...]) -> None:
        """Store what a start of a host has open now."""
        start = self._open.get((host, instance))
        if not goals:
            self._open.pop((host, instance), None)
        elif start is not None:
            start.goals = goals
        elif self._has_room():
            self._open[host, instance] = _Start(goals=goals)

    def lost(self, is_live: Callable[[str, str], bool], within_s: float) -> list[CancelOpenGoals]:
        """Return the cancellations of the goals whose host is gone since it was last asked."""
        effects = []
        for (host, instance), start in list(self._open.items()):
            if is_live(host, instance):
                start.was_live = True
            elif start.was_live:
                effects += self.lose(host, instance, within_s)
        return effects

    def lose(self, host: str, instance: str, within_s: float) -> list[CancelOpenGoals]:
        """Return the cancellation of the goals of a start whose run is given up, if it has any."""
        if (host, instance) in self._ending:
            # What it has sent since is cancelled when that has ended.
            return []
        start = self._open.pop((host, instance), None)
        if start is None:
            return []
        self._ending[host, instance] = start.goals
        return [
            CancelOpenGoals(host=host, instance=instance, goals=start.goals, within_s=within_s)
        ]

    def ended(self, host: str, instance: str, unconfirmed: tuple[OpenGoal, ...]) -> str:
        """Handle the end of a cancellation; return in words what is not confirmed, if anything."""
        if self._ending.pop((host, instance), None) is None or not unconfirmed:
            return ""
        self._unconfirmed.append(f"{name_goals(unconfirmed)} of {host}")
        return (
            f"goals of {host} may go on, as their servers have not confirmed their end: "
            f"{name_goals(unconfirmed)}"
        )

    def orphans(self, host: str, instance: str) -> tuple[str, ...]:
        """Return the nodes whose goals are being cancelled, by their paths."""
        return tuple(goal.path for goal in self._ending.get((host, instance), ()))

    def obstacle(self) -> str:
        """Return why nobody may begin to act; empty when everything has ended."""
        for (host, _), goals in self._ending.items():
            return f"goals of {host} are being cancelled: {name_goals(goals)}"
        return ""

    def take_unconfirmed(self) -> str:
        """Return once what may go on beside the next run; empty for nothing."""
        taken, self._unconfirmed = self._unconfirmed, []
        return f"not confirmed to have ended: {'; '.join(taken)}" if taken else ""

    def _has_room(self) -> bool:
        if len(self._open) >= MOST_STARTS:
            stranger = next((key for key, one in self._open.items() if not one.was_live), None)
            if stranger is None:
                return False
            del self._open[stranger]
        return True
