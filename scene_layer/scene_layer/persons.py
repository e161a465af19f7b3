# SPDX-License-Identifier: Apache-2.0
"""Persons: who is tracked, whom the scene is about, and their values after they leave."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Integral
from unicodedata import normalize

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.model.scene_specs import AddresseeRule, MissingRule, PersonsSpec, SceneSpec
from scene_layer.memory import Memory
from scene_layer.sources import Sources

MOST_PERSONS = 50
"""Most persons tracked at once; later ones are ignored until there is room."""

LONGEST_ID = 100
"""Most characters of the id of a person."""

NOBODY = ""
"""The id that stands for nobody."""

SAMPLE_S = 1.0
"""Shortest time between two counted measurements of a person, however fast the sensors [s]."""

AWAY_S = 300.0
"""Longest absence of a person known by name that does not end the visit [s]."""

MOST_AWAY = 50
"""Most absent persons whose visits may continue; beyond it, the longest absent have left."""

THRESHOLD = 0.5
"""Smallest reading that means that a person is present or known: true, one face, one half."""

_RULE_TEXTS = {
    AddresseeRule.ENGAGED: ("most engaged", "more engaged", ""),
    AddresseeRule.NEAREST: ("nearest", "nearer", " m"),
}


def check_id(person_id: object) -> str:
    """Check the id of a person from a tracker and return it as a text; 7 becomes ``"7"``.

    Raises:
        Refused: ``NOT_A_TEXT``, ``EMPTY``, ``TOO_LONG`` or ``BAD_TEXT``.
    """
    what = "id of a person"
    if isinstance(person_id, Integral) and not isinstance(person_id, bool):
        return str(int(person_id))
    if not isinstance(person_id, str):
        raise Refused(
            RefusalCode.NOT_A_TEXT,
            f"{what}: a {type(person_id).__name__}, expected a text or a whole number",
        )
    if not person_id:
        raise Refused(
            RefusalCode.EMPTY, f"{what}: empty, expected a name; the tracker must give one"
        )
    if len(person_id) > LONGEST_ID:
        raise Refused(
            RefusalCode.TOO_LONG,
            f"{what}: {len(person_id)} characters, expected {LONGEST_ID} at most",
        )
    if not person_id.isprintable() or person_id != person_id.strip():
        raise Refused(
            RefusalCode.BAD_TEXT,
            f"{what}: {person_id!r}, expected no control characters and no outer spaces",
        )
    # Two encodings of an accent are the same name.
    return normalize("NFC", person_id)


class Persons:
    """Persons of a tracker, and the addressee: whom the scene is about.

    A person is tracked from the first message that lists them. They are gone ``lost_after_s``
    after the first message that no longer lists them, or when the tracker has been silent for
    ``stale_after_s``. The addressee stays while tracked, until another person has been better by
    more than ``better_by`` for ``hold_s`` without interruption. Two choices of different persons
    are never less than ``hold_s`` apart; in between there may be no addressee. If several persons
    have been better for that long, the best one becomes the addressee.

    Args:
        spec: The rules; None if persons are not distinguished, so that no person is tracked.

    Attributes:
        addressee: Id of the addressee; :data:`NOBODY` without one.
        reason: Reason for the choice, in words.
        received_at: Time of the last message of the tracker; −∞ before the first [s].
        refusals: Number of refused ids, by code.
    """

    def __init__(self, spec: PersonsSpec | None) -> None:
        if spec is not None:
            self._tracker = spec.tracked
            self._rule = spec.addressee
        self._absent_since: dict[str, float] = {}
        self._listed: tuple[str, ...] = ()
        self.received_at = -math.inf
        self._last = NOBODY
        self._chosen_at = -math.inf
        self._better_since: dict[str, float] = {}
        self.addressee = NOBODY
        self.reason = "nobody is there"
        self.refusals: Counter[str] = Counter()

    @property
    def tracked(self) -> tuple[str, ...]:
        """Ids of all tracked persons, in order of arrival."""
        return tuple(self._absent_since)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Ids of all persons who are tracked, or will be from the next update on."""
        return tuple(dict.fromkeys((*self._absent_since, *self._listed)))

    def receive_ids(self, ids: Iterable[object], now: float) -> Refused | None:
        """Take the ids of all persons that the tracker reports; bad ids are skipped.

        Returns:
            The refusal of the last skipped id; None if all are taken.
        """
        found: dict[str, None] = {}
        refused: Refused | None = None
        for one in ids:
            try:
                person = check_id(one)
                if person in found:
                    raise Refused(
                        RefusalCode.DUPLICATE, f"id of a person: {person!r} stands twice"
                    )
                found[person] = None
            except Refused as problem:
                refused = self._refuse(problem)
        # Persons who are already tracked take precedence.
        ordered = sorted(found, key=lambda person: person not in self._absent_since)
        if len(ordered) > MOST_PERSONS:
            refused = self._refuse(
                Refused(
                    RefusalCode.TOO_MANY,
                    f"{len(ordered)} persons at once, expected {MOST_PERSONS} at most; "
                    "the others are left out",
                )
            )
        self._listed = tuple(ordered[:MOST_PERSONS])
        self.received_at = now
        for person, since in self._absent_since.items():
            listed = person in self._listed
            self._absent_since[person] = math.inf if listed else min(since, now)
        return refused

    def update(
        self, ranks: Mapping[str, float], now: float
    ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Update the present persons at a steady time [s], and choose the addressee.

        Ranks are engagements [0..1] or distances [m], depending on the rule; persons without a
        rank, or with NaN, are ranked last.

        Returns:
            Persons who have arrived and left, in order.
        """
        stale = now > self.received_at + self._tracker.stale_after_s
        fresh = () if stale else self._listed
        gone = tuple(
            person
            for person, since in self._absent_since.items()
            if stale or now >= since + self._tracker.lost_after_s
        )
        for person in gone:
            del self._absent_since[person]
        room = MOST_PERSONS - len(self._absent_since)
        came = tuple(person for person in fresh if person not in self._absent_since)[:room]
        self._absent_since.update(dict.fromkeys(came, math.inf))
        self._choose([person for person in self.tracked if person in fresh], ranks, now)
        return came, gone

    def _refuse(self, problem: Refused) -> Refused:
        self.refusals[problem.code] += 1
        return problem

    def _choose(self, candidates: list[str], ranks: Mapping[str, float], now: float) -> None:
        if self.addressee and self.addressee not in self._absent_since:
            self.reason = f"{self.addressee} is gone"
            self.addressee = NOBODY
        if not self.addressee:
            early = now < self._chosen_at + self._rule.hold_s
            allowed = [p for p in candidates if not early or p == self._last]
            if allowed:
                self._take(self._best(allowed, ranks), ranks, now)
            return
        better = self._challengers(candidates, ranks)
        self._better_since = {p: self._better_since.get(p, now) for p in better}
        ready = [p for p in better if now - self._better_since[p] >= self._rule.hold_s]
        if ready:
            before, challenger = self.addressee, self._best(ready, ranks)
            self._take(challenger, ranks, now)
            _, comparative, _ = _RULE_TEXTS[self._rule.rule]
            self.reason = (
                f"{challenger} has been {comparative} than {before} for {self._rule.hold_s:g} s"
            )

    def _take(self, person: str, ranks: Mapping[str, float], now: float) -> None:
        self.reason = self._why(person, ranks)
        self.addressee = self._last = person
        self._chosen_at = now
        self._better_since = {}

    def _why(self, person: str, ranks: Mapping[str, float]) -> str:
        if len(self._absent_since) == 1:
            return f"{person} is the only one"
        rank = ranks.get(person, math.nan)
        if self._rule.rule is AddresseeRule.FIRST or math.isnan(rank):
            return f"{person} came first"
        best, _, unit = _RULE_TEXTS[self._rule.rule]
        return f"{person} is {best}: {rank:.2g}{unit}"

    def _best(self, candidates: list[str], ranks: Mapping[str, float]) -> str:
        """Return the best ranked person; of equal ones, the one who arrived first."""
        return max(candidates, key=lambda person: self._score(person, ranks))

    def _challengers(self, candidates: list[str], ranks: Mapping[str, float]) -> list[str]:
        """Return all persons who are better than the addressee by more than the margin."""
        wanted = self._score(self.addressee, ranks)
        wanted += self._rule.better_by if math.isfinite(wanted) else 0.0
        return [p for p in candidates if p != self.addressee and self._score(p, ranks) > wanted]

    def _score(self, person: str, ranks: Mapping[str, float]) -> float:
        """Return the score of a person by the rule; greater is better, unknown is lowest."""
        rank = ranks.get(person, math.nan)
        if self._rule.rule is AddresseeRule.FIRST or math.isnan(rank):
            return -math.inf
        return rank if self._rule.rule is AddresseeRule.ENGAGED else -rank


class Encounters:
    """Visits of persons with the ids of a tracker, or of one person at a time without ids.

    Measurements of present persons go into the memory: those about the person, or those that no
    source attributes to a single person. The person whom a run began with is kept until the run
    ends, even after leaving, with the values at that time. A person known by name is kept for
    :data:`AWAY_S`, so a tracker that loses them briefly does not end their visit.
    """

    def __init__(self, spec: SceneSpec, sources: Sources, memory: Memory) -> None:
        self.persons = Persons(spec.persons)
        self._spec = spec
        self._sources = sources
        self._memory = memory
        self._here: tuple[str, ...] = ()
        self._away: dict[str, _Departure] = {}
        self._observed_at: dict[str, float] = {}
        self._names: set[str] = set()
        self._visitor = NOBODY
        self._remembered = tuple(
            name
            for name in spec.space.names
            if spec.missing_rule(name) is not MissingRule.LEAVE_OUT
        )

    @property
    def identified(self) -> bool:
        """Whether persons have ids."""
        return self._spec.persons is not None

    @property
    def enabled(self) -> bool:
        """Whether updates are needed, for persons with ids or for values of persons."""
        return self.identified or bool(self._remembered or self._spec.personal)

    @property
    def here(self) -> tuple[str, ...]:
        """Present persons as of the last update; :data:`NOBODY` for a person without an id."""
        return self._here

    def update(self, now: float, wall: float, held: str | None = None) -> bool:
        """Update the present persons and store their measurements; times are steady and unix [s].

        The person of a run, who is ``held``, is kept.

        Returns:
            True if a person has arrived or left, or the addressee has changed.
        """
        before = self._here, self.persons.addressee
        came, gone = self._moved(now)
        self._end_visits(now, held)
        for person in came:
            if person and person == self._visitor:
                self._visitor = NOBODY  # from now on the tracker ends the visit
            elif self._away.pop(person, None) is None:
                self._memory.came(person, wall)
        for person in self._here:
            if now - self._observed_at.get(person, -math.inf) >= SAMPLE_S:
                self._observe(person, now, wall)
        for person in gone:
            self._observe(person, now, wall)
            self._away[person] = self._departure(now, wall)
        self._end_visits(now, held)
        self._forget_others()
        return before != (self._here, self.persons.addressee)

    def begin_visit(self, visitor: str, now: float, wall: float) -> None:
        """Begin the visit of a person named by a script or by hand; the previous one has left.

        A ``visitor`` without a name is :data:`NOBODY`.
        """
        if self._visitor:
            self._away[self._visitor] = self._departure(now, wall)
        self._visitor = visitor
        self._end_visits(now, visitor)
        if visitor:
            if (left := self._away.pop(visitor, None)) is not None:
                self._memory.left(visitor, left.place, known=True, now=left.wall)
            self._memory.came(visitor, wall)
            self._names.add(visitor)

    @property
    def known(self) -> frozenset[str]:
        """Present or retained persons whose ids will be the same at their next visit."""
        return frozenset(self._names)

    def _moved(self, now: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
        if self._spec.persons is not None:
            moved = self.persons.update(self._ranks(self._spec.persons, now), now)
            self._here = self.persons.tracked
            return moved
        here = (NOBODY,) if somebody_is_measured(self._spec, self._sources, now) else ()
        came = here if not self._here else ()
        gone = self._here if not here else ()
        self._here = here
        return came, gone

    def _ranks(self, spec: PersonsSpec, now: float) -> dict[str, float]:
        """Return the known ranks of persons, which decide on the addressee."""
        source = spec.addressee.source
        if source is None:
            return {}
        found = {p: self._sources.reading(source, now, p) for p in self.persons.candidates}
        return {person: read.value for person, read in found.items() if read is not None}

    def _observe(self, person: str, now: float, wall: float) -> None:
        observed_at = self._observed_at.get(person, -math.inf)
        for name in self._remembered:
            read = self._sources.latest(name, now, person, alone=True)
            if read is not None and observed_at < read.at and now <= read.stale_at:
                self._memory.measured(person, name, read.value, read.std, read.confidence, wall)
        self._observed_at[person] = now
        source = self._spec.persons.known if self._spec.persons is not None else None
        read = self._sources.reading(source, now, person) if source is not None else None
        if read is not None:
            (self._names.add if read.value >= THRESHOLD else self._names.discard)(person)

    def _departure(self, now: float, wall: float) -> _Departure:
        return _Departure(at=now, wall=wall, place=self._sources.place(now))

    def _end_visits(self, now: float, held: str | None) -> None:
        """End the visits of persons who are unlikely to return to them, oldest departure first."""
        spare = len(self._away) - MOST_AWAY
        for number, (person, left) in enumerate(list(self._away.items())):
            named = person in self._names and number >= spare
            if person == held or (named and now < left.at + AWAY_S):
                continue
            del self._away[person]
            self._memory.left(person, left.place, known=person in self._names, now=left.wall)
            self._names.discard(person)
            self._observed_at.pop(person, None)

    def _forget_others(self) -> None:
        for person in self._sources.people - {*self.persons.candidates, *self._away}:
            self._sources.forget(person)


@dataclass(frozen=True, kw_only=True)
class _Departure:
    """Steady and unix time [s] and place where a person was lost."""

    at: float
    wall: float
    place: str


def somebody_is_measured(spec: SceneSpec, sources: Sources, now: float) -> bool:
    """Return whether the sources measure a person, if persons are not identified.

    A silent or stale person source sees no person. Without a person source, any valid measurement
    means that a person is present.
    """
    if spec.person is not None:
        read = sources.latest_person()
        return read is not None and now <= read.stale_at and read.value >= THRESHOLD
    found = (sources.latest(name, now) for name in spec.space.names)
    return any(read is not None and now <= read.stale_at for read in found)
