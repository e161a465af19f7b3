# SPDX-License-Identifier: Apache-2.0
"""Rehearsal of an agent: its real tree on a virtual clock that jumps to the next event."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine.context import RunContext
from bt_agents.engine.environment import Environment, SkillGoal
from bt_agents.engine.node_errors import LocatedReason
from bt_agents.engine.run import Run, RunResult, StatusChange, TreeOutcome
from bt_agents.engine.scope import RunScope, format_value
from bt_agents.host.agent_registry import decline_of
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.liveness import LIVE_LEASE_S
from bt_agents_core.local_time import next_hour_s
from bt_agents_core.person_facts import Fact, from_message_fields
from bt_agents_core.scene import SceneSpace
from bt_agents_core.stop_cause import Cancellation, StopCause, StoppedBy, stopper
from bt_agents_language.files.testing.path_patterns import branches_of, matches, nodes_of
from bt_agents_language.files.testing.scenarios import (
    Scenario,
    ScriptedAnswer,
    ScriptedEvent,
    VariantRule,
)
from bt_agents_language.model.mood_rule import MoodAction
from bt_agents_language.model.specs import AgentSpec, NodeSpec
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.node_type import Mark, Waits
from bt_agents_language.nodes.remember import BINDING as REMEMBER
from bt_agents_tools.rehearsal.answers import Answers, AnswerSource
from bt_agents_tools.rehearsal.event_order import EventOrder
from bt_agents_tools.rehearsal.events import Event, EventKind, Rehearsed, Use
from bt_agents_tools.rehearsal.instrument import replaced, with_open_bindings, with_replacements
from bt_agents_tools.rehearsal.rehearsal_environment import RehearsalEnvironment
from bt_agents_tools.rehearsal.rehearsal_scenes import RehearsedLiveScene, awarded, change_text
from bt_agents_tools.rehearsal.tick_analysis import add_marks, at_rest, limit_of, running_leaves
from bt_agents_tools.rehearsal.transcript import time_text, tuned_text
from feedback_node.rules import Watch

TICK_S = 0.1
"""Time between ticks while each of them does something, as on the robot [s]."""

LIVE_SCENE_S = LIVE_LEASE_S / 2
"""Time between live scenes while a mood rule waits [s]."""

_NUDGE_S = 1e-6
"""Advance of the clock if a sum of times falls short by a rounding error [s]."""

Prompt = Callable[[str, Sequence[NodeSpec]], ScriptedEvent | None]
"""Function that asks a person for an event while a tree waits, given the reason and waiting nodes.

None means no event: then a time limit runs out, or if there is none, the rehearsal ends.
"""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits for a rehearsal that does not end by itself; the time is virtual [s]."""

    duration_s: float = 24 * 3600.0
    ticks: int = 20_000


def rehearse(
    agent: AgentSpec,
    space: SceneSpace,
    scenario: Scenario,
    *,
    on_event: Callable[[Event], None] | None = None,
    answer_source: AnswerSource | None = None,
    prompt: Prompt | None = None,
    limits: Limits | None = None,
    force: bool = False,
) -> Rehearsed:
    """Rehearse an interaction.

    ``on_event`` takes every event at once, ``answer_source`` answers skills in place of the
    script, and ``prompt`` asks for an event when the tree waits for one that is not scripted. With
    ``force``, the tree runs even if the agent does not bid for the scene.
    """
    limits = limits or Limits()
    return _Rehearsal(agent, space, scenario, on_event, answer_source, prompt, limits).run(force)


