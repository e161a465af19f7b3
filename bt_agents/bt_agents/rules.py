# SPDX-License-Identifier: Apache-2.0
"""Mood rules: which condition, held how long during a run, becomes feedback by itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bt_agents import mood
from bt_agents.errors import Refused
from bt_agents.feedback import Kind
from bt_agents.language.expression.expressions import (
    EvaluationError,
    Expression,
    ExpressionError,
    MissingValue,
    parse_expression,
)
from bt_agents.live import LEASE_S
from bt_agents.scene import Scene, SceneSpace


@dataclass(frozen=True, kw_only=True)
class Rule:
    """What a change of mood during a run teaches the agent.

    Attributes:
        text: Condition as the author wrote it.
        condition: The same, parsed.
        hold_s: How long it must hold without a break [s].
        kind: ``POSITIVE`` or ``NEGATIVE``.
        cancel: True also stops the run and lets the market ask again.
    """

    text: str
    condition: Expression
    hold_s: float
    kind: Kind
    cancel: bool


@dataclass(frozen=True, kw_only=True)
class Fired:
    """A rule whose condition has held long enough.

    Attributes:
        rule: The rule.
        index: Its place among the rules of the run, from 0.
        reason: Condition, time and mood in words.
        live: The live scene that it fired on.
    """

    rule: Rule
    index: int
    reason: str
    live: Scene


def read_rule(text: str, hold_s: float, give: int, cancel: bool, space: SceneSpace) -> Rule:
    """Check one rule of a host's card.

    Args:
        text: Condition over ``mood.change``, ``scene.*`` and ``live.*``.
        hold_s: How long it must hold [s]; finite, not negative.
        give: ``Kind.POSITIVE`` or ``Kind.NEGATIVE``.
        cancel: Whether it stops the run.
        space: The parameters that the condition may name.

    Raises:
        Refused: ``BAD_RULE``.
    """
    if not (math.isfinite(hold_s) and hold_s >= 0.0):
        raise Refused("BAD_RULE", f"rule '{text}': held {hold_s} s, expected 0 s or more")
    if give not in (Kind.POSITIVE, Kind.NEGATIVE):
        raise Refused("BAD_RULE", f"rule '{text}': gives {give}, expected 1 or 2")
    known = _names(space)
    try:
        condition = parse_expression(text, known=known.__contains__)
    except ExpressionError as error:
        raise Refused(
            "BAD_RULE", f"rule '{text}': {error}; it may name {', '.join(sorted(known))}"
        ) from None
    if not isinstance(_sample(condition, space), bool):
        raise Refused("BAD_RULE", f"rule '{text}': no condition; compare, as in 'live.mood < 2'")
    return Rule(text=text, condition=condition, hold_s=hold_s, kind=Kind(give), cancel=cancel)


class Watch:
    """Watches the rules of one run; each fires at most once, none after one that cancels.

    Between two live scenes the last one counts, so a hold can complete while nothing arrives. A
    longer silence than the lease means that nothing is known any more: what has held until then
    has to hold anew for its whole time after it.

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
        self._rules = tuple(rules)
        self._awarded = awarded
        self._space = space
        self._clock = clock
        self._not_before = clock() + settle_s
        self.lease_s = lease_s
        self._mood = mood.at_start(awarded, space)
        self._live: Scene | None = None
        self._live_at = clock()
        self._since: dict[int, float] = {}
        self._done: set[int] = set()

    @property
    def over(self) -> bool:
        """True when no rule can fire any more."""
        return len(self._done) == len(self._rules)

    @property
    def due(self) -> float:
        """When the next rule fires if nothing changes [s]; infinite when none holds."""
        return min(
            (
                max(since + self._rules[index].hold_s, self._not_before)
                for index, since in self._since.items()
                if index not in self._done
            ),
            default=math.inf,
        )

    def see(self, live: Scene) -> tuple[Fired, ...]:
        """Take a new live scene and return the rules that fire, in their order."""
        fired = self.tick()
        self._live = live
        self._live_at = self._clock()
        self._mood = mood.seen(self._mood, live, self._space)
        return fired + self.tick()

    def tick(self) -> tuple[Fired, ...]:
        """Return the rules that fire because time has passed, in their order."""
        now = self._clock()
        if self._live is None or now < self._not_before:
            return ()
        if now - self._live_at > self.lease_s:
            self._since.clear()
            return ()
        fired = []
        for index, rule in enumerate(self._rules):
            if index in self._done:
                continue
            if not self._holds(rule):
                self._since.pop(index, None)
            elif now - self._since.setdefault(index, now) >= rule.hold_s:
                self._done.add(index)
                fired.append(
                    Fired(rule=rule, index=index, reason=self._reason(rule), live=self._live)
                )
        if any(one.rule.cancel for one in fired):
            self._done.update(range(len(self._rules)))
        return tuple(fired)

    def _holds(self, rule: Rule) -> bool:
        try:
            return rule.condition.evaluate(self._lookup) is True
        except (MissingValue, EvaluationError):
            return False

    def _lookup(self, name: str) -> object:
        if name == "live.stale":
            return False
        if name == "mood.change":
            value = self._mood.change
        else:
            group, _, parameter = name.partition(".")
            scene = self._live if group == "live" else self._awarded
            if scene is None:
                raise MissingValue(name)
            if parameter == "person":
                return scene.person
            value = scene.get(parameter)
        if math.isnan(value):
            raise MissingValue(name)
        return value

    def _reason(self, rule: Rule) -> str:
        reason = f"{rule.text} held {rule.hold_s:g} s"
        if not math.isnan(self._mood.change):
            reason += f": mood {self._mood.start:.4g} → {self._mood.now:.4g}"
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
