# SPDX-License-Identifier: Apache-2.0
"""Whether scripted visits reach a run: measured values, changes of its scene, pressed buttons."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from bt_agents_core.liveness import extended_lease
from bt_agents_core.text import join_words, quote
from bt_agents_language.model.specs import SceneChange, Visit

EFFECT_S = 2.0
"""Longest time from a change until the live scene shows it [s]."""


@dataclass(kw_only=True)
class _Made:
    change: SceneChange
    label: str
    before: Mapping[str, float]
    at: float


class ChangeEffects:
    """Changes that the live scene has not shown yet."""

    def __init__(self) -> None:
        self._made: list[_Made] = []
        self._values: Mapping[str, float] = {}
        self._polled_at = 0.0

    @property
    def pending(self) -> bool:
        """Whether a change may still show."""
        return bool(self._made)

    def made(self, change: SceneChange, label: str, now: float) -> None:
        """Expect a change in the visit with a label, from steady time ``now`` [s] on."""
        one = _Made(change=change, label=label, before=dict(self._values), at=now)
        if not self._made:
            self._polled_at = now
        self._made.append(one)

    def live(self, values: Mapping[str, float], person: bool) -> None:
        """Take a live scene; a source that smooths its readings follows a change slowly."""
        self._values = values
        self._made = [one for one in self._made if not self._shows(one, person)]

    def missing(self, now: float) -> list[str]:
        """Return in words the changes that had no effect, each once."""
        polled_at, self._polled_at = self._polled_at, now
        for one in self._made:
            one.at = extended_lease(one.at, EFFECT_S, polled_at, now)
        late = [one for one in self._made if now - one.at >= EFFECT_S]
        self._made = [one for one in self._made if now - one.at < EFFECT_S]
        reason = f"the live scene has not shown it within {EFFECT_S:g} s"
        return [f"{one.label}: {change_text(one.change)} had no effect: {reason}" for one in late]

    def _shows(self, one: _Made, person: bool) -> bool:
        if one.change.person is not None and person != one.change.person:
            return False
        return all(
            self._values.get(name) == value or self._values.get(name) != one.before.get(name)
            for name, value in one.change.values.items()
        )


def unmade_text(change: SceneChange, label: str, *, started: bool) -> str:
    """Return in words that a change was not made, because its visit was over."""
    reason = "the visit was over by then" if started else "no run of the visit has started"
    return f"{label}: {change_text(change)} had no effect: {reason}"


def unmeasured_text(visit: Visit, measured: Collection[str], person_id: str) -> str:
    """Return in words which values of a visit nothing measures; empty if there is none.

    Args:
        visit: It has just begun.
        measured: Parameters that the sensors measure of its person.
        person_id: Id of this person; not every id can be part of a topic.
    """
    lost = [name for name in visit.values if name not in measured]
    if not lost:
        return ""
    whom = f" of {quote(person_id)}" if person_id else ""
    reason = f"no source of scene.yaml can measure it{whom}"
    return f"{visit.label}: {join_words(lost)} had no effect: {reason}"


def change_text(change: SceneChange) -> str:
    """Return a change in words, as in ``mood 1.5 after 3 s``."""
    parts = [f"{name} {value:g}" for name, value in change.values.items()]
    if change.person is not None:
        parts.append("coming" if change.person else "leaving")
    return f"{', '.join(parts)} after {change.after_s:g} s"


class ButtonPresses:
    """Buttons that a visitor will press.

    A ``wait_for`` listens only while it runs, and may start after the words that name a button.
    """

    def __init__(self) -> None:
        self._planned: dict[str, float] = {}

    def plan(self, topic: str, at: float) -> None:
        """Plan to press a button at a time [s]; an already planned one keeps its time."""
        self._planned.setdefault(topic, at)

    def due(self, now: float, listens: Callable[[str], bool]) -> list[str]:
        """Return the topics of the buttons to press now, once each; others wait for a listener."""
        topics = [topic for topic, at in self._planned.items() if now >= at and listens(topic)]
        for topic in topics:
            del self._planned[topic]
        return topics

    def give_up(self, now: float) -> list[str]:
        """Forget all buttons; return the topics of those without a listener in time."""
        missed = [topic for topic, at in self._planned.items() if now >= at]
        self._planned.clear()
        return missed