class _Rehearsal:
    """Run of an agent's tree, with the agenda of scripted events."""

    def __init__(
        self,
        agent: AgentSpec,
        space: SceneSpace,
        scenario: Scenario,
        on_event: Callable[[Event], None] | None,
        answer_source: AnswerSource | None,
        prompt: Prompt | None,
        limits: Limits,
    ) -> None:
        agent = with_replacements(agent, scenario.replace)
        self._agent = agent
        self._nodes = {node.path: node for node in nodes_of(agent)}
        resources = [type_of(one).resources(one) for one in self._nodes.values()]
        self._latched = {one.topic[0] for one in resources if one.latched and one.topic}
        self._replacements = scenario.replace
        self._on_event = on_event
        self._answer_source = answer_source
        self._prompt = prompt
        self._not_prompted: set[str] = set()
        self._limits = limits
        self._events: list[Event] = []
        self._told: dict[str, float] = {}
        self._remembered: dict[str, Fact] = {}
        # Events of a tick are held until the tick is published, each with the number of
        # changes before it.
        self._held: list[tuple[int, Event]] | None = None
        self._published = 0
        self._events_of_tick = EventOrder(self._nodes)
        self._ticked: list[tuple[Behaviour, Status]] = []
        self._marks: dict[str, set[Mark]] = {}
        self._feedback_given: list[FeedbackKind] = []
        self._undecided_rules: list[str] = []
        self._cancelled_by = ""
        self._order = itertools.count()
        self._agenda: list[tuple[float, int, ScriptedEvent]] = []
        self._awaited = [one for one in scenario.during if one.at]
        self._environment = RehearsalEnvironment(
            self._nodes,
            Answers(scenario.answers),
            ask=self._question,
            on_event=self._publish,
            on_feedback=self._feedback,
            tell_scene_layer=self._tell_scene_layer,
            begin=scenario.clock,
        )
        self._clock = self._environment.clock
        self._scene = awarded(space, scenario)
        self._live = RehearsedLiveScene(space, self._scene, self._clock)
        self._tunables: dict[str, Plain] = {one.name: one.default for one in agent.tunables}
        self._tunables |= scenario.tunables
        self._run = Run(
            with_open_bindings(agent),
            space=space,
            scene=self._scene,
            profile=agent.profile,
            live=self._live.now,
            tunables=self._tunables,
            environment=self._environment,
            steady=self._clock,
            random=Random(scenario.seed),
            context=partial(RehearsalContext, picks=scenario.picks, variants=scenario.variants),
            on_visit=lambda node, status: self._ticked.append((node, status)),
        )
        self._watch = Watch(agent.rules, self._scene, space, self._clock)
        decline = decline_of(agent.requires, self._scene, lambda: scenario.clock)
        self._declined = decline.reason if decline is not None else ""
        for one in scenario.during:
            if not one.at:
                self._schedule(one, one.after_s)

    def run(self, force: bool) -> Rehearsed:
        """Run the tree to its end."""
        if self._declined and not force:
            return self._rehearsed(None, f"the agent does not bid, it {self._declined}")
        message = ""
        while not message:
            self._apply_due()
            self._tick()
            result = self._run.result
            if result is not None:
                succeeded = result.outcome is TreeOutcome.SUCCEEDED and not result.orphans
                message = self._reason(result)
                return self._rehearsed(result.outcome, message, worth_reporting=not succeeded)
            message = self._move_on()
        return self._rehearsed(None, message)

    def _reason(self, result: RunResult) -> str:
        """Return the reason of the end, with the failed node."""
        text = result.message
        tip = self._nodes.get(result.tip)
        located = isinstance(text, LocatedReason)
        if result.outcome is TreeOutcome.FAILED and tip is not None and not located:
            text += f" ({tip.path}, {tip.position})"
        if result.orphans:
            text += f" (still under way: {', '.join(result.orphans)})"
        return text

    def _tick(self) -> None:
        self._environment.active = self._environment.told_time = False
        self._environment.report_ended()
        self._held = []
        self._published = 0
        self._ticked.clear()
        changes = self._run.tick()
        self._environment.report_ended()
        add_marks(self._ticked, self._marks)
        self._publish_changes(changes)
        self._held = None
        active = bool(changes) or self._environment.active
        self._rests = not active and at_rest(self._ticked, self._run.deadlines)

    def _move_on(self) -> str:
        """Advance the clock to the next event; return why there is none, or an empty text."""
        now = self._clock.now
        if now > self._limits.duration_s or self._run.ticks > self._limits.ticks:
            return (
                f"it still runs after {time_text(now)} and {self._run.ticks:,} ticks; give it an "
                "end, or cancel it under 'during'"
            )
        while True:
            moments = [self._environment.next_change, self._run.deadline]
            moments += [max(at, now + _NUDGE_S) for at in self._run.deadlines.values()]
            moments += [self._agenda[0][0]] if self._agenda else []
            moments += [next_hour_s(now)] if self._environment.told_time else []
            if not self._rests:
                moments.append(round(now + TICK_S, 6))
            then = min(moments)
            event = self._prompt_while_waiting(then)
            if event is not None:
                self._schedule(event, now + event.after_s)
                continue
            due = min(self._watch.due, self._polled_at + LIVE_SCENE_S)
            if self._watch.due < math.inf and due < then:
                # Only a mood rule waits, and that does not change the tree.
                now = self._clock.now = max(due, now + _NUDGE_S)
                if self._poll_mood_rules():
                    return ""
                continue
            if then < math.inf:
                self._clock.now = max(then, now)
                return ""
            return self._endless_reason()

    def _endless_reason(self) -> str:
        leaves = running_leaves(self._ticked)
        waiting = "; ".join(f"{one.path}, {one.position}" for one in leaves)
        return f"it waits for ever: nothing more will happen ({waiting})"

    def _prompt_while_waiting(self, until: float) -> ScriptedEvent | None:
        """Return the event that a person enters while the tree only waits; None for none."""
        announced = bool(self._agenda) or min(self._watch.due, self._run.deadline) < math.inf
        if self._prompt is None or not self._rests or announced:
            return None
        leaves = running_leaves(self._ticked)
        waits = [one for one in leaves if type_of(one).waits is Waits.EVENT]
        if until == math.inf:
            reason = self._endless_reason()
        elif all(one.path in self._not_prompted for one in waits):
            return None
        else:
            limit = min(limit_of(one, self._run.deadlines) for one in waits)
            reason = f"it waits: {', '.join(one.name for one in waits)}"
            if limit < math.inf:
                reason += f", {time_text(limit - self._clock.now)} at most"
        event = self._prompt(reason, waits)
        if event is None:
            self._not_prompted |= {one.path for one in waits}
        return event

    def _schedule(self, event: ScriptedEvent, at: float) -> None:
        heapq.heappush(self._agenda, (at, next(self._order), event))

    def _apply_due(self) -> None:
        """Apply the scripted events that are due, then poll the mood rules."""
        while self._agenda and self._agenda[0][0] <= self._clock.now:
            _, _, one = heapq.heappop(self._agenda)
            if one.values or one.person is not None or one.silent is not None:
                self._live.change(one)
                if one.silent:
                    # The end of the lease ticks the tree, even if it only waits.
                    lease_end = self._clock.now + LIVE_LEASE_S + _NUDGE_S
                    self._schedule(ScriptedEvent(after_s=0.0), lease_end)
                self._event(EventKind.SCENE, change_text(one))
            if one.tunables:
                self._tunables |= one.tunables
                text = ", ".join(
                    tuned_text(tunable, one.tunables[tunable.name])
                    for tunable in self._agent.tunables
                    if tunable.name in one.tunables
                )
                self._event(EventKind.TUNES, text)
            if one.topic:
                arrives = self._environment.arrive(one.topic, one.message)
                kept = arrives or one.topic in self._latched
                kind = EventKind.ARRIVES if kept else EventKind.LOST
                self._event(kind, one.topic, inputs=one.message)
            if one.cancel is not None:
                self._cancel(one.cancel, one.cancel.reason)
        self._poll_mood_rules()

    def _poll_mood_rules(self) -> bool:
        """Pass the live scene to the mood rules; return whether one has fired."""
        self._polled_at = self._clock.now
        if self._cancelled_by or self._watch.over:
            return False
        live = self._live
        fired = self._watch.tick() if live.silent else self._watch.receive(live.now())
        for undecided in self._watch.take_undecided():
            self._undecided_rules.append(undecided)
            self._event(EventKind.LOGS, f"error: {undecided}")
        for one in fired:
            self._feedback(one.rule.give, one.reason)
        last = next((one for one in fired if one.rule.action is MoodAction.CANCEL), None)
        if last is not None:
            by_rule = Cancellation(
                by=stopper(StopCause.BY_MARKET, StoppedBy.MOOD_RULE), reason=last.reason
            )
            self._cancel(by_rule, last.rule.when.text)
        return bool(fired)

    def _cancel(self, cancellation: Cancellation, cause: str) -> None:
        if self._cancelled_by:
            return
        self._cancelled_by = cause
        self._event(EventKind.CANCELS, cancellation.reason)
        self._published = 0
        changes = self._run.cancel(cancellation.reason, cancellation=cancellation)
        self._publish_changes(changes)
        self._held = None

    def _feedback(self, kind: FeedbackKind, text: str) -> None:
        self._feedback_given.append(kind)
        self._event(EventKind.FEEDBACK, f"{kind.name.lower()}: {text}")

    def _tell_scene_layer(self, goal: SkillGoal) -> bool:
        """Take values that the tree sets or remembers; return whether they arrived."""
        if self._live.silent:
            return False
        fields: Mapping[str, Any] = goal.fields
        if goal.name == REMEMBER.name:
            facts = dict(map(from_message_fields, fields["facts"]))
            self._live.remember(facts)
            self._remembered |= facts
            self._event(EventKind.SCENE, f"remembered: {_named(facts)}")
        else:
            values = dict(zip(fields["names"], fields["values"], strict=True))
            self._live.tell(values)
            self._told |= values
            self._event(EventKind.SCENE, f"told: {_named(values)}")
        return True

    def _publish_changes(self, changes: Sequence[StatusChange]) -> None:
        """Publish the unpublished changes of a tick, and the held events."""
        new = changes[self._published :]
        held = [(number - self._published, event) for number, event in self._held or ()]
        self._published, self._held = len(changes), None
        result = self._run.result
        failed = result.tip if result and result.outcome is TreeOutcome.FAILED else ""
        for event in self._events_of_tick.in_order(self._clock.now, new, held, failed):
            self._publish(event)
        for change in new:
            if change.status is not Status.INVALID:
                self._not_prompted.discard(change.path)
                self._start_counting(change.path)
        self._held = []

    def _start_counting(self, path: str) -> None:
        for one in [one for one in self._awaited if matches(one.at, path)]:
            self._awaited.remove(one)
            self._schedule(one, self._clock.now + one.after_s)

    def _question(self, use: Use) -> Callable[[], ScriptedAnswer | None] | None:
        """Return a function that asks a person about a use of a skill; None to ask nobody."""
        source = self._answer_source
        if source is None or not source.asks(use):
            return None

        def ask() -> ScriptedAnswer | None:
            self._publish_changes(self._run.changes)
            while isinstance(typed := source.answer(use), ScriptedEvent):
                self._schedule(typed, self._clock.now + typed.after_s)
            return typed

        return ask

    def _rehearsed(
        self, outcome: TreeOutcome | None, message: str, *, worth_reporting: bool = True
    ) -> Rehearsed:
        text = message if worth_reporting else ""
        self._event(EventKind.ENDS, text, outcome=outcome)
        return Rehearsed(
            outcome=outcome,
            message=message,
            duration_s=self._clock.now,
            ticks=self._run.ticks,
            events=tuple(self._events),
            uses=tuple(self._environment.uses),
            feedback=tuple(self._feedback_given),
            cancelled_by=self._cancelled_by,
            declined=self._declined,
            told=self._told,
            remembered=self._remembered,
            undecided=(*self._run.undecided, *self._undecided_rules),
            marks={
                path: frozenset(found)
                for path, found in self._marks.items()
                if replaced(path, self._replacements) is None
            },
        )

    def _event(self, kind: EventKind, text: str, **details: Any) -> None:
        self._publish(Event(at_s=self._clock.now, kind=kind, text=text, **details))

    def _publish(self, event: Event) -> None:
        if self._held is not None:
            self._held.append((len(self._run.changes), event))
            return
        self._events.append(event)
        if self._on_event is not None:
            self._on_event(event)


