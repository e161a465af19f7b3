# SPDX-License-Identifier: Apache-2.0
"""Scenes of a rehearsal: the awarded one, and the live one, which scripted events change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.person_facts import Fact
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_language.files.testing.scenarios import RehearsedPerson, Scenario, ScriptedEvent


def awarded(space: SceneSpace, scenario: Scenario) -> Scene:
    """Return the scene at the start of a scenario."""
    scene = Scene(
        scene_id="rehearsed",
        label="",
        person=scenario.person,
        **_who(scenario.known),
        values=tuple(
            SceneValue(name=name, value=scenario.scene[name], origin=Origin.MEASURED)
            if name in scenario.scene
            else SceneValue.missing(name)
            for name in space.names
        ),
    )
    return space.completed(scene, met=scene.person)


def _who(known: RehearsedPerson | None) -> dict[str, Any]:
    if known is None:
        return {}
    return {"person_id": known.name, "visits": known.visits, "remembered": known.remembers}


class RehearsedLiveScene:
    """Live scene of a rehearsal; it becomes stale some time after the scene layer falls silent."""

    def __init__(self, space: SceneSpace, scene: Scene, clock: Callable[[], float]) -> None:
        self._space = space
        self._scene = self._seen = scene
        self._met = scene.person
        self._clock = clock
        self._silent_since: float | None = None

    @property
    def silent(self) -> bool:
        """True while the scene layer is silent."""
        return self._silent_since is not None

    def change(self, event: ScriptedEvent) -> None:
        """Apply a scripted event; changes during a silence become visible after it."""
        person = self._scene.person if event.person is None else event.person
        if event.silent is False:
            self._silent_since = None
        self._change(event.values, Origin.MEASURED, person)
        if not self.silent:
            self._silent_since = self._clock() if event.silent else None

    def _change(self, values: Mapping[str, float], origin: Origin, person: bool) -> None:
        changed = tuple(
            SceneValue(name=one.name, value=values[one.name], origin=origin)
            if one.name in values
            else one
            for one in self._scene.values
        )
        self._met = self._met or person
        scene = replace(self._scene, values=changed, person=person)
        self._scene = self._space.completed(scene, met=self._met)
        if not self.silent:
            self._seen = self._scene

    def tell(self, values: Mapping[str, float]) -> None:
        """Take values told by the person."""
        self._change(values, Origin.TOLD, self._scene.person)

    def remember(self, facts: Mapping[str, Fact]) -> None:
        """Remember facts about the person."""
        self._scene = replace(self._scene, remembered={**self._scene.remembered, **facts})
        self._seen = self._scene

    def now(self) -> Scene:
        """Return the current scene; during a silence the last one, marked as stale."""
        silent_s = 0.0 if self._silent_since is None else self._clock() - self._silent_since
        return self._seen if silent_s <= LIVE_LEASE_S else replace(self._seen, stale_s=silent_s)


def change_text(event: ScriptedEvent) -> str:
    """Return the changes of a scene as text."""
    parts = [f"{name} {value:g}" for name, value in event.values.items()]
    if event.person is not None:
        parts.append("a person comes" if event.person else "the person leaves")
    if event.silent is not None:
        parts.append(f"the scene layer is {'silent' if event.silent else 'back'}")
    return ", ".join(parts)
