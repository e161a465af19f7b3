# SPDX-License-Identifier: Apache-2.0
"""What the ROS graph shows that can keep a skill from being done as it is meant."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

MOST_PROBLEMS = 200

FORGOTTEN_S = 25.0
"""Time after which the graph has surely forgotten a process that was killed [s]."""


class GraphProblems:
    """Problems of actions and topics by name, until they are over.

    Args:
        clock: Steady time [s].

    Attributes:
        messages: Name of the action or topic → what is wrong, for people.
        on_change: Called when there are others.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.messages: Mapping[str, str] = {}
        self.on_change: Callable[[], None] = lambda: None
        self._clock = clock
        self._since: dict[str, float] = {}

    def look(self, action: str, servers: Sequence[str]) -> str:
        """Take the nodes that serve an action; return what people should know about them.

        Two servers of one name may be a server that was killed and its next start.
        """
        if len(servers) < 2:
            self._since.pop(action, None)
            return self._set(action, "")
        since = self._since.setdefault(action, self._clock())
        names = sorted({*servers})
        if len(names) < 2 and self._clock() < since + FORGOTTEN_S:
            return self._set(action, "")
        return self._set(
            action,
            f"{len(servers)} servers offer the action {action}, of {', '.join(names)}: each may "
            "act; stop all but one",
        )

    @property
    def watched(self) -> tuple[str, ...]:
        """The actions that have had several servers at the last look."""
        return tuple(self._since)

    def _set(self, name: str, message: str) -> str:
        others = {one: said for one, said in self.messages.items() if one != name}
        if message and len(others) < MOST_PROBLEMS:
            others[name] = message
        if others != self.messages:
            self.messages = others
            self.on_change()
        return message
