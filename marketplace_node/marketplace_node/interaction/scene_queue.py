# SPDX-License-Identifier: Apache-2.0
"""Queue of scenes: first come first served, urgent and preempting ones first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from bt_agents_core.scene import Scene


@dataclass(eq=False, kw_only=True)
class QueuedScene:
    """Queued scene.

    Attributes:
        scene: The scene.
        asked: True once a challenge for it has been opened.
        round: Number of that challenge, 0 before.
        drawn: Number of the round whose chance it draws, as that round has decided for it; 0 for
            the chance of its own.
        excluded: Agents that may not bid when its turn comes, with the reason.
    """

    scene: Scene
    asked: bool = False
    round: int = 0
    drawn: int = 0
    excluded: Mapping[str, str] = field(default_factory=dict)


class SceneQueue:
    """Queue of scenes, in which some are put ahead."""

    def __init__(self) -> None:
        self._waiting: list[QueuedScene] = []

    def __len__(self) -> int:
        return len(self._waiting)

    def __iter__(self) -> Iterator[QueuedScene]:
        return iter(self._waiting)

    def push(self, scene: Scene, *, urgent_first: bool) -> None:
        """Let a scene wait behind all others, or an urgent one before those that are not."""
        place = len(self._waiting)
        if urgent_first and scene.urgent:
            urgent = [index for index, other in enumerate(self._waiting) if other.scene.urgent]
            place = urgent[-1] + 1 if urgent else 0
        self._waiting.insert(place, QueuedScene(scene=scene))

    def unasked(self) -> QueuedScene | None:
        """Return the first scene for which no challenge has been opened."""
        return next((waiting for waiting in self._waiting if not waiting.asked), None)

    def put_first(self, waiting: QueuedScene) -> None:
        """Put a scene of the line before all others."""
        self._waiting.remove(waiting)
        self._waiting.insert(0, waiting)

    def remove(self, waiting: QueuedScene) -> None:
        """Take a scene out of the line."""
        self._waiting.remove(waiting)

    def pop(self) -> QueuedScene:
        """Take the first scene out of the line."""
        return self._waiting.pop(0)
