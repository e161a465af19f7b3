# SPDX-License-Identifier: Apache-2.0
"""Memory of persons and places, and the file that keeps it across restarts."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.person_facts import Fact, fact, facts, has_type
from bt_agents_core.private_files import make_private_file, make_private_folder
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Origin, SceneParameter, SceneSpace, SceneValue
from bt_agents_core.text import folded

MOST_KNOWN = 1000
"""Most persons, and most places, in memory; the one not seen for longest is dropped first."""

FADES = 0.99
"""Factor of all previous weights at each measurement: about the last hundred count."""

DRIFT_S = 3600.0
"""An estimate loses its certainty with this time constant [s]."""

FORMAT = 1
MOST_BYTES = 16 * 2**20
"""Largest size of the file; entries seen longest ago are dropped if it is exceeded."""

_HEAD = f'{{"format": {FORMAT}, "persons": '
_MIDDLE = ', "places": '
_MOST_VISITS = 10**12
_SHOWN = 100

LONGEST_NAME = 200
"""Most characters of the name of a person or a place."""


@dataclass(frozen=True, kw_only=True)
class Running:
    """An exponentially weighted mean and the scatter around it.

    The recursion of West (1979), "Updating mean and variance estimates", with all previous weights
    multiplied by :data:`FADES` at each value, as in Finch (2009).

    Attributes:
        scatter: Weighted sum of the squared deviations, including the variances of the values.
        at: Unix time of the last value [s].
    """

    mean: float = 0.0
    scatter: float = 0.0
    weight: float = 0.0
    at: float = -math.inf

    def after(self, value: float, std: float, weight: float, at: float) -> Running:
        """Return it with one more value, whose ``std`` and ``weight`` are above 0."""
        before = self.weight * FADES
        share = weight / (before + weight)
        step = value - self.mean
        return Running(
            mean=self.mean + share * step,
            # No term is negative, even after rounding.
            scatter=self.scatter * FADES + before * share * step * step + weight * std * std,
            weight=before + weight,
            at=at,
        )

    def std(self, ignorance: float, age_s: float) -> float:
        """Return the standard deviation of a value now.

        The prior knowledge counts as one measurement,
        s² = (scatter + ignorance²) / (weight + 1), and with time the value returns to ignorance:
        std² = s² + (ignorance² − s²) (1 − exp(−2 age / :data:`DRIFT_S`)), the prediction variance
        of an Ornstein-Uhlenbeck process. It never decreases with the age, which is at least 0.
        """
        limit = ignorance * ignorance
        known = (self.scatter + limit) / (self.weight + 1.0)
        grown = known + (limit - known) * -math.expm1(-2.0 * age_s / DRIFT_S)
        return math.sqrt(max(known, grown))


@dataclass
class KnownPerson:
    """Statistics of a person or a place.

    Attributes:
        visits: Number of visits of the person, or to the place.
        seen_at: Unix time of the last sighting [s].
        facts: Facts that agents have stored about a person.
        lent: Whether a copy shares the values, so that they must not be changed in place.
    """

    visits: int = 0
    values: dict[str, Running] = field(default_factory=dict)
    seen_at: float = 0.0
    facts: Mapping[str, Fact] = field(default_factory=dict)
    lent: bool = field(default=False, repr=False, compare=False)

    @property
    def returned(self) -> bool:
        """Whether the person is kept though not recognised now, from a visit as known by name."""
        return self.visits > 1 or bool(self.facts)

    def copy(self) -> KnownPerson:
        """Return a copy-on-write copy, which later measurements do not change."""
        self.lent = True
        return KnownPerson(
            visits=self.visits,
            values=self.values,
            seen_at=self.seen_at,
            facts=self.facts,
            lent=True,
        )

    def add(self, name: str, value: float, std: float, weight: float, at: float) -> None:
        """Add a value of a parameter; see :meth:`Running.after`."""
        if self.lent:
            self.values = dict(self.values)
            self.lent = False
        self.values[name] = self.values.get(name, Running()).after(value, std, weight, at)

    def estimate(
        self, parameter: SceneParameter, now: float, source: str = ""
    ) -> SceneValue | None:
        """Return the estimate of a value now, with its deviation; None if never measured."""
        running = self.values.get(parameter.name)
        if running is None or running.weight <= 0.0:
            return None
        unknown = parameter.ignorance
        age_s = max(0.0, now - running.at)
        std = running.std(unknown, age_s)
        return SceneValue(
            name=parameter.name,
            value=parameter.clamp(running.mean),
            origin=Origin.ESTIMATED,
            age_s=age_s,
            std=std,
            confidence=max(0.0, 1.0 - (std / unknown) ** 2),
            source=source,
        )


class Memory:
    """Running estimates of persons, averages of places, and facts that agents store about persons.

    Estimates and averages use only measured values.

    A person is remembered after the end of tracking only if the id is the name of a known person.
    Each visit counts once in the average of its place, with the values measured during it. All
    times are unix times [s].

    Attributes:
        changes: Number of changes so far, for saving.
    """

    def __init__(self, space: SceneSpace) -> None:
        self.changes = 0
        self._space = space
        self._persons: dict[str, KnownPerson] = {}
        self._places: dict[str, KnownPerson] = {}
        self._visits: dict[str, set[str]] = {}
        self._shunned: set[str] = set()

    def came(self, person: str, now: float) -> None:
        """Begin the visit of a person."""
        known = self._persons.pop(person, None) or KnownPerson()
        known.visits += 1
        known.seen_at = now
        self._persons[person] = known
        self._visits[person] = set()

    def measured(
        self, person: str, parameter: str, value: float, std: float, confidence: float, now: float
    ) -> None:
        """Add a value that was just measured of a present person.

        It ignores a value without any confidence, or of a person who is to be forgotten.
        """
        if person not in self._visits or person in self._shunned or confidence <= 0.0:
            return
        self._persons[person].add(parameter, value, std, confidence, now)
        self._visits[person].add(parameter)
        self.changes += 1

    def left(self, person: str, place: str, *, known: bool, now: float) -> None:
        """End a visit to a place; a person ``known`` by name may return."""
        measured = self._visits.pop(person, None)
        if measured is None:
            return
        remembered = self._persons.pop(person)
        remembered.seen_at = now
        if measured:
            self._count(place, remembered, measured, now)
        if (known or remembered.returned) and person not in self._shunned:
            self._persons[person] = remembered
        self._shunned.discard(person)
        self._bound()
        self.changes += 1

    def estimate(self, person: str, place: str, name: str, now: float) -> SceneValue | None:
        """Return the estimate for a person, else for the visitors of the place."""
        parameter = self._space.parameter(name)
        found = None
        if (known := self._persons.get(person)) is not None:
            seen = "once" if known.visits == 1 else f"{known.visits} times"
            found = known.estimate(parameter, now, f"{person or 'this person'}, seen {seen}")
        if found is None and (here := self._places.get(place)) is not None:
            where = f"in {place}" if place else "here"
            visits = "1 visit" if here.visits == 1 else f"{here.visits} visits"
            found = here.estimate(parameter, now, f"everybody {where}, {visits}")
        return found

    def visits(self, person: str) -> int:
        """Return the number of visits of a person, including the current one."""
        known = self._persons.get(person)
        return 0 if known is None else known.visits

    def facts(self, person: str) -> Mapping[str, Fact]:
        """Return the facts that agents have stored about a person."""
        known = self._persons.get(person)
        return {} if known is None else known.facts

    def remember(
        self, person: str, given: Iterable[tuple[str, object]], *, known: Collection[str]
    ) -> None:
        """Store values about a person by key; None deletes one.

        Values of a present person are stored only if the person is ``known`` by name.

        Raises:
            Refused: ``UNKNOWN_PERSON``, ``FORGOTTEN``, ``BAD_KEY`` or ``BAD_VALUE``; nothing is
                changed.
        """
        if person not in self._persons or (person in self._visits and person not in known):
            raise Refused(
                RefusalCode.UNKNOWN_PERSON,
                f"{_shown(person)} is not known by name, expected somebody who is",
            )
        if person in self._shunned:
            raise Refused(
                RefusalCode.FORGOTTEN, f"{person} is to be forgotten until the next visit"
            )
        changed = dict(self._persons[person].facts)
        for key, value in given:
            wanted = self._space.remembers.get(key)
            if wanted is None:
                known_keys = ", ".join(self._space.remembers) or "nothing"
                raise Refused(
                    RefusalCode.BAD_KEY,
                    f"{_shown(key)} is not remembered; scene.yaml declares {known_keys}",
                )
            if value is None:
                changed.pop(key, None)
            else:
                changed[key] = fact(key, value, wanted)
        self._persons[person].facts = changed
        self.changes += 1

    def forget(self, *, person: str = "", place: str = "") -> bool:
        """Forget a person, in any spelling, or a place; return whether anything was known.

        Nothing is remembered about a present person until the end of the visit.
        """
        if place:
            found = self._places.pop(place, None) is not None
        else:
            found = False
            for name in spellings(person, self._persons):
                one = self._persons.pop(name)
                found = found or bool(one.values or one.facts)
                if name in self._visits:
                    self._shunned.add(name)
                    self._persons[name] = KnownPerson(visits=1)
                    self._visits[name] = set()
        self.changes += 1
        return found

    def snapshot(
        self, known: Iterable[str] = ()
    ) -> tuple[dict[str, KnownPerson], dict[str, KnownPerson]]:
        """Return the persons and places to save, as a copy that does not change.

        Of the present persons, it contains only those ``known`` by name, now or at earlier visits.
        """
        names = set(known)
        persons = {
            person: one.copy()
            for person, one in self._persons.items()
            if person not in self._shunned
            and (person not in self._visits or person in names or one.returned)
        }
        return persons, {place: one.copy() for place, one in self._places.items()}

    def restore(
        self, persons: Mapping[str, KnownPerson], places: Mapping[str, KnownPerson]
    ) -> None:
        """Restore persons and places at the start."""
        self._persons.update(persons)
        self._places.update(places)
        self._bound()

    def _count(self, place: str, person: KnownPerson, measured: set[str], now: float) -> None:
        here = self._places.pop(place, KnownPerson())
        self._places[place] = here
        here.visits += 1
        here.seen_at = now
        for name in sorted(measured):
            found = person.estimate(self._space.parameter(name), now)
            if found is not None:
                here.add(name, found.value, found.std, 1.0, now)

    def _bound(self) -> None:
        for known in (self._persons, self._places):
            away = [name for name in known if known is self._places or name not in self._visits]
            oldest = sorted(away, key=lambda name: known[name].seen_at)
            for name in oldest[: max(0, len(away) - MOST_KNOWN)]:
                del known[name]


Remembered = tuple[Mapping[str, KnownPerson], Mapping[str, KnownPerson]]
"""Persons and places by name."""


class DamagedMemoryError(BtAgentsError):
    """The file of the memory is damaged."""


def to_text(
    persons: Mapping[str, KnownPerson],
    places: Mapping[str, KnownPerson],
    most_bytes: int = MOST_BYTES,
) -> str:
    """Return the text of a file with a limited number of bytes.

    It is assembled piece by piece, so that other threads can run in between.
    """
    pieces = [
        (known.seen_at, kind, f"{_json(name)}: {_json(_plain(known))}")
        for kind, every in enumerate((persons, places))
        for name, known in every.items()
    ]
    room = most_bytes - len(f"{_HEAD}{{}}{_MIDDLE}{{}}}}\n")
    remaining = set()
    for number in sorted(range(len(pieces)), key=lambda number: -pieces[number][0]):
        room -= len(pieces[number][2].encode()) + len(", ")
        if room < 0:
            break
        remaining.add(number)
    known, here = (
        ", ".join(pieces[number][2] for number in sorted(remaining) if pieces[number][1] == kind)
        for kind in (0, 1)
    )
    return f"{_HEAD}{{{known}}}{_MIDDLE}{{{here}}}}}\n"


def from_text(text: str, space: SceneSpace, now: float) -> Remembered:
    """Return the content of a text; skips values of other parameters, or out of range.

    Times later than ``now`` (unix time [s]), due to a wrong clock, become ``now``.

    Raises:
        DamagedMemoryError: The text is not from :func:`to_text`.
    """
    try:
        document = json.loads(text)
        found = document["format"]
        if found != FORMAT:
            raise ValueError(f"format {found!r}, expected {FORMAT}")
        return _known(document["persons"], space, now), _known(document["places"], space, now)
    except (
        ValueError, TypeError, KeyError, AttributeError, RecursionError, ArithmeticError,
    ) as error:  # fmt: skip
        text = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise DamagedMemoryError(f"not a memory of the scene layer: {text}") from None


def read_memory(path: Path, space: SceneSpace, now: float) -> Remembered:
    """Return the content of a file; nothing if it is empty or missing.

    Raises:
        DamagedMemoryError: It is a memory file, and damaged.
        BtAgentsError: It is not a memory file, or cannot be read.
    """
    another = "name another file for the memory"
    try:
        if not path.is_file() and path.exists():
            kind = "a folder" if path.is_dir() else "no plain file"
            raise BtAgentsError(f"{path} is {kind}, expected a file; {another}")
        with path.open("rb") as opened:
            content = opened.read(MOST_BYTES + 1)
    except FileNotFoundError:
        return {}, {}
    except OSError as error:
        text = error.strerror or error
        raise BtAgentsError(f"{path} cannot be read ({text}); {another}") from None
    if not content.strip():
        return {}, {}
    if not content.startswith(_HEAD.encode()):
        raise BtAgentsError(
            f"{path} is not a memory of the scene layer, expected a file that begins with "
            f"{_HEAD.strip()}, an empty one or none; {another}"
        )
    try:
        if len(content) > MOST_BYTES:
            raise DamagedMemoryError(f"more than {MOST_BYTES} bytes")
        return from_text(content.decode(), space, now)
    except UnicodeDecodeError as error:
        raise DamagedMemoryError(f"{path} is not text: {error}") from None
    except DamagedMemoryError as error:
        raise DamagedMemoryError(f"{path}: {error}") from None


def save_memory(
    path: Path, persons: Mapping[str, KnownPerson], places: Mapping[str, KnownPerson]
) -> None:
    """Write the whole file atomically, readable only by its owner; create it if missing.

    Raises:
        OSError: It cannot be written; the old file is unchanged.
    """
    make_private_folder(path.parent)
    make_private_file(path)
    write_atomically(path, to_text(persons, places))


def forget_in_file(path: Path, person: str) -> bool:
    """Forget a person in a file that no scene layer has open; return whether they were known.

    Raises:
        DamagedMemoryError: It is a memory file, and damaged.
        OSError: It cannot be read or written; the old file is unchanged.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return False
    except UnicodeDecodeError as error:
        raise DamagedMemoryError(f"{path} is not text: {error}") from None
    if not text.strip():
        return False
    try:
        document = json.loads(text)
        known = spellings(person, document["persons"])
        for name in known:
            del document["persons"][name]
        places = document["places"]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise DamagedMemoryError(
            f"{path} is not a memory of the scene layer, or damaged: remove it, or name another "
            "one with --memory"
        ) from None
    if known:
        rest = f"{_HEAD}{_json(document['persons'])}{_MIDDLE}{_json(places)}}}\n"
        make_private_file(path)
        write_atomically(path, rest)
    return bool(known)


