# SPDX-License-Identifier: Apache-2.0
"""What all interactions of a market share: settings, hosts, counters and the effects due."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents.scene import Scene, SceneSpace
from marketplace_node.auction import Terms
from marketplace_node.effects import CancelAll, CancelGoal, Disconnect, Effect, Goal
from marketplace_node.registry import HostEntry, Registry
from marketplace_node.settings import Settings

_CANCEL_AGAIN_S = 1.0
_SURE_S = 0.3  # a heartbeat of a run may come after its end
_OF_ANOTHER = "it still runs a tree for another market"


@dataclass(eq=False, kw_only=True)
class _Stray:
    """A tree that nobody waits for.

    Attributes:
        instance: The start of its host.
        reason: What is known of it, in words.
        goal: Its goal, as far as it is known.
        blocks: True when its host is not to be asked, as it surely is not free.
        heard_at: Since when the host says that it runs, steady time [s]; None when it does not.
        cancelled_at: When it was last told to stop, steady time [s]; None before.
    """

    instance: str
    reason: str
    goal: Goal | None = None
    blocks: bool = True
    heard_at: float | None = None
    cancelled_at: float | None = None


class Floor:
    """The trading floor: who is there, who is free, and what has happened so far.

    Attributes:
        space: The scene parameters.
        epoch: Name of this instance of the market.
        settings: The settings in force.
        registry: The hosts and agents.
        effects: What is to be done, in order.
        rounds: How many rounds there have been; the number of the last one.
    """

    def __init__(self, space: SceneSpace, epoch: str, settings: Settings) -> None:
        self.space = space
        self.epoch = epoch
        self.settings = settings
        self.registry = Registry(space.names, settings.host_lease_s)
        self.effects: list[Effect] = []
        self.rounds = 0
        self._runs = 0
        self._last_run: dict[str, int] = {}
        self._strays: dict[str, _Stray] = {}

    def terms(
        self,
        scene: Scene,
        *,
        follows: int,
        excluded: Mapping[str, str],
        unasked: Mapping[str, str],
    ) -> Terms:
        """Count a new round and return what is fixed in it."""
        self.rounds += 1
        return Terms(
            epoch=self.epoch,
            round=self.rounds,
            follows=follows,
            scene=scene,
            strategy=self.settings.strategy,
            tie_break=self.settings.tie_break,
            excluded=dict(excluded),
            unasked=unasked,
            last_run=dict(self._last_run),
        )

    def count_run(self, agent: str) -> None:
        """Note that an agent runs; ties go to whoever has not run for longest."""
        self._runs += 1
        self._last_run[agent] = self._runs

    def whom_to_ask(
        self, excluded: Mapping[str, str], now: float
    ) -> tuple[list[HostEntry], dict[str, str]]:
        """Return the hosts to ask, and those that are not asked with the reason."""
        asked, unasked = [], {}
        for entry in self.registry.entries():
            if not self.registry.is_live(entry.host, entry.instance, now):
                unasked[entry.host] = "it has no heartbeat"
            elif reason := self._blocked(entry.host):
                unasked[entry.host] = reason
            elif not entry.agents.keys() <= excluded.keys():
                asked.append(entry)
        return asked, unasked

    def obstacle(self, goal: Goal, now: float) -> str:
        """Return why a goal cannot be sent; empty when it can."""
        if not self.registry.is_live(goal.host, goal.instance, now):
            return f"{goal.host} is gone"
        reason = self._blocked(goal.host)
        return f"{goal.host} is not free: {reason}" if reason else ""

    def in_the_way(self, host: str, now: float) -> str:
        """Return why nothing may begin at a host yet, as another one still has the robot.

        That is no obstacle for ever: a tree that does not stop is waited for as long as for a
        run that was told to stop, and a host without a heartbeat is not waited for.
        """
        for other, stray in self._strays.items():
            if (
                other != host
                and stray.heard_at is not None
                and now - stray.heard_at < self.settings.cancel_deadline_s
                and self.registry.is_live(other, stray.instance, now)
            ):
                return f"{other} has not stopped: {stray.reason}"
        return ""

    def give_up(self, goal: Goal, reason: str, now: float, *, runs: bool) -> None:
        """Cancel a goal that nobody waits for, and keep off its host until the tree has ended.

        Args:
            goal: The goal.
            reason: Why its host is not free, in words.
            now: Steady time [s].
            runs: True when the host has taken it.
        """
        entry = self.registry.get(goal.host)
        if entry is not None and entry.instance == goal.instance:
            self._strays[goal.host] = _Stray(
                instance=goal.instance,
                reason=reason,
                goal=goal,
                heard_at=now if runs else None,
                cancelled_at=now,
            )
        self.effects.append(CancelGoal(goal=goal))

    def ended(self, goal: Goal) -> None:
        """Free the host of a goal that was given up and has ended after all."""
        stray = self._strays.get(goal.host)
        if stray is not None and stray.goal == goal:
            del self._strays[goal.host]

    def free(self, host: str) -> None:
        """Free a host, as it was started anew."""
        self._strays.pop(host, None)

    def forget(self, host: str) -> None:
        """Forget a host, and reach it no more."""
        self.registry.remove(host)
        self.free(host)
        self.effects.append(Disconnect(host=host))

    def excuse(self, since: float, now: float) -> None:
        """Renew leases and move deadlines, as nobody has listened since ``since``."""
        self.registry.excuse(since, now)
        for stray in self._strays.values():
            if stray.heard_at is not None:
                stray.heard_at += now - since

    def heartbeat(
        self, host: str, epoch: str, round_number: int, award: Goal | None, now: float
    ) -> None:
        """Compare what a host is busy with to what it should be; round 0 means nothing."""
        of_this = epoch == self.epoch
        awarded = award is not None and (award.host, award.round) == (host, round_number)
        if round_number == 0 or (of_this and awarded):
            self.free(host)
            return
        stray = self._strays.get(host)
        if stray is None:
            stray = self._strays[host] = self._suspect(host, round_number)
        if stray.heard_at is None:
            stray.heard_at = now
        if not of_this:
            # Its host stops it, as it misses the heartbeat of that market.
            stray.reason, stray.goal, stray.blocks = _OF_ANOTHER, None, True
        elif _is_due(stray, now):
            stray.blocks, stray.cancelled_at = True, now
            self.effects.append(CancelAll(host=host))

    def _suspect(self, host: str, round_number: int) -> _Stray:
        entry = self.registry.get(host)
        return _Stray(
            instance=entry.instance if entry is not None else "",
            reason=f"it runs a tree of round {round_number} that nobody waits for",
            blocks=False,
        )

    def _blocked(self, host: str) -> str:
        stray = self._strays.get(host)
        return stray.reason if stray is not None and stray.blocks else ""


def _is_due(stray: _Stray, now: float) -> bool:
    """Whether a tree is to be told to stop: once that is sure, and then again and again."""
    if stray.cancelled_at is not None:
        return now - stray.cancelled_at >= _CANCEL_AGAIN_S
    return stray.heard_at is not None and now - stray.heard_at >= _SURE_S
