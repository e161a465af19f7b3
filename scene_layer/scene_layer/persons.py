# SPDX-License-Identifier: Apache-2.0
"""Who is tracked, and whom of them the scene is about; short gaps and leads change nothing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Integral

from bt_agents_core.errors import Refused
from bt_agents_language.model.scene_specs import AddresseeRule, PersonsSpec

MOST_PERSONS = 50
"""Persons that are tracked at once; who comes later is not looked at until there is room."""

LONGEST_ID = 100
"""Characters of the id of a person."""

NOBODY = ""
"""The id of nobody."""

_WORDS = {
    AddresseeRule.ENGAGED: ("most engaged", "more engaged", ""),
    AddresseeRule.NEAREST: ("nearest", "nearer", " m"),
}


def check_id(person_id: object) -> str:
    """Return the id of a person, as a tracker says it, when it can be used; 7 is ``"7"``.

    Raises:
        Refused: ``NOT_A_TEXT``, ``EMPTY``, ``TOO_LONG`` or ``BAD_ID``.
    """
    what = "id of a person"
    if isinstance(person_id, Integral) and not isinstance(person_id, bool):
        return str(int(person_id))
    if not isinstance(person_id, str):
        raise Refused(
            "NOT_A_TEXT",
            f"{what}: a {type(person_id).__name__}, expected a text or a whole number",
        )
    if not person_id:
        raise Refused("EMPTY", f"{what}: empty, expected a name; the tracker must give one")
    if len(person_id) > LONGEST_ID:
        raise Refused(
            "TOO_LONG", f"{what}: {len(person_id)} characters, expected {LONGEST_ID} at most"
        )
    if not person_id.isprintable() or person_id != person_id.strip():
        raise Refused(
            "BAD_ID", f"{what}: {person_id!r}, expected no control characters and no outer spaces"
        )
    return person_id


@dataclass(frozen=True, kw_only=True)
class Moved:
    """Who has come and who has gone since the last look, in order."""

    came: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()


@dataclass
class _Tracked:
    number: int
    absent_since: float = math.inf


class Persons:
    """The persons of a tracker, and the addressee: whom the scene is about.

    A person is tracked from the first message that lists them. They are gone ``lost_after_s``
    after the first one that does not list them any more, or when the tracker has been silent for
    ``stale_after_s``. The addressee stays as long as it is tracked and nobody else has been
    better, by more than ``better_by``, for ``hold_s`` without interruption. Two choices of
    different persons are never less than ``hold_s`` apart; in between there may be nobody.
    Of several who have been better for so long, the best is taken.

    Args:
        spec: The rules.

    Attributes:
        addressee: Its id; :data:`NOBODY` without one.
        reason: Why this one, in words.
        heard_at: When the tracker spoke last; −∞ before the first time [s].
        refusals: How many ids were refused, by code.
    """

    def __init__(self, spec: PersonsSpec) -> None:
        self._tracker = spec.tracked
        self._rule = spec.addressee
        self._tracked: dict[str, _Tracked] = {}
        self._listed: tuple[str, ...] = ()
        self.heard_at = -math.inf
        self._count = 0
        self._last = NOBODY
        self._chosen_at = -math.inf
        self._better_since: dict[str, float] = {}
        self.addressee = NOBODY
        self.reason = "nobody is there"
        self.refusals: Counter[str] = Counter()

    @property
    def tracked(self) -> tuple[str, ...]:
        """Ids of all tracked persons, in the order they came."""
        return tuple(self._tracked)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Ids of all who are tracked, or are from the next look on."""
        return tuple(dict.fromkeys((*self._tracked, *self._listed)))

    def listed(self, ids: Iterable[object], now: float) -> Refused | None:
        """Take a message of the tracker.

        Args:
            ids: Of all persons there are, as the tracker says them; bad ones are left out.
            now: Steady time [s].

        Returns:
            The refusal of the last id that was left out; None when all are taken.
        """
        found: dict[str, None] = {}
        refused: Refused | None = None
        for one in ids:
            try:
                person = check_id(one)
                if person in found:
                    raise Refused("DUPLICATE_PERSON", f"id of a person: {person!r} stands twice")
            except Refused as problem:
                refused = self._refuse(problem)
                continue
            found[person] = None
        # Whoever is tracked already goes first.
        ordered = sorted(found, key=lambda person: person not in self._tracked)
        if len(ordered) > MOST_PERSONS:
            refused = self._refuse(
                Refused(
                    "TOO_MANY",
                    f"{len(ordered)} persons at once, expected {MOST_PERSONS} at most; "
                    "the others are left out",
                )
            )
        self._listed = tuple(ordered[:MOST_PERSONS])
        self.heard_at = now
        for person, one in self._tracked.items():
            listed = person in self._listed
            one.absent_since = math.inf if listed else min(one.absent_since, now)
        return refused

    def look(self, ranks: Mapping[str, float], now: float) -> Moved:
        """Find out who is there now, and choose the addressee.

        Args:
            ranks: Engagement [0..1] or distance [m] by person, as the rule wants it; who is not
                in it, or NaN, is ranked last.
            now: Steady time [s], never earlier than before.
        """
        stale = now > self.heard_at + self._tracker.stale_after_s
        fresh = () if stale else self._listed
        gone = tuple(
            person
            for person, one in self._tracked.items()
            if stale or now >= one.absent_since + self._tracker.lost_after_s
        )
        for person in gone:
            del self._tracked[person]
        room = MOST_PERSONS - len(self._tracked)
        came = tuple(person for person in fresh if person not in self._tracked)[:room]
        for person in came:
            self._count += 1
            self._tracked[person] = _Tracked(number=self._count)
        self._choose([person for person in self._tracked if person in fresh], ranks, now)
        return Moved(came=came, gone=gone)

    def _refuse(self, problem: Refused) -> Refused:
        self.refusals[problem.code] += 1
        return problem

    def _choose(self, candidates: list[str], ranks: Mapping[str, float], now: float) -> None:
        if self.addressee and self.addressee not in self._tracked:
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
            _, word, _ = _WORDS[self._rule.rule]
            self.reason = f"{challenger} has been {word} than {before} for {self._rule.hold_s:g} s"

    def _take(self, person: str, ranks: Mapping[str, float], now: float) -> None:
        self.reason = self._why(person, ranks)
        self.addressee = self._last = person
        self._chosen_at = now
        self._better_since = {}

    def _why(self, person: str, ranks: Mapping[str, float]) -> str:
        if len(self._tracked) == 1:
            return f"{person} is the only one"
        rank = ranks.get(person, math.nan)
        if self._rule.rule is AddresseeRule.FIRST or math.isnan(rank):
            return f"{person} came first"
        best, _, unit = _WORDS[self._rule.rule]
        return f"{person} is {best}: {rank:.2g}{unit}"

    def _best(self, candidates: list[str], ranks: Mapping[str, float]) -> str:
        """Return the best ranked person; of equal ones the one who came first."""
        return max(candidates, key=lambda p: (self._score(p, ranks), -self._tracked[p].number))

    def _challengers(self, candidates: list[str], ranks: Mapping[str, float]) -> list[str]:
        """Return all who are better than the addressee by more than the margin."""
        wanted = self._score(self.addressee, ranks)
        wanted += self._rule.better_by if math.isfinite(wanted) else 0.0
        return [p for p in candidates if p != self.addressee and self._score(p, ranks) > wanted]

    def _score(self, person: str, ranks: Mapping[str, float]) -> float:
        """Return how good a person is by the rule, greater is better; unknown is the least."""
        rank = ranks.get(person, math.nan)
        if self._rule.rule is AddresseeRule.FIRST or math.isnan(rank):
            return -math.inf
        return rank if self._rule.rule is AddresseeRule.ENGAGED else -rank
