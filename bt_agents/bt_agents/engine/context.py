# SPDX-License-Identifier: Apache-2.0
"""What the nodes of one run share: world, clock, chance and the goals that are under way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from random import Random

from bt_agents.engine.environment import Clock, Environment, GoalRun, Inbox, SkillGoal
from bt_agents.engine.scope import RunScope
from bt_agents_core.feedback import FeedbackKind


@dataclass(frozen=True)
class _OpenGoal:
    path: str
    run: GoalRun


class RunContext:
    """Gives leaves access to the world and remembers every goal until its end is confirmed.

    Args:
        world: What the tree can reach.
        scope: The names of the run.
        random: Where nodes that leave something to chance draw their numbers.

    Attributes:
        wakes: Paths of nodes → when the next tick will make a difference to them although
            nothing comes from outside, on the trees' clock [s]; those of the last tick.
    """

    def __init__(self, world: Environment, scope: RunScope, random: Random) -> None:
        self.scope = scope
        self.random = random
        self.wakes: dict[str, float] = {}
        self._world = world
        self._goals: list[_OpenGoal] = []

    @property
    def clock(self) -> Clock:
        """The trees' clock."""
        return self._world.clock

    def wake(self, path: str, at: float) -> None:
        """Note when time alone will make a difference to the node at ``path`` [s]."""
        self.wakes[path] = at

    def reached(self, path: str, at: float) -> bool:
        """Return whether a time has come for the node at ``path`` [s]; if not, note it."""
        if self.clock() >= at:
            return True
        self.wake(path, at)
        return False

    def send(self, path: str, goal: SkillGoal) -> GoalRun:
        """Send a goal in the name of the node at ``path``."""
        return self._opened(path, self._world.send(goal))

    def publish(self, goal: SkillGoal) -> None:
        """Publish a message."""
        self._world.publish(goal)

    def watch(self, topic: str, type_name: str, *, latched: bool = False) -> Inbox:
        """Listen to a topic; if it is latched, its last message from before comes first."""
        return self._world.watch(topic, type_name, latched=latched)

    def log(self, level: str, text: str) -> None:
        """Write a line into the log."""
        self._world.log(level, text)

    def give_feedback(
        self, path: str, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Ask for a change of the profile in the name of the node at ``path``."""
        return self._opened(path, self._world.give_feedback(kind, values, reason))

    def open_goals(self) -> tuple[str, ...]:
        """Return the node paths of all goals whose end their servers have not confirmed."""
        self._goals = [goal for goal in self._goals if not goal.run.confirmed]
        return tuple(goal.path for goal in self._goals)

    def _opened(self, path: str, run: GoalRun) -> GoalRun:
        under_way = [goal for goal in self._goals if not goal.run.confirmed]
        self._goals = [*under_way, _OpenGoal(path, run)]
        return run
