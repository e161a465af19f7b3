# SPDX-License-Identifier: Apache-2.0
"""Scene of a rehearsal: as awarded, live, and as scripted events change it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bt_agents_core.live_scene_view import LEASE_S
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_language.files.testing.scenarios import Scenario, ScriptedEvent

_AWARDED = "rehearsed"


def awarded(space: SceneSpace, scenario: Scenario) -> Scene:
    """Return the scene that a scenario starts from."""
    return Scene(
        scene_id=_AWARDED,
        label="",
        person=scenario.person,
        values=tuple(
            SceneValue(name=name, value=scenario.scene[name], origin=Origin.GIVEN)
            if name in scenario.scene
            else SceneValue.missing(name)
            for name in space.names
        ),
    )


class RehearsedLive:
    """The live scene of a rehearsal; it is stale some time after the scene layer fell silent.

    Args:
        scene: The scene as awarded.
        clock: Virtual time [s].
    """

    def __init__(self, scene: Scene, clock: Callable[[], float]) -> None:
        self._scene = self._seen = scene
        self._clock = clock
        self._silent_since: float | None = None

    @property
    def silent(self) -> bool:
        """True when nothing new is known."""
        return self._silent_since is not None

    def change(self, happening: ScriptedEvent) -> None:
        """Let something happen; what happens in silence is known once it is over."""
        self._scene = changed(self._scene, happening)
        if happening.silent is False:
            self._silent_since = None
        if not self.silent:
            self._seen = self._scene
            self._silent_since = self._clock() if happening.silent else None

    def now(self) -> Scene:
        """Return the scene as it is now, or as it was last, marked as stale."""
        silent_s = 0.0 if self._silent_since is None else self._clock() - self._silent_since
        return self._seen if silent_s <= LEASE_S else replace(self._seen, stale_s=silent_s)


def changed(scene: Scene, happening: ScriptedEvent) -> Scene:
    """Return a scene after something has happened."""
    values = tuple(
        SceneValue(name=one.name, value=happening.values[one.name], origin=Origin.MEASURED)
        if one.name in happening.values
        else one
        for one in scene.values
    )
    person = scene.person if happening.person is None else happening.person
    return replace(scene, values=values, person=person)


def change_text(happening: ScriptedEvent) -> str:
    """Return in words how a scene changes."""
    words = [f"{name} {value:g}" for name, value in happening.values.items()]
    if happening.person is not None:
        words.append("a person comes" if happening.person else "the person leaves")
    if happening.silent is not None:
        words.append(f"the scene layer is {'silent' if happening.silent else 'back'}")
    return ", ".join(words)
