# SPDX-License-Identifier: Apache-2.0
"""Mood rules: which condition, held how long during a run, becomes feedback by itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.live_scene_view import LEASE_S
from bt_agents_core.mood import Addressee, Mood
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_language.expression.expressions import (
    EvaluationError,
    Expression,
    ExpressionError,
    MissingValue,
    parse_expression,
)

LEAST_AGAIN_S = 1.0
"""A rule that may fire again does so after this at the earliest, whatever its cooldown [s]."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """What a change of mood during a run teaches the agent.

    Attributes:
        text: Condition as the author wrote it.
        condition: The same, parsed.
        hold_s: How long it must hold without a break [s].
        kind: ``POSITIVE`` or ``NEGATIVE``.
        cancel: True also stops the run and lets the market ask again.
        baseline_s: ``mood.change`` is against the mean of so long at the start [s]; 0 for the
            scene as awarded.
        release: Condition after which a rule that has fired is ready again; None for none.
        cooldown_s: A rule that has fired is ready again after so long at the earliest [s].
        confidence: Moods with less confidence are not known, 0..1.
    """

    text: str
    condition: Expression
    hold_s: float
    kind: FeedbackKind
    cancel: bool
    baseline_s: float = 0.0
    release: Expression | None = None
    cooldown_s: float = 0.0
    confidence: float = 0.0

    @property
    def again(self) -> bool:
        """True when it can fire more than once a run."""
        return self.release is not None or self.cooldown_s > 0.0


@dataclass(frozen=True, kw_only=True)
class Fired:
    """A rule whose condition has held long enough.

    Attributes:
        rule: The rule.
        index: Its place among the rules of the run, from 0.
        count: How often it had fired before in this run.
        since: When its condition began to hold, on the steady clock [s].
        reason: Condition, time and mood in words.
        live: The live scene that it fired on.
    """

    rule: Rule
    index: int
    count: int = 0
    since: float
    reason: str
    live: Scene


def read_rule(
    text: str,
    hold_s: float,
    give: int,
    cancel: bool,
    space: SceneSpace,
    *,
    baseline_s: float = 0.0,
    release: str = "",
    cooldown_s: float = 0.0,
    confidence: float = 0.0,
) -> Rule:
    """Check one rule of a host's card; the values are those of ``MoodRule.msg``.

    Args:
        text: Condition over ``mood.change``, ``scene.*`` and ``live.*``.
        hold_s: How long it must hold [s]; finite, not negative.
        give: ``Kind.POSITIVE`` or ``Kind.NEGATIVE``.
        cancel: Whether it stops the run.
        space: The parameters that the condition may name.
        baseline_s: Length of the baseline [s]; finite, not negative.
        release: Condition after which it is ready again; empty for none.
        cooldown_s: It is ready again after so long [s]; finite, not negative.
        confidence: The least confidence of a mood, 0..1.

    Raises:
        Refused: ``BAD_RULE``.
    """
    for seconds, words in (
        (hold_s, "held"),
        (baseline_s, "a baseline of"),
        (cooldown_s, "a cooldown of"),
    ):
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise Refused("BAD_RULE", f"rule '{text}': {words} {seconds} s, expected 0 s or more")
    if not 0.0 <= confidence <= 1.0:
        raise Refused("BAD_RULE", f"rule '{text}': confidence {confidence}, expected 0 to 1")
    if give not in (FeedbackKind.POSITIVE, FeedbackKind.NEGATIVE):
        raise Refused("BAD_RULE", f"rule '{text}': gives {give}, expected 1 or 2")
    return Rule(
        text=text,
        condition=_condition(text, text, space),
        hold_s=hold_s,
        kind=FeedbackKind(give),
        cancel=cancel,
        baseline_s=baseline_s,
        release=_condition(release, text, space) if release else None,
        cooldown_s=cooldown_s,
        confidence=confidence,
    )


def _condition(text: str, rule: str, space: SceneSpace) -> Expression:
    known = _names(space)
    try:
        condition = parse_expression(text, known=known.__contains__)
    except ExpressionError as error:
        raise Refused(
            "BAD_RULE", f"rule '{rule}': {error}; it may name {', '.join(sorted(known))}"
        ) from None
    if not isinstance(_sample(condition, space), bool):
        raise Refused(
            "BAD_RULE", f"rule '{rule}': '{text}' is no condition; compare, as in 'live.mood < 2'"
        )
    return condition


class _Watched:
    """One rule during a run: since when it holds, and whether it is ready.

    Attributes:
        since: When its condition began to hold [s]; None while it does not.
        count: How often it has fired.
        done: True when it fires no more.
    """

    def __init__(self, rule: Rule, mood: Mood) -> None:
        self.rule = rule
        self.mood = mood
        self.since: float | None = None
        self.count = 0
        self.done = False
        self._released = True
        self._ready_at = -math.inf

    def due(self, now: float) -> float:
        """Return when it does something if nothing changes [s]; infinite for never."""
        if self.done:
            return math.inf
        if self.since is not None:
            return min(self.since + self.rule.hold_s, self.mood.due)
        return min(self._ready_at if self._ready_at > now else math.inf, self.mood.due)

    def fires(self, now: float, holds: Callable[[Expression], bool]) -> float | None:
        """Return since when the condition has held, when that is long enough; else None."""
        rule = self.rule
        if not self._released and rule.release is not None:
            self._released = holds(rule.release)
        if not self._released or now < self._ready_at or not holds(rule.condition):
            self.since = None
            return None
        since = self.since = now if self.since is None else self.since
        if now - since < rule.hold_s:
            return None
        self.since = None
        self.count += 1
        self.done = not rule.again
        self._released = rule.release is None
        self._ready_at = now + max(rule.cooldown_s, LEAST_AGAIN_S)
        return since


class Watch:
    """Watches the rules of one run; none fires after one that cancels.

    Between two live scenes the last one counts, so a hold can complete while nothing arrives. A
    longer silence than the lease means that nothing is known any more: what has held until then
    has to hold anew for its whole time after it. A live scene that is about another person than
    the run says that nobody is there.

    Attributes:
        lease_s: A live scene counts for so long after it has come [s].
    """

    def __init__(
        self,
        rules: Iterable[Rule],
        awarded: Scene,
        space: SceneSpace,
        clock: Callable[[], float],
        settle_s: float = 0.0,
        lease_s: float = LEASE_S,
    ) -> None:
        """Start watching.

        Args:
            rules: Rules of the agent that runs.
            awarded: Scene as awarded.
            space: The scene parameters.
            clock: Steady time [s].
            settle_s: No rule holds during this time, so that a run which is only being replayed
                can turn out to be over [s].
            lease_s: A live scene counts for so long after it has come [s].
        """
        self._rules = tuple(
            _Watched(
                rule,
                Mood(
                    awarded,
                    space,
                    clock,
                    baseline_s=rule.baseline_s,
                    confidence=rule.confidence,
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

    @property
    def over(self) -> bool:
        """True when no rule can fire any more."""
        return all(one.done for one in self._rules)

    @property
    def due(self) -> float:
        """When a rule fires or becomes ready if nothing changes [s]; infinite for never."""
        now = self._clock()
        due = min((one.due(now) for one in self._rules), default=math.inf)
        return max(due, self._not_before)

    def see(self, live: Scene) -> tuple[Fired, ...]:
        """Take a new live scene and return the rules that fire, in their order."""
        fired = self.tick()
        self._live = self._addressee.seen(live)
        self._live_at = self._clock()
        for one in self._rules:
            one.mood.see(self._live)
        return fired + self.tick()

    def tick(self) -> tuple[Fired, ...]:
        """Return the rules that fire because time has passed, in their order."""
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
        if any(one.rule.cancel for one in fired):
            for one in self._rules:
                one.done = True
        return tuple(fired)

    def _fired(self, index: int, one: _Watched, live: Scene, now: float) -> Fired | None:
        def lookup(name: str) -> object:
            return self._value(name, one.mood, live)

        def holds(condition: Expression) -> bool:
            try:
                return condition.evaluate(lookup) is True
            except (MissingValue, EvaluationError):
                return False

        since = one.fires(now, holds)
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

    def _value(self, name: str, mood: Mood, live: Scene) -> object:
        if name == "live.stale":
            return False
        group, _, parameter = name.partition(".")
        if parameter == "person":
            return live.person if group == "live" else self._awarded.person
        if name == "mood.change":
            value = mood.change
        elif group == "scene":
            value = self._awarded.get(parameter)
        elif parameter == self._space.mood:
            value = mood.now
        else:
            value = live.observed[self._space.names.index(parameter)]
        if math.isnan(value):
            raise MissingValue(name)
        return value


def _reason(one: _Watched) -> str:
    reason = f"{one.rule.text} held {one.rule.hold_s:g} s"
    if not math.isnan(one.mood.change):
        reason += f": mood {one.mood.start:.4g} → {one.mood.now:.4g}"
    return reason


def _sample(condition: Expression, space: SceneSpace) -> object:
    """Return the value for an ordinary scene, which shows the type; None when it has none."""
    values: dict[str, object] = dict.fromkeys(_names(space), 1.0)
    for group in ("scene", "live"):
        values |= {f"{group}.{p.name}": p.default for p in space.parameters}
        values[f"{group}.person"] = True
    values["live.stale"] = False
    try:
        return condition.evaluate(values.__getitem__)
    except EvaluationError:
        return None


def _names(space: SceneSpace) -> frozenset[str]:
    names = {f"{group}.{name}" for group in ("scene", "live") for name in (*space.names, "person")}
    mood_names = {"mood.change"} if space.mood is not None else set()
    return frozenset(names | {"live.stale"} | mood_names)
