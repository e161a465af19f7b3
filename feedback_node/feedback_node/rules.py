# SPDX-License-Identifier: Apache-2.0
"""Evaluates mood rules during a run: when each of them fires on the live scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.mood import Addressee, Mood
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.expression.name_resolution import SceneFacts, resolve, surely_true
from bt_agents_language.model.mood_rule import MoodRule

MIN_REPEAT_S = 1.0
"""Shortest time between two firings of a rule, whatever its cooldown [s]."""


@dataclass(frozen=True, kw_only=True)
class Fired:
    """Firing of a mood rule whose condition has held long enough.

    Attributes:
        index: Position among the rules of the run, from 0.
        count: Number of earlier firings in this run.
        since: When its condition began to hold, on the steady clock [s].
        reason: Text with the condition, its time and the mood.
    """

    rule: MoodRule
    index: int
    count: int = 0
    since: float
    reason: str
    live: Scene


class _Watched:
    """State of one mood rule during a run; its condition has held since ``since`` [s].

    It is ``undecided`` once its condition was neither true nor false.
    """

    def __init__(self, rule: MoodRule, mood: Mood) -> None:
        self.rule = rule
        self.mood = mood
        self.since: float | None = None
        self.count = 0
        self.done = False
        self.undecided = False
        self._released = True
        self._ready_at = -math.inf

    def due(self, now: float) -> float:
        """Return the time of the next event if nothing changes [s]; infinite for none."""
        if self.done:
            return math.inf
        if self.since is not None:
            return min(self.since + self.rule.hold_s, self.mood.due)
        return min(self._ready_at if self._ready_at > now else math.inf, self.mood.due)

    def fires(self, now: float, holds: Callable[[Expression], bool]) -> float | None:
        """Return since when the condition has held if that is long enough, else None."""
        rule = self.rule
        if not self._released and rule.release is not None:
            self._released = holds(rule.release)
        if not self._released or now < self._ready_at or not holds(rule.when):
            self.since = None
            return None
        since = self.since = now if self.since is None else self.since
        if now - since < rule.hold_s:
            return None
        self.since = None
        self.count += 1
        self.done = not rule.repeats
        self._released = rule.release is None
        self._ready_at = now + max(rule.cooldown_s, MIN_REPEAT_S)
        return since


class Watch:
    """Evaluates the mood rules of one run; none fires after one that ends it.

    Between two live scenes the last one counts, so a hold can complete while nothing arrives. A
    silence longer than the lease means that nothing is known: conditions must then hold again for
    their whole time. A live scene about another person than in the run counts as a scene
    without a person.

    Args:
        clock: Steady time [s].
        settle_s: No rule holds for this time, so that a replayed run can turn out to be over [s].

    Attributes:
        lease_s: How long a live scene counts after its arrival [s].
    """

    def __init__(
        self,
        rules: Iterable[MoodRule],
        awarded: Scene,
        space: SceneSpace,
        clock: Callable[[], float],
        settle_s: float = 0.0,
        lease_s: float = LIVE_LEASE_S,
    ) -> None:
        self._rules = tuple(
            _Watched(
                rule,
                Mood(
                    awarded, space, clock, baseline_s=rule.baseline_s, confidence=rule.confidence
                ),
            )
            for rule in rules
        )
        self._awarded = awarded
        self._space = space
        self._clock = clock
        self._not_before = clock() + settle_s
        self.lease_s = lease_s
        self._live: Scene | None = None
        self._live_at = clock()
        self._addressee = Addressee(awarded)
        self._undecided: list[str] = []

    @property
    def over(self) -> bool:
        """True when no rule can fire any more."""
        return all(one.done for one in self._rules)

    @property
    def due(self) -> float:
        """Time when a rule fires or is ready if nothing changes [s]; infinite for none."""
        now = self._clock()
        due = min((one.due(now) for one in self._rules), default=math.inf)
        return max(due, self._not_before)

    def receive(self, live: Scene) -> tuple[Fired, ...]:
        """Handle a live scene; return the rules that fire, in order."""
        fired = self.tick()
        self._live = self._addressee.mask(live)
        self._live_at = self._clock()
        for one in self._rules:
            one.mood.receive(self._live)
        return fired + self.tick()

    def take_undecided(self) -> tuple[str, ...]:
        """Return the rules that could not be decided, each once per run, with the reason."""
        taken = tuple(self._undecided)
        self._undecided.clear()
        return taken

    def tick(self) -> tuple[Fired, ...]:
        """Return the rules that fire because time has passed, in order."""
        now = self._clock()
        if self._live is None:
            return ()
        for one in self._rules:
            one.mood.tick()
        if now < self._not_before:
            return ()
        if now - self._live_at > self.lease_s:
            for one in self._rules:
                one.since = None
                one.mood.forget()
            return ()
        fired = [
            found
            for index, one in enumerate(self._rules)
            if not one.done and (found := self._fired(index, one, self._live, now)) is not None
        ]
        if any(one.rule.action.ends_run for one in fired):
            for one in self._rules:
                one.done = True
        return tuple(fired)

    def _fired(self, index: int, one: _Watched, live: Scene, now: float) -> Fired | None:
        try:
            since = one.fires(
                now, lambda condition: surely_true(condition, self._names(one, live))
            )
        except Undecided as undecided:
            one.since = None
            if not one.undecided:
                one.undecided = True
                self._undecided.append(f"the mood rule {undecided}")
            return None
        if since is None:
            return None
        return Fired(
            rule=one.rule,
            index=index,
            count=one.count - 1,
            since=since,
            reason=_reason(one),
            live=live,
        )

    def _names(self, one: _Watched, live: Scene) -> Callable[[str], object]:
        """Return the lookup of names for a rule, which counts only measured and given values."""
        values = dict(zip(self._space.names, live.observed, strict=True))
        if self._space.mood is not None:
            values[self._space.mood] = one.mood.now
        seen = SceneFacts(person=live.person, values=values)
        return partial(
            resolve, scene=self._awarded, live=lambda: seen, mood_change=lambda _: one.mood.change
        )


def _reason(one: _Watched) -> str:
    reason = f"{one.rule.when.text} held {one.rule.hold_s:g} s"
    if not math.isnan(one.mood.change):
        reason += f": mood {one.mood.start:.4g} → {one.mood.now:.4g}"
    return reason
