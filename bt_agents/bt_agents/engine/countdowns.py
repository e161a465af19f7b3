# SPDX-License-Identifier: Apache-2.0
"""Countdowns of a tree: the remaining times, attempts and rounds of its nodes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from py_trees.behaviour import Behaviour

from bt_agents.engine.light_behaviour import RUNNING
from bt_agents.engine.loops import Loop
from bt_agents.engine.nodes.cooldown import Cooldown


@dataclass(frozen=True, kw_only=True)
class Countdown:
    """Remainder of a limit of a node.

    Attributes:
        path: Path of the node.
        kind: Its key: ``timeout``, ``wait``, ``retry``.
        ends_at: When its time is over, on the trees' clock [s]; None for attempts and rounds.
        remaining: Attempts or rounds after the current one; None for a time.
    """

    path: str
    kind: str
    ends_at: float | None = None
    remaining: int | None = None


class Countdowns:
    """The countdowns of one tree, without its clean-up."""

    def __init__(self, root: Behaviour) -> None:
        nodes: list[Any] = list(root.iterate())
        self._kinds: Mapping[str, str] = {node.spec.path: node.spec.kind for node in nodes}
        self._loops = [node for node in nodes if isinstance(node, Loop)]
        self._cooldowns = [node for node in nodes if isinstance(node, Cooldown)]

    def running(self, deadlines: Mapping[str, float], now: float) -> list[Countdown]:
        """Return the active ones; ``deadlines`` are from the last tick, see :class:`Run`."""
        ends = {one.spec.path: one.over_at for one in self._cooldowns if one.over_at}
        ends.update(deadlines)
        times = [
            Countdown(path=path, kind=self._kinds[path], ends_at=at)
            for path, at in ends.items()
            if path in self._kinds and now < at < math.inf
        ]
        rounds = [
            Countdown(path=one.spec.path, kind=one.spec.kind, remaining=one.rounds_left)
            for one in self._loops
            if one.status is RUNNING and one.rounds_left is not None
        ]
        return times + rounds
