# SPDX-License-Identifier: Apache-2.0
"""What all interactions of a market share: settings, hosts, counters and the effects due."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from bt_agents.scene import Scene, SceneSpace
from marketplace_node.auction import Terms
from marketplace_node.effects import CancelGoal, Effect, Goal
from marketplace_node.registry import HostEntry, Registry
from marketplace_node.settings import Settings

_CANCEL_AGAIN_S = 1.0


@dataclass(frozen=True, kw_only=True)
class _Block:
    reason: str
    goal: Goal | None = None
    cancelled_at: float = 0.0


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
        self._blocks: dict[str, _Block] = {}

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
            elif entry.host in self._blocks:
                unasked[entry.host] = self._blocks[entry.host].reason
            elif not entry.agents.keys() <= excluded.keys():
                asked.append(entry)
        return asked, unasked

    def obstacle(self, goal: Goal, now: float) -> str:
        """Return why a goal cannot be sent; empty when it can."""
        if not self.registry.is_live(goal.host, goal.instance, now):
            return f"{goal.host} is gone"
        block = self._blocks.get(goal.host)
        return f"{goal.host} is not free: {block.reason}" if block else ""

    def give_up(self, goal: Goal, reason: str, now: float) -> None:
        """Cancel a goal that nobody waits for, and keep off its host until the tree has ended."""
        entry = self.registry.get(goal.host)
        if entry is not None and entry.instance == goal.instance:
            self._blocks[goal.host] = _Block(reason=reason, goal=goal, cancelled_at=now)
        self.effects.append(CancelGoal(goal=goal))

    def ended(self, goal: Goal) -> None:
        """Free the host of a goal that was given up and has ended after all."""
        block = self._blocks.get(goal.host)
        if block is not None and block.goal == goal:
            del self._blocks[goal.host]

    def free(self, host: str) -> None:
        """Free a host, as it was started anew."""
        self._blocks.pop(host, None)

    def heartbeat(self, host: str, epoch: str, round_number: int, now: float) -> None:
        """Compare what a host is busy with to what it should be; round 0 means nothing."""
        block = self._blocks.get(host)
        if round_number == 0:
            self.free(host)
        elif epoch != self.epoch:
            self._blocks[host] = _Block(reason="it still runs a tree for another market")
        elif (
            block is not None
            and block.goal is not None
            and block.goal.round == round_number
            and now - block.cancelled_at >= _CANCEL_AGAIN_S
        ):
            self._blocks[host] = replace(block, cancelled_at=now)
            self.effects.append(CancelGoal(goal=block.goal))