def _named(values: Mapping[str, Plain]) -> str:
    parts = [f"{name} {format_value(one, FieldType.ANY)}" for name, one in values.items()]
    return ", ".join(parts)


class RehearsalContext(RunContext):
    """Context with scripted picks and variants, used in turn; the last one repeats."""

    def __init__(
        self,
        environment: Environment,
        scope: RunScope,
        random: Random,
        *,
        picks: Sequence[str] = (),
        variants: Sequence[VariantRule] = (),
    ) -> None:
        super().__init__(environment, scope, random)
        self._picks = picks
        self._variants = variants
        self._turns: defaultdict[Hashable, int] = defaultdict(int)

    def pick(self, path: str, count: int, last: int | None) -> int:
        for at, rule in enumerate(self._variants):
            if matches(rule.pattern, path):
                return self._in_turn(at, rule.numbers)
        return super().pick(path, count, last)

    def picked_child(self, spec: NodeSpec) -> int | None:
        branches = branches_of(spec)
        fitting = [
            [place for place, path in enumerate(branches) if matches(one, path)]
            for one in self._picks
        ]
        places = [found[0] for found in fitting if found]
        return self._in_turn(spec.path, places) if places else None

    def _in_turn(self, whose: Hashable, numbers: Sequence[int]) -> int:
        turn = min(self._turns[whose], len(numbers) - 1)
        self._turns[whose] += 1
        return numbers[turn]
