# SPDX-License-Identifier: Apache-2.0
"""Scene estimator: combines readings, given values and memory; unknown is never zero."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue, check_value, first_id
from bt_agents_language.model.scene_specs import MissingRule, SceneSpec
from scene_layer.memory import Memory
from scene_layer.persons import NOBODY, THRESHOLD, Encounters, somebody_is_measured
from scene_layer.sources import Reading, Sources

MAX_INTERACTIONS = 1000
"""Most interactions whose given values are remembered; more than a market's queue can hold."""


def check_given(
    space: SceneSpace, names: Sequence[str], values: Sequence[float]
) -> dict[str, float]:
    """Check the values that a caller gives for some parameters.

    Raises:
        Refused: ``WRONG_LENGTH``, ``UNKNOWN_PARAMETER``, ``DUPLICATE_PARAMETER``, ``NOT_FINITE``
            or ``OUT_OF_RANGE``.
    """
    if len(names) != len(values):
        raise Refused(
            RefusalCode.WRONG_LENGTH,
            f"given values: {len(names)} names and {len(values)} values; expected as many",
        )
    given: dict[str, float] = {}
    for name, value in zip(names, values, strict=True):
        parameter = space.parameter(name, what="given values")
        if name in given:
            raise Refused(RefusalCode.DUPLICATE_PARAMETER, f"given values: '{name}' stands twice")
        given[name] = check_value(parameter, value, what="given values")
    return given


@dataclass(frozen=True, kw_only=True)
class GivenValue:
    """A value that a person or program has given.

    Attributes:
        at: Steady time [s].
        origin: ``GIVEN``, or ``TOLD`` if the person told it to an agent.
    """

    value: float
    at: float
    origin: Origin = Origin.GIVEN


_SOURCES = {Origin.GIVEN: "given", Origin.TOLD: "the person"}


@dataclass(frozen=True, kw_only=True)
class SceneInteraction:
    """Values given for one interaction, from its scene to the end of its runs.

    Attributes:
        scene_id: Id of its first scene; follow-up rounds belong to the same interaction.
        person: 1 or 0 if a person was said to be present or absent; None for as measured.
        urgent: Whether it may stop a running tree.
        person_id: The person it is about; empty while there is none.
        met: True once a person was present.
    """

    scene_id: str
    label: str = ""
    values: Mapping[str, GivenValue] = field(default_factory=dict)
    person: Reading | None = None
    urgent: bool = False
    person_id: str = NOBODY
    met: bool = False

    def with_given(
        self, values: Mapping[str, GivenValue], person: bool | None, now: float
    ) -> SceneInteraction:
        """Return the interaction with more given values; ``person`` None leaves it unchanged."""
        present = self.person if person is None else Reading(value=float(person), at=now)
        return replace(self, values={**self.values, **values}, person=present)


