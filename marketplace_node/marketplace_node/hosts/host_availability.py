# SPDX-License-Identifier: Apache-2.0
"""Host availability: hosts that may be asked, runs they still have, what lost hosts leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from bt_agents_core.health import PartHealth
from bt_agents_core.open_goals import OpenGoal
from marketplace_node.health import hosts_health
from marketplace_node.hosts.goal_takeover import GoalTakeover
from marketplace_node.hosts.host_effects import (
    CancelAll,
    CancelGoal,
    Connect,
    Disconnect,
    Effect,
    RunGoal,
)
from marketplace_node.hosts.registry import HostEntry, Registration, RegistrationAnswer, Registry
from marketplace_node.settings import Settings

_CANCEL_AGAIN_S = 1.0
_CONFIRMED_S = 0.3  # the heartbeat of a run may arrive after its end
_OF_ANOTHER = "it still runs a tree for another market"


@dataclass(eq=False, kw_only=True)
class _OrphanRun:
    """Orphan: a tree that runs at a host without an award of this market.

    Attributes:
        instance: The start of its host.
        reason: Why its host is not free.
        goal: Its goal; None when unknown.
        blocks: True when its host must not be asked, because it is certainly not free.
        running_since: When the host first reported it, steady time [s]; None before.
        cancelled_at: When it was last cancelled, steady time [s]; None before.
    """

    instance: str
    reason: str
    goal: RunGoal | None = None
    blocks: bool = True
    running_since: float | None = None
    cancelled_at: float | None = None


class HostAvailability:
    """Registered hosts with their leases, orphans and open goals.

    Args:
        epoch: Name of this instance of the market.
        parameters: Names of the scene parameters.
        settings: Replaceable by :meth:`configure`.
        secret: As for :class:`Registry`.
        effects: Pending effects, to which it appends.

    Attributes:
        registry: The hosts and their agents.
        takeover: Goals that hosts have open at servers.
        earlier_hosts: Hosts that were alive at the end of the earlier market; empty for unknown.
    """

    def __init__(
        self,
        epoch: str,
        parameters: tuple[str, ...],
        settings: Settings,
        secret: bytes,
        effects: list[Effect],
    ) -> None:
        self.registry = Registry(parameters, settings.host_lease_s, secret)
        self.takeover = GoalTakeover()
        self.earlier_hosts: frozenset[str] = frozenset()
        self._epoch = epoch
        self._settings = settings
        self._effects = effects
        self._orphans: dict[str, _OrphanRun] = {}
        self._unheard: set[str] = set()

    def configure(self, settings: Settings) -> None:
        """Replace the settings."""
        self._settings = settings
        self.registry.lease_s = settings.host_lease_s

    def register(self, registration: Registration, now: float) -> RegistrationAnswer:
        """Register a host, and connect to it if it needs a new connection."""
        before = self.registry.get(registration.host)
        if before is None and (dead := self.registry.replaceable(now)):
            self.remove(dead)
            self._effects.append(Disconnect(host=dead))
        answer = self.registry.register(registration, now)
        entry = self.registry.get(registration.host)
        if answer.accepted and entry is not None:
            if before is None or before.instance != entry.instance:
                self._free(entry.host)
            if before is None or replace(before, agents=entry.agents) != entry:
                self._effects.append(Connect(entry=entry))
        return answer

    def remove(self, host: str) -> None:
        """Forget a host."""
        self.registry.remove(host)
        self._free(host)

    def heartbeat(
        self, host: str, epoch: str, round_number: int, award: RunGoal | None, now: float
    ) -> None:
        """Compare the run that a host reports with its award; round 0 means no run."""
        self._unheard.discard(host)
        of_this = epoch == self._epoch
        awarded = award is not None and (award.host, award.round) == (host, round_number)
        if round_number == 0 or (of_this and awarded):
            self._free(host)
            return
        orphan = self._orphans.get(host)
        if orphan is None:
            entry = self.registry.get(host)
            orphan = self._orphans[host] = _OrphanRun(
                instance=entry.instance if entry is not None else "",
                reason=f"it runs a tree of round {round_number} that nobody waits for",
                blocks=False,
            )
        if orphan.running_since is None:
            orphan.running_since = now
        if not of_this:
            # Its host stops it by itself, because the heartbeat of that market is missing.
            orphan.reason, orphan.goal, orphan.blocks = _OF_ANOTHER, None, True
        elif _is_due(orphan, now):
            orphan.blocks, orphan.cancelled_at = True, now
            self._effects.append(CancelAll(host=host))

    def extend_after_stall(self, since: float, now: float) -> None:
        """Renew leases and move deadlines, because the market was stalled since ``since``."""
        self.registry.extend_after_stall(since, now)
        self.takeover.extend_after_stall(now - since)
        for orphan in self._orphans.values():
            if orphan.running_since is not None:
                orphan.running_since += now - since

    def absences(self, now: float) -> dict[str, str]:
        """Return the hosts that cannot be asked, with the reason."""
        reasons = ((entry.host, self.absence(entry, now)) for entry in self.registry.entries())
        return {host: reason for host, reason in reasons if reason}

    def absence(self, entry: HostEntry, now: float) -> str:
        """Return why a host cannot be asked; empty when it can."""
        if not self.registry.is_live(entry.host, entry.instance, now):
            return "it has no heartbeat"
        if entry.host in self._unheard:
            return "it has not answered, and had no heartbeat since"
        return self.blocked(entry.host)

    def unheard(self, host: str) -> None:
        """Do not ask a host that left a call or goal unanswered before its next heartbeat."""
        self._unheard.add(host)

    def expected(self, now: float) -> dict[str, str]:
        """Return the hosts that cannot be asked but soon may be, with the reason.

        A host that is gone is expected back within ``host_wait_s``; the tree of a busy host is
        expected to end within ``cancel_deadline_s``. With a ``host_wait_s`` of 0 no host is
        expected.
        """
        expected: dict[str, str] = {}
        if self._settings.host_wait_s == 0:
            return expected
        for entry in self.registry.entries():
            reason = self.absence(entry, now)
            if reason and self._may_return(entry, now):
                expected[entry.host] = reason
        return expected

    def _may_return(self, entry: HostEntry, now: float) -> bool:
        if not self.registry.is_live(entry.host, entry.instance, now):
            return self.registry.gone_s(entry.host, now) < self._settings.host_wait_s
        orphan = self._orphans.get(entry.host)
        since = orphan.running_since if orphan is not None else None
        return since is None or now - since < self._settings.cancel_deadline_s

    def earlier_hosts_back(self, now: float) -> bool:
        """Return whether all hosts of the earlier market are known to be back."""
        if not self.earlier_hosts:
            return False
        return self.earlier_hosts <= {one.host for one in self.registry.with_heartbeat(now)}

    def blocked(self, host: str) -> str:
        """Return why a host is not free; empty when it is."""
        orphan = self._orphans.get(host)
        return orphan.reason if orphan is not None and orphan.blocks else ""

    def hold(self, host: str, now: float) -> str:
        """Return why no run may start at a host yet; empty when one may.

        The wait is bounded: a tree that does not stop holds others up no longer than
        ``cancel_deadline_s``, and a host without a heartbeat only by the goals that it left open.
        """
        self.take_over_goals(now)
        return self.takeover.obstacle() or self._other_host_busy(host, now)

    def _other_host_busy(self, host: str, now: float) -> str:
        for other, orphan in self._orphans.items():
            if (
                other != host
                and orphan.running_since is not None
                and now - orphan.running_since < self._settings.cancel_deadline_s
                and self.registry.is_live(other, orphan.instance, now)
            ):
                return f"{other} has not stopped: {orphan.reason}"
        return ""

    def open_goals(
        self, host: str, instance: str, goals: tuple[OpenGoal, ...], now: float
    ) -> None:
        """Store the goals that a start of a host has open at servers."""
        self.takeover.store(host, instance, goals)
        self.take_over_goals(now)

    def take_over_goals(self, now: float) -> None:
        """Cancel the goals that lost hosts left open."""
        self._effects += self.takeover.lost(
            lambda host, instance: self.registry.is_live(host, instance, now),
            self._settings.takeover_deadline_s,
            now,
        )

    def lose_goals(self, goal: RunGoal) -> tuple[str, ...]:
        """Cancel the goals that a lost run left open; return the nodes that sent them."""
        self._effects += self.takeover.lose(
            goal.host, goal.instance, self._settings.takeover_deadline_s
        )
        return self.takeover.orphans(goal.host, goal.instance)

    def give_up(self, goal: RunGoal, reason: str, now: float, *, runs: bool) -> None:
        """Cancel a goal that is no longer awaited, and block its host until the tree has ended.

        ``reason`` says why the host is not free; ``runs`` is True when it has accepted the goal.
        """
        entry = self.registry.get(goal.host)
        if entry is not None and entry.instance == goal.instance:
            self._orphans[goal.host] = _OrphanRun(
                instance=goal.instance,
                reason=reason,
                goal=goal,
                running_since=now if runs else None,
                cancelled_at=now,
            )
        self._effects.append(CancelGoal(goal=goal))

    def ended(self, goal: RunGoal) -> None:
        """Free the host of a given-up goal that has ended."""
        orphan = self._orphans.get(goal.host)
        if orphan is not None and orphan.goal == goal:
            del self._orphans[goal.host]

    def health(self, now: float) -> PartHealth:
        """Return the health of the registered hosts."""
        agents: Mapping[str, int] = {
            entry.host: len(entry.agents) for entry in self.registry.entries()
        }
        return hosts_health(agents, self.absences(now))

    def _free(self, host: str) -> None:
        self._orphans.pop(host, None)
        self._unheard.discard(host)


def _is_due(orphan: _OrphanRun, now: float) -> bool:
    """Whether to cancel an orphan now: once it is confirmed, and then repeatedly."""
    if orphan.cancelled_at is not None:
        return now - orphan.cancelled_at >= _CANCEL_AGAIN_S
    return orphan.running_since is not None and now - orphan.running_since >= _CONFIRMED_S