def spellings(person: str, names: Iterable[str]) -> list[str]:
    """Return the names that differ from a person's only in case or the encoding of accents."""
    return [name for name in names if folded(name) == folded(person)]


def set_aside(path: Path) -> Path:
    """Rename a damaged file; return the new name."""
    names = (path.with_name(f"{path.name}.damaged{n or ''}") for n in range(MOST_KNOWN))
    free = next((name for name in names if not name.exists()), path.with_name(f"{path.name}.old"))
    return path.rename(free)


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _plain(known: KnownPerson) -> dict[str, Any]:
    return {
        "visits": known.visits,
        "seen_at": known.seen_at,
        "values": {
            name: [one.mean, one.scatter, one.weight, one.at] for name, one in known.values.items()
        },
        **({"remembers": dict(known.facts)} if known.facts else {}),
    }


def _known(document: Mapping[str, Any], space: SceneSpace, now: float) -> dict[str, KnownPerson]:
    found = {}
    for name, one in document.items():
        if len(name) > LONGEST_NAME:
            raise ValueError(f"a name of {len(name)} characters, expected {LONGEST_NAME} at most")
        visits = one["visits"]
        if type(visits) is not int or not 0 <= visits < _MOST_VISITS:
            raise ValueError(f"{name}: {_shown(visits)} visits, expected a whole number")
        [seen_at] = _numbers([one["seen_at"]], name)
        values = dict(_values(one["values"], name, space, now))
        remembered = _facts(one.get("remembers", {}), name, space)
        found[name] = KnownPerson(
            visits=visits, values=values, seen_at=min(seen_at, now), facts=remembered
        )
    return found


