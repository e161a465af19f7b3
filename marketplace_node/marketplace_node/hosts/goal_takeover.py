# SPDX-License-Identifier: Apache-2.0
"""Open goals of each start of a host, and their cancellation once the host is gone."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from bt_agents_core.open_goals import OpenGoal, name_goals
from marketplace_node.hosts.host_effects import CancelOpenGoals

MOST_STARTS = 200
"""Most starts of hosts that are tracked; the oldest that never registered makes room."""


@dataclass(frozen=True, kw_only=True)
class StoredGoals:
    """Goals that a start of a host had open at an earlier start of the market."""

    host: str
    instance: str
    goals: tuple[OpenGoal, ...]


@dataclass(eq=False, kw_only=True)
class _Start:
    """One start of a host with its open goals.

    Attributes:
        was_live: Whether it was ever alive in this market.
        awaited_until: When its time to register ends, steady time [s], if only an earlier market
            knew it; None for all others.
    """

    goals: tuple[OpenGoal, ...]
    was_live: bool = False
    awaited_until: float | None = None

    @property
    def was_registered(self) -> bool:
        """True if it was alive in this market or registered with an earlier one."""
        return self.was_live or self.awaited_until is not None


@dataclass(eq=False)
class GoalTakeover:
    """State machine of all hosts' open goals; no run starts before dead hosts' goals end.

    It ignores a start that never registered with this market: that start may be finishing a run
    of an earlier market. A start that was registered with the earlier market has some time to
    register with this one; after that it counts as dead.
    """

    _open: dict[tuple[str, str], _Start] = field(default_factory=dict)
    _ending: dict[tuple[str, str], tuple[OpenGoal, ...]] = field(default_factory=dict)
    _unconfirmed: list[str] = field(default_factory=list)

    def store(self, host: str, instance: str, goals: tuple[OpenGoal, ...]) -> None:
        """Store the goals that a start of a host has open now."""
        start = self._open.get((host, instance))
        if not goals:
            self._open.pop((host, instance), None)
        elif start is not None:
            start.goals = goals
        elif self._has_room():
            self._open[host, instance] = _Start(goals=goals)

    @property
    def stored(self) -> tuple[StoredGoals, ...]:
        """Goals that a later start of the market must know, including those being cancelled."""
        starts = [(key, start.goals) for key, start in self._open.items() if start.was_registered]
        return tuple(
            StoredGoals(host=host, instance=instance, goals=goals)
            for (host, instance), goals in [*self._ending.items(), *starts]
        )

    def restore(self, stored: Iterable[StoredGoals], until: float) -> None:
        """Restore what an earlier market stored; hosts silent until ``until`` count as dead."""
        for one in stored:
            if one.goals and self._has_room():
                self._open[one.host, one.instance] = _Start(goals=one.goals, awaited_until=until)

    def extend_after_stall(self, lasted_s: float) -> None:
        """Wait longer for hosts, because the market itself was stalled for ``lasted_s`` [s]."""
        for start in self._open.values():
            if start.awaited_until is not None:
                start.awaited_until += lasted_s

    def lost(
        self, is_live: Callable[[str, str], bool], within_s: float, now: float
    ) -> list[CancelOpenGoals]:
        """Return the cancellations for hosts that are gone since the last call."""
        effects = []
        for (host, instance), start in list(self._open.items()):
            if is_live(host, instance):
                start.was_live, start.awaited_until = True, None
            elif start.was_live or (
                start.awaited_until is not None and now >= start.awaited_until
            ):
                effects += self.lose(host, instance, within_s)
        return effects

    def lose(self, host: str, instance: str, within_s: float) -> list[CancelOpenGoals]:
        """Return the cancellation of the goals of a start whose run is given up, if any."""
        if (host, instance) in self._ending:
            # Goals that it has sent since are cancelled once this cancellation has ended.
            return []
        start = self._open.pop((host, instance), None)
        if start is None:
            return []
        self._ending[host, instance] = start.goals
        return [
            CancelOpenGoals(host=host, instance=instance, goals=start.goals, within_s=within_s)
        ]

    def ended(self, host: str, instance: str, unconfirmed: tuple[OpenGoal, ...]) -> str:
        """Handle the end of a cancellation; return in words which ends are unconfirmed, if any."""
        if self._ending.pop((host, instance), None) is None or not unconfirmed:
            return ""
        self._unconfirmed.append(f"{name_goals(unconfirmed)} of {host}")
        return (
            f"goals of {host} may go on, as their servers have not confirmed their end: "
            f"{name_goals(unconfirmed)}"
        )

    def orphans(self, host: str, instance: str) -> tuple[str, ...]:
        """Return the paths of the nodes whose goals are being cancelled."""
        return tuple(goal.path for goal in self._ending.get((host, instance), ()))

    def obstacle(self) -> str:
        """Return why no run may start; empty when all goals have ended."""
        for (host, _), goals in self._ending.items():
            return f"goals of {host} are being cancelled: {name_goals(goals)}"
        for (host, _), start in self._open.items():
            if start.awaited_until is not None:
                return f"{host} may have open goals of an earlier run: {name_goals(start.goals)}"
        return ""

    def take_unconfirmed(self) -> str:
        """Return, once, which goals may still run during the next run; empty for none."""
        taken, self._unconfirmed = self._unconfirmed, []
        return f"not confirmed to have ended: {'; '.join(taken)}" if taken else ""

    def _has_room(self) -> bool:
        if len(self._open) >= MOST_STARTS:
            stranger = next(
                (key for key, one in self._open.items() if not one.was_registered), None
            )
            if stranger is None:
                return False
            del self._open[stranger]
        return True
