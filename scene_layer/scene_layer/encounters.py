# SPDX-License-Identifier: Apache-2.0
"""Who is here now, and what of them is remembered when they go."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from bt_agents_core.errors import Refused
from bt_agents_language.model.scene_specs import MissingRule, SceneSpec
from scene_layer.memory import Memory
from scene_layer.persons import NOBODY, Persons
from scene_layer.sources import Sources

SAMPLE_S = 1.0
"""Time between two looks at somebody that count, however fast the sensors are [s]."""

AWAY_S = 300.0
"""Who is known by name and comes back sooner has never been away, only out of sight [s]."""

MOST_AWAY = 50
"""Persons who are out of sight, whose visit may go on; with more, the longest gone have left."""

THRESHOLD = 0.5
"""A person is there, or known by name, from this reading on: true, one face, a half."""


class Encounters:
    """Visits of persons, told apart by the ids of a tracker, or of one at a time without ids.

    What is measured of whoever is here goes into the memory: what sources say of that person, or
    what no source says of one. The person whom a run began with is kept until the run ends, though
    they have gone: what is known of them stays as they left it. So does, for :data:`AWAY_S`, that
    of somebody known by name: a tracker that loses them for a moment does not end their visit.

    Args:
        spec: The scene parameters, their sources and the persons.
        sources: The latest readings.
        memory: What is known from before.
    """

    def __init__(self, spec: SceneSpec, sources: Sources, memory: Memory) -> None:
        self._spec = spec
        self._sources = sources
        self._memory = memory
        self._persons = Persons(spec.persons) if spec.persons is not None else None
        self._here: tuple[str, ...] = ()
        self._kept: str | None = None
        self._away: dict[str, _Departure] = {}
        self._observed_at: dict[str, float] = {}
        self._names: set[str] = set()
        self._remembered = tuple(
            name
            for name in spec.space.names
            if spec.missing_rule(name) is not MissingRule.LEAVE_OUT
        )

    @property
    def told_apart(self) -> bool:
        """Whether persons have ids."""
        return self._persons is not None

    @property
    def wanted(self) -> bool:
        """Whether there is anything to look for: persons with ids, or values to remember."""
        return self.told_apart or bool(self._remembered)

    @property
    def tracked(self) -> tuple[str, ...]:
        """Ids of all who are here, in the order they came; empty where nobody tells them apart."""
        return self._persons.tracked if self._persons is not None else ()

    @property
    def addressee(self) -> str:
        """Whom a scene is about; :data:`NOBODY` without anybody or without ids."""
        return self._persons.addressee if self._persons is not None else NOBODY

    @property
    def reason(self) -> str:
        """Why this one is the addressee, in words."""
        return self._persons.reason if self._persons is not None else ""

    @property
    def candidates(self) -> tuple[str, ...]:
        """Ids of all who are here, or are from the next look on."""
        return self._persons.candidates if self._persons is not None else ()

    @property
    def heard_at(self) -> float:
        """When the tracker spoke last, in steady time; −∞ before the first time [s]."""
        return self._persons.heard_at if self._persons is not None else -math.inf

    def listed(self, ids: Iterable[object], now: float) -> tuple[Refused, int] | None:
        """Take a message of the tracker; see :meth:`Persons.listed`.

        Returns:
            The last id that was left out, and how often that has happened; None for none.
        """
        if self._persons is None:
            return None
        refused = self._persons.listed(ids, now)
        return (refused, self._persons.refusals[refused.code]) if refused is not None else None

    def look(self, now: float, wall: float) -> bool:
        """Find out who is here, and remember what was measured of them.

        Args:
            now: Steady time [s].
            wall: Unix time [s].

        Returns:
            True when somebody has come or gone, or somebody else is the addressee.
        """
        before = self._here, self.addressee
        came, gone = self._moved(now)
        self._end_visits(now)
        for person in came:
            if self._away.pop(person, None) is None:
                self._memory.came(person, wall)
        for person in self._here:
            if now - self._observed_at.get(person, -math.inf) >= SAMPLE_S:
                self._observe(person, now, wall)
        for person in gone:
            self._observe(person, now, wall)
            self._away[person] = _Departure(at=now, wall=wall, place=self._sources.place(now))
        self._end_visits(now)
        self._forget_others()
        return before != (self._here, self.addressee)

    def keep(self, person: str | None) -> None:
        """Keep what is known of the person of a run; None between runs."""
        self._kept = person

    @property
    def known(self) -> frozenset[str]:
        """Those who are here, or kept, and whose id is a name by which they come again."""
        return frozenset(self._names)

    def _moved(self, now: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
        if self._persons is not None:
            moved = self._persons.look(self._ranks(now), now)
            self._here = self._persons.tracked
            return moved.came, moved.gone
        here = (NOBODY,) if somebody_is_measured(self._spec, self._sources, now) else ()
        came = here if not self._here else ()
        gone = self._here if not here else ()
        self._here = here
        return came, gone

    def _ranks(self, now: float) -> dict[str, float]:
        """Return what the addressee is chosen by, of everybody of whom it is known."""
        assert self._persons is not None
        assert self._spec.persons is not None
        source = self._spec.persons.addressee.source
        if source is None:
            return {}
        found = {p: self._sources.reading(source, now, p) for p in self._persons.candidates}
        return {person: read.value for person, read in found.items() if read is not None}

    def _observe(self, person: str, now: float, wall: float) -> None:
        """Remember what has been measured of somebody since the last look."""
        looked_at = self._observed_at.get(person, -math.inf)
        for name in self._remembered:
            read = self._sources.latest(name, now, person, alone=True)
            if read is not None and looked_at < read.at and now <= read.stale_at:
                self._memory.measured(person, name, read.value, read.std, read.confidence, wall)
        self._observed_at[person] = now
        source = self._spec.persons.known if self._spec.persons is not None else None
        read = self._sources.reading(source, now, person) if source is not None else None
        if read is not None:
            (self._names.add if read.value >= THRESHOLD else self._names.discard)(person)

    def _end_visits(self, now: float) -> None:
        """End the visits of those who will hardly come back to them, oldest departure first."""
        spare = len(self._away) - MOST_AWAY
        for number, (person, left) in enumerate(list(self._away.items())):
            named = person in self._names and number >= spare
            if person == self._kept or (named and now < left.at + AWAY_S):
                continue
            del self._away[person]
            self._memory.left(person, left.place, known=person in self._names, now=left.wall)
            self._names.discard(person)
            self._observed_at.pop(person, None)

    def _forget_others(self) -> None:
        """Drop what was read of anybody who is neither here, nor listed, nor still awaited."""
        for person in self._sources.people - {*self.candidates, *self._away}:
            self._sources.forget(person)


@dataclass(frozen=True, kw_only=True)
class _Departure:
    """When somebody was lost, in steady and in unix time [s], and where."""

    at: float
    wall: float
    place: str


def somebody_is_measured(spec: SceneSpec, sources: Sources, now: float) -> bool:
    """Return whether the sources see somebody, where nobody is told apart.

    A person source that is silent or stale sees nobody. Without one somebody is there when
    anything at all is measured.
    """
    if spec.person is not None:
        read = sources.latest_person()
        return read is not None and now <= read.stale_at and read.value >= THRESHOLD
    found = (sources.latest(name, now) for name in spec.space.names)
    return any(read is not None and now <= read.stale_at for read in found)