def _facts(document: Mapping[str, Any], owner: str, space: SceneSpace) -> dict[str, Fact]:
    """Return the stored facts about a person that match the declarations in scene.yaml."""
    try:
        found = facts(document.items())
    except Refused as refused:
        raise ValueError(f"{owner}: {refused.reason}") from None
    return {
        key: value
        for key, value in found.items()
        if key in space.remembers and has_type(value, space.remembers[key])
    }


def _values(
    document: Mapping[str, Any], owner: str, space: SceneSpace, now: float
) -> Iterator[tuple[str, Running]]:
    ranges = {p.name: (p.minimum, p.maximum) for p in space.parameters}
    for name, numbers in document.items():
        mean, scatter, weight, at = _numbers(numbers, f"{owner}: {name}")
        if scatter < 0.0 or weight <= 0.0:
            raise ValueError(f"{owner}: {name}: a negative scatter or weight")
        low, high = ranges.get(name, (math.inf, -math.inf))
        if low <= mean <= high:
            yield name, Running(mean=mean, scatter=scatter, weight=weight, at=min(at, now))


def _numbers(values: Iterable[Any], what: str) -> list[float]:
    numbers = []
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{what}: {_shown(value)}, expected a number")
        numbers.append(float(value))
        if not math.isfinite(numbers[-1]):
            raise ValueError(f"{what}: {value}, expected a finite number")
    return numbers


def _shown(value: object) -> str:
    return repr(value)[:_SHOWN]
