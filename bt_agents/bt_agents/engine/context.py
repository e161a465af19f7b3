# SPDX-License-Identifier: Apache-2.0
"""What the nodes of one run share: the world, the clock and the goals that are under way."""

from __future__ import annotations

from dataclasses import dataclass

from bt_agents.engine.scope import RunScope
from bt_agents.engine.world import Clock, Goal, GoalRun, Inbox, World
from bt_agents.language.specs import Position


@dataclass(frozen=True)
class _OpenGoal:
    path: str
    run: GoalRun


class RunContext:
    """Gives leaves access to the world and remembers every goal until it has ended."""

    def __init__(self, world: World, scope: RunScope) -> None:
        self.scope = scope
        self._world = world
        self._goals: list[_OpenGoal] = []

    @property
    def clock(self) -> Clock:
        """The trees' clock."""
        return self._world.clock

    def send(self, path: str, goal: Goal) -> GoalRun:
        """Send a goal in the name of the node at ``path``."""
        run = self._world.send(goal)
        self._goals.append(_OpenGoal(path, run))
        return run

    def publish(self, goal: Goal) -> None:
        """Publish a message."""
        self._world.publish(goal)

    def watch(self, topic: str, type_name: str) -> Inbox:
        """Listen to a topic."""
        return self._world.watch(topic, type_name)

    def open_goals(self) -> tuple[str, ...]:
        """Return the node paths of all goals that have not ended."""
        self._goals = [goal for goal in self._goals if not goal.run.state.ended]
        return tuple(goal.path for goal in self._goals)


def place(path: str, position: Position) -> str:
    """Return where a node is, for messages: its path and its place in the file."""
    return f"{path}, {position}"