class SceneEstimator:
    """State of the current interaction and of those that wait in the market.

    A given value holds for its interaction until a source has a newer reading. It never affects
    another interaction: a waiting scene does not change the running one. An interaction stays with
    the person it began with; one that began without a person takes the first addressee.

    A value of a parameter with ``of: person`` belongs to the person who is present when it is
    given: it holds in each of their interactions until they leave.

    Here ``now`` is steady time [s] and ``wall`` unix time [s].
    """

    def __init__(self, spec: SceneSpec, sources: Sources, memory: Memory) -> None:
        self._spec = spec
        self._sources = sources
        self._memory = memory
        self._interactions: dict[str, SceneInteraction] = {}
        self._personal: dict[str, dict[str, GivenValue]] = {}
        self.encounters = Encounters(spec, sources, memory)
        self._persons = self.encounters.persons

    def begin(
        self,
        scene_id: str,
        label: str,
        values: Mapping[str, float],
        person: bool | None,
        now: float,
        *,
        urgent: bool = False,
        told: bool = False,
        person_id: str | None = None,
    ) -> SceneInteraction:
        """Open an interaction with checked values; it may stop a running tree if ``urgent``.

        ``person`` None means a person is present as measured. The interaction is about
        ``person_id``, else about the addressee. The values are ``told`` by the person, or given.
        """
        begun = SceneInteraction(scene_id=scene_id, label=label, urgent=urgent)
        if person_id is not None:
            begun = replace(begun, person_id=person_id, met=bool(person_id))
        self._store(begun)
        return self.give(scene_id, values, person, now, told=told)

    def give(
        self,
        scene_id: str,
        values: Mapping[str, float],
        person: bool | None,
        now: float,
        *,
        told: bool = False,
    ) -> SceneInteraction:
        """Add checked values to an interaction, known or not; given, or ``told`` by the person."""
        origin = Origin.TOLD if told else Origin.GIVEN
        given = {
            name: GivenValue(value=value, at=now, origin=origin) for name, value in values.items()
        }
        known = self._store(self._known(scene_id).with_given({}, person, now))
        if given.keys() & self._spec.personal:
            known = self._bound(known.scene_id)
            if self._is_here(known, now):
                own = self._personal.setdefault(known.person_id, {})
                own.update({name: given.pop(name) for name in self._spec.personal & given.keys()})
        return self._store(known.with_given(given, None, now))

    def _is_here(self, interaction: SceneInteraction, now: float) -> bool:
        """Whether the person of an interaction is measured, and not said to be absent."""
        if interaction.person is not None and not interaction.person.value:
            return False
        if self.encounters.identified:
            return interaction.person_id in self._persons.tracked
        return somebody_is_measured(self._spec, self._sources, now)

    def adopt(self, scene: Scene, now: float) -> SceneInteraction:
        """Return the interaction of an awarded scene; for a foreign scene, its given values.

        A person in a foreign scene is present until this scene layer measures anything itself.
        """
        known = self._known(scene.scene_id)
        if known.scene_id in self._interactions:
            return known
        given, told = (
            {v.name: v.value for v in scene.values if v.origin is origin}
            for origin in (Origin.GIVEN, Origin.TOLD)
        )
        measured = self._spec.person is not None or self.encounters.identified
        begun = self.begin(
            scene.scene_id,
            scene.label,
            given,
            None if measured else scene.person,
            now,
            urgent=scene.urgent,
            person_id=scene.person_id if self.encounters.identified else None,
        )
        if measured and scene.person:
            begun = self._store(replace(begun, person=Reading(value=1.0, at=-math.inf)))
        return self.give(scene.scene_id, told, None, now, told=True) if told else begun

    def update(self, now: float, wall: float, running: str | None) -> bool:
        """Update the present persons while scene ``running`` has a run; True for a change."""
        held = None if running is None else self._bound(running).person_id
        moved = self.encounters.update(now, wall, held)
        for person in self._personal.keys() - set(self.encounters.here):
            del self._personal[person]
        return moved

    def scene(self, scene_id: str, *, now: float, wall: float, stamp: float) -> Scene:
        """Assemble the scene of an interaction; an unknown one has no given values."""
        return self._put_together(self._bound(scene_id), now, wall, stamp).with_id(scene_id)

    def scene_of(self, person_id: str, *, now: float, wall: float, stamp: float) -> Scene:
        """Return the scene of a person without given values."""
        one = SceneInteraction(scene_id=f"person/{person_id}", person_id=person_id, met=True)
        return self._put_together(one, now, wall, stamp)

    def _put_together(
        self, interaction: SceneInteraction, now: float, wall: float, stamp: float
    ) -> Scene:
        values = [self._value(name, interaction, now) for name in self._spec.space.names]
        present = self._present(interaction, values, now)
        if present and not interaction.met:
            interaction = self._update(replace(interaction, met=True))
        elif not present and interaction.met and self._spec.personal:
            interaction = self._without_personal(interaction)
            values = [self._value(name, interaction, now) for name in self._spec.space.names]
        place = self._sources.place(now)
        known = interaction.person_id in self.encounters.known
        return Scene(
            scene_id=interaction.scene_id,
            label=interaction.label,
            person=present,
            urgent=interaction.urgent,
            person_id=interaction.person_id,
            place=place,
            persons=len(self._persons.tracked),
            visits=self._memory.visits(interaction.person_id) if known else 0,
            remembered=self._memory.facts(interaction.person_id) if known else {},
            values=tuple(
                self._expected(value.name, interaction, place, wall)
                if value.origin is Origin.MISSING
                else value
                for value in values
            ),
            stamp=stamp,
        )

    def _without_personal(self, interaction: SceneInteraction) -> SceneInteraction:
        """Forget the values given for the person of an interaction, who has left."""
        self._personal.pop(interaction.person_id, None)
        remaining = {
            name: given
            for name, given in interaction.values.items()
            if name not in self._spec.personal
        }
        return self._update(replace(interaction, values=remaining))

    def _known(self, scene_id: str) -> SceneInteraction:
        """Return an interaction by the id of its scene or of a follow-up round."""
        for known_id in (scene_id, first_id(scene_id)):
            if known_id in self._interactions:
                return self._interactions[known_id]
        return SceneInteraction(scene_id=scene_id)

    def _store(self, interaction: SceneInteraction) -> SceneInteraction:
        self._interactions.pop(interaction.scene_id, None)
        self._interactions[interaction.scene_id] = interaction
        while len(self._interactions) > MAX_INTERACTIONS:
            del self._interactions[next(iter(self._interactions))]
        return interaction

    def _bound(self, scene_id: str) -> SceneInteraction:
        """Return an interaction with its person: the addressee, unless it already has one.

        One without a person stays so. The unannounced one follows the addressee.
        """
        known = self._known(scene_id)
        absent = known.person is not None and not known.person.value
        if absent or (known.person_id and scene_id):
            return known
        met = known.met and bool(scene_id)
        return self._update(replace(known, person_id=self._persons.addressee, met=met))

    def _update(self, interaction: SceneInteraction) -> SceneInteraction:
        """Replace an interaction in its place, if it is known."""
        if interaction.scene_id in self._interactions:
            self._interactions[interaction.scene_id] = interaction
        return interaction

    def _value(self, name: str, interaction: SceneInteraction, now: float) -> SceneValue:
        """Return a value as given or measured, else as missing."""
        person = interaction.person_id
        given = self._personal.get(person, {}).get(name) or interaction.values.get(name)
        lost = bool(person) and person not in self._persons.tracked
        read = self._sources.latest(name, now, person, alone=lost)
        if given is not None and (read is None or read.at <= given.at):
            return SceneValue(
                name=name, value=given.value, origin=given.origin, source=_SOURCES[given.origin]
            )
        if read is None or now > read.stale_at:
            return SceneValue.missing(name)
        return SceneValue(
            name=name,
            value=read.value,
            origin=Origin.MEASURED,
            age_s=max(0.0, now - read.at),
            std=read.std,
            confidence=read.confidence,
            source=read.source,
        )

    def _expected(
        self, name: str, interaction: SceneInteraction, place: str, wall: float
    ) -> SceneValue:
        """Return the estimate or default of a value that is not measured."""
        estimate = None
        if interaction.met and self._spec.missing_rule(name) is not MissingRule.LEAVE_OUT:
            estimate = self._memory.estimate(interaction.person_id, place, name, wall)
        return estimate or self._spec.space.parameter(name).unknown(met=interaction.met)

    def _present(
        self, interaction: SceneInteraction, values: Sequence[SceneValue], now: float
    ) -> bool:
        """Whether the person of an interaction is present: as given or read, whichever is newer.

        If persons are distinguished, an interaction without a person stays so, and a person who is
        no longer tracked is gone.
        """
        given = interaction.person
        if self.encounters.identified:
            if given is not None and (not given.value or self._persons.received_at <= given.at):
                return given.value >= THRESHOLD
            return interaction.person_id in self._persons.tracked
        if self._spec.person is None and given is None:
            return any(value.origin is not Origin.MISSING for value in values)
        read = self._sources.latest_person()
        if given is not None and (read is None or read.at <= given.at):
            return given.value >= THRESHOLD
        return somebody_is_measured(self._spec, self._sources, now)
