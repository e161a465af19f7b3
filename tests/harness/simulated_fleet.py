# SPDX-License-Identifier: Apache-2.0
"""Robots of a fleet, each with a ledger, one clock for all, and the steps that they exchange."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import SceneSpace
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning.cards import LearningEntry
from feedback_node.learning.fleet_steps import FleetStep, own_steps
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger
from feedback_node.management.fleet_documents import MOST_STEPS, to_fleet_document
from feedback_node.management.management import (
    Management,
    ManagementAction,
    ManagementCommand,
    ManagementResult,
)
from learning_cards import card, entry
from ledger_fixture import SPACE
from scene_spaces import scene_of

NAN = math.nan


class Clock:
    """Wall time of all robots [s]."""

    def __init__(self) -> None:
        self.now = 1_700_000_000.0

    def __call__(self) -> float:
        return self.now


def learning(**fields: object) -> LearningEntry:
    return LearningEntry(
        **{
            "update": "plain",
            "rates": (NAN, NAN),
            "width": (1.0, 1.0),
            "window": 5,
            "drift": (NAN, NAN),
            "layers": ("place",),
            "general": 0.5,
            **fields,
        }
    )


class Robot:
    """A robot that learns; without a path, its ledger is in memory."""

    def __init__(
        self,
        name: str,
        clock: Clock,
        *,
        rule: LearningEntry | None = None,
        path: str = ":memory:",
        space: SceneSpace = SPACE,
    ) -> None:
        self.name = name
        self.clock = clock
        self.space = space
        self.rule = rule or learning()
        self.ledger = Ledger(path, wall=clock)
        self.profiles = Profiles(space, self.ledger)
        self.introduce()
        self._management = Management(
            self.profiles, self.ledger, wall=clock, new_id=lambda: f"{name}-{clock.now}"
        )
        self._feedback = self.ledger.entries()[-1][0]

    def introduce(self, authored: float = 3.0, agents: Iterable[str] = ("guide",)) -> None:
        """Let the host introduce its agents."""
        profile = (authored,) * len(self.space)
        entries = [entry(name, profile, learning_rate=0.3, learning=self.rule) for name in agents]
        introduced = card(*entries, parameters=self.space.names)
        assert self.profiles.register_card(introduced)[1] == ()

    def teach(
        self,
        kind: FeedbackKind = FeedbackKind.DIRECT,
        values: tuple[float, ...] = (5.0, NAN),
        *,
        place: str = "",
        person: str = "",
        reason: str = "",
        source: str = "t",
    ) -> None:
        self._feedback += 1
        scene = scene_of(self.space, (3.0,) * len(self.space), person_id=person, place=place)
        self.profiles.apply(
            "guide",
            kind,
            values,
            feedback_id=f"{self.name}-feedback-{self._feedback}",
            source=source,
            reason=reason,
            run=AnnouncedRun(epoch="e", round=1, agent="guide", scene=scene),
        )

    def manage(self, action: ManagementAction, **fields: Any) -> ManagementResult:
        return self._management.execute(ManagementCommand(action=action, **fields))

    def steps(self) -> list[FleetStep]:
        """Return its own steps that it may share."""
        found = own_steps(self.ledger.entries(), self.name, {})
        return [one for one in found if not _is_of_person(one.layer)]

    def forget(self, layer: str) -> None:
        """Forget a layer of the agent."""
        self.manage(ManagementAction.FORGET, agent="guide", layer=layer)

    def take(self, steps: Iterable[FleetStep]) -> list[dict[str, Any]]:
        """Apply steps of other robots in the given order; return the refusals."""
        given = list(steps)
        refused: list[dict[str, Any]] = []
        for start in range(0, max(1, len(given)), MOST_STEPS):
            part = given[start : start + MOST_STEPS]
            document = to_fleet_document(self.name, ["guide"], part)
            answer = self.manage(ManagementAction.IMPORT, document=document)
            refused += json.loads(answer.document)["refused"]
        return refused

    def current(self) -> dict[str, tuple[float, ...]]:
        """Return the current profiles by layer, except profiles of persons."""
        return {
            layer: vector
            for _, layer, _, vector in self.profiles.table()
            if not _is_of_person(layer)
        }


def _is_of_person(layer: str) -> bool:
    return layer.startswith("person/")


def largest_difference(robots: Iterable[Robot]) -> float:
    """Return the largest difference between robots' profiles; infinite if their layers differ."""
    first, *others = [robot.current() for robot in robots]
    if any(other.keys() != first.keys() for other in others):
        return math.inf
    return max(
        abs(a - b)
        for other in others
        for layer, vector in other.items()
        for a, b in zip(vector, first[layer], strict=True)
    )
