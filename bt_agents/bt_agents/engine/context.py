# SPDX-License-Identifier: Apache-2.0
"""Shared state of the nodes of one run: environment, clock, random source and open goals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from random import Random

from py_trees.behaviour import Behaviour

from bt_agents.engine.environment import Environment, GoalRun, PluginNode, SkillGoal
from bt_agents.engine.scope import RunScope, Scope
from bt_agents_core.feedback import FeedbackKind
from bt_agents_language.model.specs import NodeSpec


class RunContext:
    """Gives leaves access to the environment; tracks each goal until its end is confirmed.

    Attributes:
        clock: The trees' clock.
        environment: The environment. Send goals and feedback by the methods of this class.
        deadlines: Path of a node → when time alone changes its behaviour, on the trees' clock [s];
            those of the last tick.
    """

    def __init__(self, environment: Environment, scope: RunScope, random: Random) -> None:
        self.scope = scope
        self.random = random
        self.deadlines: dict[str, float] = {}
        self.clock = environment.clock
        self.environment = environment
        # Each with the path of its node; some may be confirmed already.
        self._goals: list[tuple[str, GoalRun]] = []
        self._plugin_nodes: list[tuple[str, PluginNode]] = []
        self._closers: list[Callable[[], None]] = []

    def is_due(self, path: str, at: float) -> bool:
        """Return whether a time [s] has come for the node at ``path``; if not, set a deadline."""
        if self.clock() >= at:
            return True
        self.deadlines[path] = at
        return False

    def pick(self, path: str, count: int, last: int | None) -> int:
        """Return which variant the node at ``path`` takes; never the last one again."""
        del path
        return self.random.choice([number for number in range(count) if number != last])

    def picked_child(self, spec: NodeSpec) -> int | None:
        """Return the index of the child that a ``random`` takes; None if it draws one."""
        del spec
        return None

    def send(self, path: str, goal: SkillGoal) -> GoalRun:
        """Send a goal for the node at ``path``."""
        return self._track(path, self.environment.send(goal))

    def give_feedback(
        self, path: str, kind: FeedbackKind, values: Mapping[str, float], reason: str
    ) -> GoalRun:
        """Request a change of the profile for the node at ``path``."""
        return self._track(path, self.environment.give_feedback(kind, values, reason))

    def open_goals(self) -> tuple[str, ...]:
        """Return the node paths of all goals whose servers have not confirmed the end."""
        self._goals = [(path, run) for path, run in self._goals if not run.confirmed]
        plugins = (path for path, node in self._plugin_nodes for _ in range(node.open_goals()))
        return (*(path for path, _ in self._goals), *plugins)

    def open_plugin_node(self, path: str) -> PluginNode | None:
        """Return the ROS node for the plug-in at ``path``; its goals are tracked."""
        node = self.environment.open_plugin_node(path)
        if node is not None:
            self._plugin_nodes.append((path, node))
        return node

    def forget_plugin_node(self, node: PluginNode) -> None:
        """Stop tracking a closed node."""
        self._plugin_nodes = [one for one in self._plugin_nodes if one[1] is not node]

    def on_close(self, close: Callable[[], None]) -> None:
        """Register a function that cleans up after the run; it must not raise."""
        self._closers.append(close)

    def close(self) -> None:
        """Clean up what the nodes have set up for the whole run."""
        closers, self._closers = self._closers, []
        for close in closers:
            close()

    def _track(self, path: str, run: GoalRun) -> GoalRun:
        under_way = [(node, goal) for node, goal in self._goals if not goal.confirmed]
        self._goals = [*under_way, (path, run)]
        return run


BuildChild = Callable[[NodeSpec, Scope], Behaviour]
"""Builds a child of the node under construction, with the names that it can see."""

NodeMaker = Callable[[NodeSpec, RunContext, Scope, BuildChild], Behaviour]
"""Makes the behaviour of a node; usually its class."""
