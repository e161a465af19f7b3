# SPDX-License-Identifier: Apache-2.0
"""Button presses of a simulated visitor, each sent once a tree listens; without ROS."""

from __future__ import annotations

from collections.abc import Callable


class ButtonPresses:
    """Buttons that a visitor will press.

    A ``wait_for`` listens only while it runs, and may start after the words that name a button.
    """

    def __init__(self) -> None:
        self._planned: dict[str, float] = {}

    def plan(self, topic: str, at: float) -> None:
        """Plan to press a button at a time [s]; an already planned one keeps its time."""
        self._planned.setdefault(topic, at)

    def due(self, now: float, listens: Callable[[str], bool]) -> list[str]:
        """Return the topics of the buttons to press now, once each; others wait for a listener."""
        topics = [topic for topic, at in self._planned.items() if now >= at and listens(topic)]
        for topic in topics:
            del self._planned[topic]
        return topics

    def give_up(self, now: float) -> list[str]:
        """Forget all buttons; return the topics of those without a listener in time."""
        missed = [topic for topic, at in self._planned.items() if now >= at]
        self._planned.clear()
        return missed
