# SPDX-License-Identifier: Apache-2.0
"""What was measured of persons and at places before, for values that nobody measures now."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from bt_agents_core.scene import SceneParameter, SceneSpace

MOST_KNOWN = 1000
"""Persons, and as many places, that are remembered; the one not seen for longest goes first."""

FADES = 0.99
"""Weight of everything before, at each measurement: about the last hundred count."""

DRIFT_S = 3600.0
"""Time constant with which an estimate loses what it knows [s]."""


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """An estimate of a value that nobody measures now.

    Attributes:
        value: In the unit of the parameter.
        std: Standard deviation of the value now, in the unit of the parameter.
        age_s: Time since the last measurement that it is made of [s].
        source: What it is made of, in words.
    """

    value: float
    std: float
    age_s: float
    source: str


def ignorance(parameter: SceneParameter) -> float:
    """Return the standard deviation of a value of which only the range is known.

    That of the uniform distribution, (max − min) / √12.
    """
    return (parameter.maximum - parameter.minimum) / math.sqrt(12.0)


@dataclass(frozen=True, kw_only=True)
class Running:
    """An exponentially weighted mean and the scatter around it.

    The recursion of West (1979), "Updating mean and variance estimates", with all weights so far
    multiplied by :data:`FADES` at each value, as Finch (2009) does.

    Attributes:
        mean: Weighted mean.
        scatter: Weighted sum of the squared deviations, with the variances of the values.
        weight: Sum of the weights.
        at: When the last value was taken, in unix time [s].
    """

    mean: float = 0.0
    scatter: float = 0.0
    weight: float = 0.0
    at: float = -math.inf

    def after(self, value: float, std: float, weight: float, at: float) -> Running:
        """Return it with one more value, of a standard deviation and a weight above 0."""
        before = self.weight * FADES
        share = weight / (before + weight)
        step = value - self.mean
        return Running(
            mean=self.mean + share * step,
            # No term is negative, whatever is rounded.
            scatter=self.scatter * FADES + before * share * step * step + weight * std * std,
            weight=before + weight,
            at=at,
        )

    def std(self, ignorance: float, age_s: float) -> float:
        """Return the standard deviation of a value of now.

        What is known from the beginning counts as one measurement,
        s² = (scatter + ignorance²) / (weight + 1), and time takes it back to not knowing:
        std² = s² + (ignorance² − s²) (1 − exp(−2 age / :data:`DRIFT_S`)), the variance of the
        prediction of an Ornstein-Uhlenbeck process. It never falls with age.

        Args:
            ignorance: Standard deviation when nothing is known.
            age_s: Time since the last value, 0 or more [s].
        """
        limit = ignorance * ignorance
        known = (self.scatter + limit) / (self.weight + 1.0)
        grown = known + (limit - known) * -math.expm1(-2.0 * age_s / DRIFT_S)
        return math.sqrt(max(known, grown))


@dataclass
class KnownPerson:
    """What is remembered of a person or a place.

    Attributes:
        visits: How often the person came; of a place, how many came.
        values: By parameter.
        seen_at: Last time, in unix time [s].
        lent: Whether a copy has the same values, so that they must not be changed in place.
    """

    visits: int = 0
    values: dict[str, Running] = field(default_factory=dict)
    seen_at: float = 0.0
    lent: bool = field(default=False, repr=False, compare=False)

    def copy(self) -> KnownPerson:
        """Return one that later measurements do not change; until then they share the values."""
        self.lent = True
        return KnownPerson(visits=self.visits, values=self.values, seen_at=self.seen_at, lent=True)

    def add(self, name: str, value: float, std: float, weight: float, at: float) -> None:
        """Take a value of a parameter; see :meth:`Running.after`."""
        if self.lent:
            self.values = dict(self.values)
            self.lent = False
        self.values[name] = self.values.get(name, Running()).after(value, std, weight, at)

    def estimate(self, parameter: SceneParameter, now: float) -> tuple[float, float, float] | None:
        """Return value, standard deviation and age [s]; None of what was never measured."""
        running = self.values.get(parameter.name)
        if running is None or running.weight <= 0.0:
            return None
        age_s = max(0.0, now - running.at)
        return parameter.clamp(running.mean), running.std(ignorance(parameter), age_s), age_s


class Memory:
    """Running estimates of persons and averages of places, made of measured values only.

    A person is remembered over the end of tracking only when the id is the name of a known
    person. Each visit counts once in the average of its place, with what was measured of it.

    Args:
        space: The scene parameters.

    Attributes:
        changes: Counts what should be saved.
    """

    def __init__(self, space: SceneSpace) -> None:
        self.changes = 0
        self._space = space
        self._persons: dict[str, KnownPerson] = {}
        self._places: dict[str, KnownPerson] = {}
        self._visits: dict[str, set[str]] = {}
        self._shunned: set[str] = set()

    def came(self, person: str, now: float) -> None:
        """Begin the visit of somebody; ``now`` is in unix time [s], as everywhere here."""
        known = self._persons.pop(person, None) or KnownPerson()
        known.visits += 1
        known.seen_at = now
        self._persons[person] = known
        self._visits[person] = set()

    def measured(
        self, person: str, parameter: str, value: float, std: float, confidence: float, now: float
    ) -> None:
        """Take a value that was measured just now of somebody who is here.

        One without any confidence, or of somebody who is to be forgotten, is left out.
        """
        if person not in self._visits or person in self._shunned or confidence <= 0.0:
            return
        self._persons[person].add(parameter, value, std, confidence, now)
        self._visits[person].add(parameter)
        self.changes += 1

    def left(self, person: str, place: str, *, known: bool, now: float) -> None:
        """End a visit.

        Args:
            person: Who has gone; somebody who never came changes nothing.
            place: Where the visit was; may be empty.
            known: True when the id is a name by which this person comes again.
            now: Unix time [s].
        """
        measured = self._visits.pop(person, None)
        if measured is None:
            return
        remembered = self._persons.pop(person)
        remembered.seen_at = now
        if measured:
            self._count(self._place(place), remembered, measured, now)
        if known and person not in self._shunned and remembered.values:
            self._persons[person] = remembered
        self._shunned.discard(person)
        self._bound()
        self.changes += 1

    def estimate(self, person: str, place: str, name: str, now: float) -> Estimated | None:
        """Return what is to be expected of somebody, else of whoever comes to the place.

        Args:
            person: Who; may be empty.
            place: Where; may be empty.
            name: A parameter of the space.
            now: Unix time [s].
        """
        parameter = self._space.parameter(name)
        known = self._persons.get(person)
        found = known.estimate(parameter, now) if known is not None else None
        if known is not None and found is not None:
            return _estimated(found, f"{person or 'this person'}, {_seen(known.visits)}")
        here = self._places.get(place)
        found = here.estimate(parameter, now) if here is not None else None
        if here is not None and found is not None:
            where = f"in {place}" if place else "here"
            return _estimated(found, f"everybody {where}, {_visits(here.visits)}")
        return None

    def forget(self, *, person: str = "", place: str = "") -> bool:
        """Forget a person or a place; return whether anything was known.

        Somebody who is here is not remembered until the end of the visit.
        """
        if place:
            found = self._places.pop(place, None) is not None
        else:
            found = bool(self._persons.get(person, KnownPerson()).values)
            if person in self._visits:
                self._shunned.add(person)
                self._persons[person] = KnownPerson(visits=1)
                self._visits[person] = set()
            else:
                self._persons.pop(person, None)
        self.changes += 1
        return found

    def kept(
        self, known: Iterable[str] = ()
    ) -> tuple[dict[str, KnownPerson], dict[str, KnownPerson]]:
        """Return what outlives a restart, persons and places, as a copy that does not change.

        Args:
            known: Those of the present persons who are known by name; others who are here are
                left out.
        """
        names = set(known) - self._shunned
        persons = {
            person: one.copy()
            for person, one in self._persons.items()
            if one.values and (person not in self._visits or person in names)
        }
        return persons, {place: one.copy() for place, one in self._places.items()}

    def remember(
        self, persons: Mapping[str, KnownPerson], places: Mapping[str, KnownPerson]
    ) -> None:
        """Take what was kept before, at the start."""
        self._persons.update(persons)
        self._places.update(places)
        self._bound()

    def _place(self, place: str) -> KnownPerson:
        known = self._places.pop(place, None) or KnownPerson()
        self._places[place] = known
        return known

    def _count(
        self, place: KnownPerson, person: KnownPerson, measured: set[str], now: float
    ) -> None:
        place.visits += 1
        place.seen_at = now
        for name in sorted(measured):
            mean, std, _ = person.estimate(self._space.parameter(name), now) or (0.0, 0.0, 0.0)
            place.add(name, mean, std, 1.0, now)

    def _bound(self) -> None:
        for known in (self._persons, self._places):
            away = [name for name in known if known is self._places or name not in self._visits]
            oldest = sorted(away, key=lambda name: known[name].seen_at)
            for name in oldest[: max(0, len(away) - MOST_KNOWN)]:
                del known[name]


def _estimated(found: tuple[float, float, float], source: str) -> Estimated:
    value, std, age_s = found
    return Estimated(value=value, std=std, age_s=age_s, source=source)


def _seen(count: int) -> str:
    return "seen once" if count == 1 else f"seen {count} times"


def _visits(count: int) -> str:
    return "1 visit" if count == 1 else f"{count} visits"
