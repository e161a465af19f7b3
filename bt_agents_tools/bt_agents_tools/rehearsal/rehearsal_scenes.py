# SPDX-License-Identifier: Apache-2.0
"""Scenes of a rehearsal: the awarded one, and the live one that scripted events change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bt_agents_core.live_scene_view import LEASE_S
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_language.files.testing.scenarios import Scenario, ScriptedEvent


def awarded(space: SceneSpace, scenario: Scenario) -> Scene:
    """Return the scene that a scenario starts from."""
    scene = Scene(
        scene_id="rehearsed",
        label="",
        person=scenario.person,
        values=tuple(
            SceneValue(name=name, value=scenario.scene[name], origin=Origin.GIVEN)
            if name in scenario.scene
            else SceneValue.missing(name)
            for name in space.names
        ),
    )
    return space.completed(scene, met=scene.person)


class RehearsedLiveScene:
    """Live scene of a rehearsal; it is stale some time after the scene layer fell silent."""

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
        """Apply a scripted event; changes during a silence are visible once it is over."""
        values = tuple(
            SceneValue(name=one.name, value=event.values[one.name], origin=Origin.MEASURED)
            if one.name in event.values
            else one
            for one in self._scene.values
        )
        person = self._scene.person if event.person is None else event.person
        self._met = self._met or person
        changed = replace(self._scene, values=values, person=person)
        self._scene = self._space.completed(changed, met=self._met)
        if event.silent is False:
            self._silent_since = None
        if not self.silent:
            self._seen = self._scene
            self._silent_since = self._clock() if event.silent else None

    def now(self) -> Scene:
        """Return the scene as it is now, or the last one of a silence, marked as stale."""
        silent_s = 0.0 if self._silent_since is None else self._clock() - self._silent_since
        return self._seen if silent_s <= LEASE_S else replace(self._seen, stale_s=silent_s)


def change_text(event: ScriptedEvent) -> str:
    """Return the changes of a scene as text."""
    parts = [f"{name} {value:g}" for name, value in event.values.items()]
    if event.person is not None:
        parts.append("a person comes" if event.person else "the person leaves")
    if event.silent is not None:
        parts.append(f"the scene layer is {'silent' if event.silent else 'back'}")
    return ", ".join(parts)
