# SPDX-License-Identifier: Apache-2.0
"""Problems on the ROS graph that can keep a skill from working, and servers out of reach."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence, Set

from bt_agents.engine.environment import GoalState
from bt_agents_core.field_types import BindingKind
from bt_agents_core.ros_names import other_types

MOST_PROBLEMS = 200

MOST_SERVERS = 200

FORGOTTEN_S = 25.0
"""Time after which the graph has certainly dropped a killed process [s]."""

_ANSWERS = (GoalState.SUCCEEDED, GoalState.ABORTED, GoalState.REJECTED)


class GraphProblems:
    """Current problems of actions and topics, by name.

    Args:
        clock: Steady time [s].

    Attributes:
        messages: Name of the action or topic → description of the problem.
        on_change: Called when the problems have changed.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.messages: Mapping[str, str] = {}
        self.on_change: Callable[[], None] = lambda: None
        self._clock = clock
        self._since: dict[str, float] = {}

    def look(
        self, name: str, servers: Sequence[str], kind: BindingKind = BindingKind.ACTION
    ) -> str:
        """Check the nodes that serve an action or a service; return a remark for people.

        An unknown node has an empty name. Two servers with the same name may be a killed server
        and its next start.
        """
        if len(servers) < 2:
            self._since.pop(name, None)
            return self.report(name, "")
        since = self._since.setdefault(name, self._clock())
        names = sorted({*servers} - {""})
        if len(names) < 2 and self._clock() < since + FORGOTTEN_S:
            return self.report(name, "")
        nodes = f", of {', '.join(names)}" if names else ""
        return self.report(
            name,
            f"{len(servers)} servers offer the {kind.value} {name}{nodes}: each may act; stop all "
            "but one",
        )

    @property
    def watched(self) -> Set[str]:
        """The actions and services that had several servers at the last look."""
        return self._since.keys()

    def forget(self, name: str) -> None:
        """Forget an action, a service or a topic that trees no longer use."""
        self._since.pop(name, None)
        self.report(name, "")

    def of(self, name: str) -> str:
        """Return the problem of an action or a topic; empty for none."""
        return self.messages.get(name, "")

    def report(self, name: str, message: str) -> str:
        """Set the problem of an action or a topic, empty for none; return it."""
        others = {one: said for one, said in self.messages.items() if one != name}
        if message and len(others) < MOST_PROBLEMS:
            others[name] = message
        if others != self.messages:
            self.messages = others
            self.on_change()
        return message


def topic_problem(topic: str, expected: str, published: Collection[str], *, kept: bool) -> str:
    """Return why a leaf receives nothing new on a topic; empty for no known reason.

    Args:
        topic: Name of the topic.
        expected: Type that the leaf waits for.
        published: Types of its publishers on the graph.
        kept: Whether an earlier message counts.
    """
    if other := other_types(expected, published):
        return f"{topic} is published as {other}"
    if kept and not published:
        return f"the last message of {topic} counts, though nothing publishes it any more"
    return ""


class SilentServers:
    """Servers whose last goal was unreachable, until they answer one.

    Attributes:
        reasons: Name of the action or service → the reason that its leaf gives.
    """

    def __init__(self) -> None:
        self.reasons: Mapping[str, str] = {}

    def ended(self, server: str, state: GoalState, message: str) -> None:
        """Handle the end of a goal; a cancel or a timeout says nothing about its server."""
        others = {name: reason for name, reason in self.reasons.items() if name != server}
        if state is GoalState.UNREACHABLE and len(others) < MOST_SERVERS:
            self.reasons = {**others, server: message}
        elif state in _ANSWERS:
            self.reasons = others
