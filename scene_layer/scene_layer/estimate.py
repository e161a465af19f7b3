# SPDX-License-Identifier: Apache-2.0
"""A scene put together from readings and given values; the unknown is missing, never zero."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bt_agents.errors import Refused
from bt_agents.language.specs import SceneSpec
from bt_agents.scene import Origin, Scene, SceneSpace, SceneValue, check_value
from scene_layer.sources import Reading, Sources

PERSON_THRESHOLD = 0.5
"""A person is there from this reading on: true, one face, or a confidence of a half."""

KEPT = 1000
"""Interactions whose given values are remembered: as many as scenes may wait in a market."""


def check_given(
    space: SceneSpace, names: Sequence[str], values: Sequence[float]
) -> dict[str, float]:
    """Check values that a caller gives for some parameters.

    Raises:
        Refused: ``WRONG_LENGTH``, ``UNKNOWN_PARAMETER``, ``DUPLICATE_PARAMETER``, ``NOT_FINITE``
            or ``OUT_OF_RANGE``.
    """
    if len(names) != len(values):
        raise Refused(
            "WRONG_LENGTH",
            f"given values: {len(names)} names and {len(values)} values; expected as many",
        )
    given: dict[str, float] = {}
    for name, value in zip(names, values, strict=True):
        parameter = space.parameter(name, what="given values")
        if name in given:
            raise Refused("DUPLICATE_PARAMETER", f"given values: '{name}' stands twice")
        given[name] = check_value(parameter, value, what="given values")
    return given


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """What was given for one interaction, from its scene to the end of its runs."""

    scene_id: str
    label: str = ""
    values: Mapping[str, Reading]
    person: Reading | None = None
    urgent: bool = False

    def with_given(
        self, values: Mapping[str, float], person: bool | None, now: float
    ) -> Interaction:
        """Return the interaction with more values given; a person of None stays as it was."""
        given = {name: Reading(value=value, at=now) for name, value in values.items()}
        present = self.person if person is None else Reading(value=float(person), at=now)
        return replace(self, values={**self.values, **given}, person=present)


class Estimate:
    """What is known of the present interaction and of those that wait in the market.

    A given value holds for its interaction until a source brings a newer reading. It never
    reaches another interaction: a scene that waits does not change the one that runs.
    """

    def __init__(self, spec: SceneSpec, sources: Sources) -> None:
        self._spec = spec
        self._sources = sources
        self._interactions: dict[str, Interaction] = {}

    def begin(
        self,
        scene_id: str,
        label: str,
        values: Mapping[str, float],
        person: bool | None,
        now: float,
        *,
        urgent: bool = False,
    ) -> Interaction:
        """Open an interaction with the checked values given for it; a None person is measured."""
        empty = Interaction(scene_id=scene_id, label=label, values={}, urgent=urgent)
        return self._keep(empty.with_given(values, person, now))

    def give(
        self, scene_id: str, values: Mapping[str, float], person: bool | None, now: float
    ) -> Interaction:
        """Add checked given values to an interaction, known or not."""
        known = self._interactions.get(scene_id, Interaction(scene_id=scene_id, values={}))
        return self._keep(known.with_given(values, person, now))

    def adopt(self, scene: Scene, now: float) -> Interaction:
        """Return the interaction of an awarded scene; for a foreign scene, its given values."""
        known = self._interactions.get(scene.scene_id)
        if known is not None:
            return known
        given = {v.name: v.value for v in scene.values if v.origin is Origin.GIVEN}
        person = None if self._spec.person else scene.person
        return self.begin(scene.scene_id, scene.label, given, person, now, urgent=scene.urgent)

    def scene(self, scene_id: str, *, now: float, stamp: float) -> Scene:
        """Put the scene of an interaction together.

        Args:
            scene_id: Id of the interaction; an unknown one has no given values.
            now: Steady time [s].
            stamp: Time for the message [s].
        """
        known = self._interactions.get(scene_id, Interaction(scene_id=scene_id, values={}))
        values = tuple(self._value(name, known, now) for name in self._spec.space.names)
        return Scene(
            scene_id=scene_id,
            label=known.label,
            person=self._person(known, values, now),
            urgent=known.urgent,
            values=values,
            stamp=stamp,
        )

    def _keep(self, interaction: Interaction) -> Interaction:
        self._interactions.pop(interaction.scene_id, None)
        self._interactions[interaction.scene_id] = interaction
        while len(self._interactions) > KEPT:
            del self._interactions[next(iter(self._interactions))]
        return interaction

    def _value(self, name: str, interaction: Interaction, now: float) -> SceneValue:
        given = interaction.values.get(name)
        read = self._sources.latest(name)
        if given is not None and (read is None or read.at <= given.at):
            return SceneValue(name=name, value=given.value, origin=Origin.GIVEN)
        if read is None or now > read.stale_at:
            return SceneValue.missing(name)
        age_s = max(0.0, now - read.at)
        return SceneValue(name=name, value=read.value, origin=Origin.MEASURED, age_s=age_s)

    def _person(self, interaction: Interaction, values: Sequence[SceneValue], now: float) -> bool:
        """Whether somebody is there: as given or read, whichever is newer.

        A person source that is silent or stale sees nobody. Without any person source somebody is
        there when anything at all is known.
        """
        given, read = interaction.person, self._sources.latest_person()
        if given is not None and (read is None or read.at <= given.at):
            return given.value >= PERSON_THRESHOLD
        if self._spec.person is None:
            return any(not math.isnan(value.value) for value in values)
        return read is not None and now <= read.stale_at and read.value >= PERSON_THRESHOLD
