# SPDX-License-Identifier: Apache-2.0
"""Sources: turn sensor messages into readings of scene parameters, and combine several of one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import check_value
from bt_agents_core.source_mapping import mapped, mapped_std
from bt_agents_core.text import folded
from bt_agents_language.expression.expression_values import EvaluationError, described
from bt_agents_language.expression.expressions import Expression, MissingValue
from bt_agents_language.model.scene_specs import (
    LARGEST_STD,
    MESSAGE,
    PERSON,
    SceneSpec,
    SourceSpec,
    word_of,
)
from scene_layer.health import Standing

Message = Callable[[str], object]
"""Returns the field of a message by its dotted path, as plain data.

Raises :class:`~bt_agents_core.errors.Refused` for a missing field: ``NO_SUCH_ITEM`` beyond the end
of a list, which means that nothing was measured.
"""

LONGEST_TEXT = 100
"""Most characters of the name of a place or the id of a part of a person."""

_ROUNDING = 1e-6
"""How far a confidence may exceed 1, due to the precision of a float32."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Reading of a parameter: value, certainty and validity.

    Attributes:
        value: The value; finite.
        at: Steady time of its arrival [s].
        stale_at: Steady time when it expires [s]; infinite for never.
        std: Standard deviation in the unit of the parameter; 0 if none is stated.
        confidence: Confidence above 0, up to 1; 1 if none is stated.
        source: Its origin, in words; may be empty.
    """

    value: float
    at: float
    stale_at: float = math.inf
    std: float = 0.0
    confidence: float = 1.0
    source: str = ""


def fused(readings: Sequence[Reading]) -> Reading:
    """Return the inverse-variance mean of one or more readings of the same quantity.

    The value is the mean weighted by ``w_i = c_i / s_i²``, its standard deviation ``1 / √Σ w_i``:
    the inverse-variance mean (see J. Hartung, G. Knapp, B. K. Sinha, "Statistical Meta-Analysis
    with Applications", 2008, chapter 4), in which the confidence ``c_i`` scales down the weight of
    a reading like a power prior (J. G. Ibrahim, M.-H. Chen, "Power Prior Distributions for
    Regression Models", 2000). So a single reading of confidence ``c`` has the standard deviation
    ``s / √c``. A reading without a standard deviation has the average weight of those with one,
    and does not reduce the resulting deviation; if none states one, the confidences alone are the
    weights. The result has the highest confidence and the latest times of all readings.
    """
    stated = [reading.std for reading in readings if reading.std > 0.0]
    # Relative to the smallest deviation, so that no square overflows.
    smallest = min(stated, default=1.0)
    counts = [(smallest / std) ** 2 for std in stated] or [1.0]
    mean_count = math.fsum(counts) / len(counts)
    weights = [
        reading.confidence * ((smallest / reading.std) ** 2 if reading.std > 0.0 else mean_count)
        for reading in readings
    ]
    values = [reading.value for reading in readings]
    mean = math.fsum(map(math.prod, zip(weights, values, strict=True))) / math.fsum(weights)
    known = math.fsum(w for w, r in zip(weights, readings, strict=True) if r.std > 0.0)
    return Reading(
        value=min(max(mean, min(values)), max(values)),
        at=max(reading.at for reading in readings),
        stale_at=max(reading.stale_at for reading in readings),
        std=smallest / math.sqrt(known) if stated else 0.0,
        confidence=max(reading.confidence for reading in readings),
        source=" and ".join(sorted({r.source for r in readings if r.source})),
    )


def smoothed(before: Reading, new: Reading, time_constant_s: float) -> Reading:
    """Return a new reading, smoothed by the previous one depending on the time between them.

    ``y += a·(x − y)`` with ``a = 1 − exp(−c·Δt / τ)``: exponential smoothing of readings at uneven
    times (A. Eckner, "Algorithms for Unevenly Spaced Time Series: Moving Averages and Other
    Rolling Operators", 2017), in which a lower confidence slows time. The standard deviation and
    the confidence move in the same way: errors of neighbouring readings are not independent, so
    their mean is not more certain than each of them. A stale previous reading is ignored, and a
    time constant of 0 disables smoothing.
    """
    if time_constant_s <= 0.0 or new.at > before.stale_at:
        return new
    elapsed_s = max(0.0, new.at - before.at)
    share = -math.expm1(-new.confidence * elapsed_s / time_constant_s)
    return replace(
        new,
        value=_between(before.value, new.value, share),
        std=_between(before.std, new.std, share) if before.std and new.std else new.std,
        confidence=_between(before.confidence, new.confidence, share),
    )


def _between(first: float, last: float, share: float) -> float:
    value = first + share * (last - first)
    return min(max(value, min(first, last)), max(first, last))


class _NotMeasuredError(Exception):
    """The message says that nothing was measured."""


class _NanFieldError(MissingValue):
    """A field is NaN, which in many messages means unknown."""


class Sources:
    """Latest good reading of every source, per person if they differ.

    A refused message changes nothing: the last good reading stays until it is stale. The caller
    limits the number of persons by forgetting those of :attr:`people` who are no longer of
    interest.

    Attributes:
        refusals: Number of refused messages, by topic and code.
    """

    def __init__(self, spec: SceneSpec) -> None:
        self._spec = spec
        self._sources_of = {
            name: [source for source in spec.sources if source.parameter == name]
            for name in spec.space.names
        }
        self._parameters = {
            source: spec.space.parameter(source.parameter) for source in spec.sources
        }
        place = (spec.place,) if isinstance(spec.place, SourceSpec) else ()
        self._parts = spec.persons.parts if spec.persons is not None else ()
        self._named = frozenset((*place, *self._parts))
        self._personal_of = {
            name: [source for source in sources if source.per_person]
            for name, sources in self._sources_of.items()
        }
        self._largest_std = {p.name: p.ignorance for p in spec.space.parameters}
        self._latest: dict[tuple[SourceSpec, str], Reading] = {}
        self._texts: dict[tuple[SourceSpec, str], tuple[str, float]] = {}
        self.refusals: Counter[tuple[str, str]] = Counter()

    def read(self, source: SourceSpec, message: Message, now: float, person: str = "") -> bool:
        """Read a message (one item for a source of items) that arrived at a steady time [s].

        Returns:
            True if the value has changed; False also if the message says that nothing was
            measured, by a confidence of 0, an empty list or an empty word.

        Raises:
            Refused: ``NOT_A_NUMBER``, ``NOT_FINITE``, ``OUT_OF_RANGE``, ``UNKNOWN_WORD``,
                ``NOT_COMPUTABLE``, ``NOT_A_TEXT``, ``TOO_LONG`` or ``UNKNOWN_FIELD``.
        """
        of = (source, person if source.per_person else "")
        try:
            if source in self._named:
                return self._take_text(of, message, now)
            reading = self._measured(source, message, now)
        except _NotMeasuredError:
            return False
        except Refused as refused:
            self.refusals[source.topic, refused.code] += 1
            raise
        before = self._latest.get(of)
        if before is not None and source.smoothing_s:
            reading = smoothed(before, reading, source.smoothing_s)
        self._latest[of] = reading
        return before is None or before.value != reading.value or now > before.stale_at

    @property
    def people(self) -> frozenset[str]:
        """Ids of all persons with readings that were not forgotten."""
        return frozenset(
            person for store in (self._latest, self._texts) for _, person in store if person
        )

    def forget(self, person: str) -> None:
        """Drop all readings of a person."""
        for store in (self._latest, self._texts):
            for of in [one for one in store if one[1] == person and one[0].per_person]:
                del store[of]

    # Current values

    def latest(
        self, parameter: str, now: float, person: str = "", *, alone: bool = False
    ) -> Reading | None:
        """Return the fused readings of a parameter.

        Readings of a source that is not about a single person count for everybody. But if other
        sources are about single persons, they count for a person only together with a reading of
        that person: the voice in the room is not the mood of a silent person.

        With ``alone``, only readings about this person count, if there are such sources.

        Returns:
            The fusion of the readings that are not stale; if all are stale, the newest reading
            unchanged; None if there never was one. The deviation is at most that of a
            value anywhere in the range.
        """
        own = self._readings(self._personal_of.get(parameter, ()), person)
        fresh = [reading for reading in own if now <= reading.stale_at]
        about_one = bool(person and self._personal_of.get(parameter))
        found = own
        if not about_one or (fresh and not alone):
            found = self._readings(self._sources_of.get(parameter, ()), person)
            fresh = [reading for reading in found if now <= reading.stale_at]
        if not fresh:
            return max(found, key=lambda r: r.at, default=None)
        together = fused(fresh)
        return replace(together, std=min(together.std, self._largest_std[parameter]))

    def _readings(self, sources: Iterable[SourceSpec], person: str) -> list[Reading]:
        ofs = ((source, person if source.per_person else "") for source in sources)
        return [self._latest[of] for of in ofs if of in self._latest]

    def standings(self, now: float) -> Mapping[str, Standing]:
        """Return topic → state, without topics that are about a single person."""
        stale_at = {source: reading.stale_at for (source, _), reading in self._latest.items()}
        person = (self._spec.person,) if self._spec.person is not None else ()
        standings: dict[str, Standing] = {}
        for source in (*self._spec.sources, *person):
            if source.placeholders or standings.get(source.topic) is Standing.FRESH:
                continue
            if source not in stale_at:
                standings.setdefault(source.topic, Standing.UNREAD)
            else:
                holds = now <= stale_at[source]
                standings[source.topic] = Standing.FRESH if holds else Standing.STALE
        return standings

    def latest_person(self) -> Reading | None:
        """Return the newest reading of the person source, stale or not."""
        return self._latest.get((self._spec.person, "")) if self._spec.person else None

    def reading(self, source: SourceSpec, now: float, person: str = "") -> Reading | None:
        """Return the reading of one source; None without one or if it is stale."""
        found = self._latest.get((source, person if source.per_person else ""))
        return found if found is not None and now <= found.stale_at else None

    def place(self, now: float) -> str:
        """Return the place of the robot; empty if unknown."""
        place = self._spec.place
        return place if isinstance(place, str) else self._text(place, now, "")

    def topics(self, people: Iterable[str], now: float) -> dict[tuple[SourceSpec, str], str]:
        """Return the topics with readings of each of some persons: (source, person) → topic.

        Ids that are invalid in the name of a topic have none; topics of parts are known once the
        id of the part is known.
        """
        found: dict[tuple[SourceSpec, str], str] = {}
        sources = [source for source in self._spec.every_source if source.placeholders]
        for person in people:
            ids = {part.parameter: self._text(part, now, person) for part in self._parts}
            for source in sources:
                topic = source.topic_of({**ids, PERSON: person})
                if topic is not None:
                    found[source, person] = topic
        return found

    def _text(self, source: SourceSpec, now: float, person: str) -> str:
        text, stale_at = self._texts.get((source, person), ("", 0.0))
        return text if now <= stale_at else ""

    # Content of a message

    def _take_text(self, of: tuple[SourceSpec, str], message: Message, now: float) -> bool:
        source, person = of
        raw = _evaluated(source, source.field, message)
        what = f"reading of {source.topic}"
        if not isinstance(raw, str):
            raise Refused(
                RefusalCode.NOT_A_TEXT,
                f"{what}: {source.field.text} is a {type(raw).__name__}, expected a text; name "
                "another field in scene.yaml",
            )
        text = raw.strip()
        if len(text) > LONGEST_TEXT or not text.isprintable():
            raise Refused(
                RefusalCode.TOO_LONG,
                f"{what}: {source.field.text} has {len(text)} characters, expected at most "
                f"{LONGEST_TEXT}, all of them printable",
            )
        before = self._text(source, now, person)
        self._texts[of] = (text, now + source.stale_after_s)
        return text != before

    def _measured(self, source: SourceSpec, message: Message, now: float) -> Reading:
        confidence = _confidence(source, message)
        raw = _evaluated(source, source.field, message)
        std = _std(source, message)
        if source.table:
            value = _in_table(source, raw)
        else:
            reading = _number(source, raw)
            value = mapped(source.points, reading)
            std = mapped_std(source.points, reading, std) if std and source.points else std
        parameter = self._parameters.get(source)
        if parameter is not None:
            check_value(parameter, value, what=f"reading of {source.topic}")
        return Reading(
            value=value,
            at=now,
            stale_at=now + source.stale_after_s,
            std=std,
            confidence=confidence,
            source=source.topic,
        )


def _evaluated(source: SourceSpec, expression: Expression, message: Message) -> object:
    skip = len(MESSAGE) + 1

    def known(name: str) -> object:
        value = message(name[skip:])
        if isinstance(value, float) and math.isnan(value):
            raise _NanFieldError(name)
        return value

    try:
        try:
            return expression.evaluate(known)
        except _NanFieldError:
            # Without an 'else', the NaN itself is used, and its use reports the problem.
            return expression.evaluate(lambda name: message(name[skip:]))
    except MissingValue:
        raise _NotMeasuredError from None
    except Refused as refused:
        if refused.code == RefusalCode.NO_SUCH_ITEM:
            raise _NotMeasuredError from None
        raise
    except EvaluationError as error:
        raise Refused(
            RefusalCode.NOT_COMPUTABLE,
            f"reading of {source.topic}: {expression.text}: {error.message}",
        ) from None


def _confidence(source: SourceSpec, message: Message) -> float:
    if source.confidence is None:
        return 1.0
    raw = _evaluated(source, source.confidence, message)
    if isinstance(raw, bool | int | float) and 0.0 <= raw <= 1.0 + _ROUNDING:
        if raw == 0.0:
            raise _NotMeasuredError
        return min(float(raw), 1.0)
    raise Refused(
        RefusalCode.OUT_OF_RANGE,
        f"reading of {source.topic}: the confidence {source.confidence.text} is {described(raw)}, "
        "expected 0 to 1",
    )


def _std(source: SourceSpec, message: Message) -> float:
    if source.std is None:
        return 0.0
    raw = _evaluated(source, source.std, message)
    if isinstance(raw, int | float) and 0.0 <= raw <= LARGEST_STD:
        return float(raw)
    raise Refused(
        RefusalCode.OUT_OF_RANGE,
        f"reading of {source.topic}: the standard deviation {source.std.text} is "
        f"{described(raw)}, expected 0 or more",
    )


def _number(source: SourceSpec, raw: object) -> float:
    what = f"reading of {source.topic}"
    if not isinstance(raw, bool | int | float):
        raise Refused(
            RefusalCode.NOT_A_NUMBER,
            f"{what}: {source.field.text} is a {type(raw).__name__}, "
            "expected a number or a boolean; name another field in scene.yaml",
        )
    try:
        reading = float(raw)
    except OverflowError:
        reading = math.inf
    if not math.isfinite(reading):
        raise Refused(
            RefusalCode.NOT_FINITE,
            f"{what}: {source.field.text} is {reading}, expected a finite number",
        )
    return reading


def _in_table(source: SourceSpec, raw: object) -> float:
    word = _table_key(raw)
    wanted = None if word is None else folded(word)
    for known, value in source.table:
        if folded(known) == wanted:
            return value
    if word == "":
        raise _NotMeasuredError
    raise Refused(
        RefusalCode.UNKNOWN_WORD,
        f"reading of {source.topic}: {source.field.text} is {described(raw)}, expected one of "
        f"{', '.join(known for known, _ in source.table)[:200]}; add it to 'table' in scene.yaml",
    )


def _table_key(raw: object) -> str | None:
    """Return a value as the key of a table; None if it cannot be a key."""
    match raw:
        case bool():
            return str(raw).lower()
        case str():
            return raw
        case int() | float():
            return word_of(raw)
    return None
