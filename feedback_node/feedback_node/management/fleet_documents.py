# SPDX-License-Identifier: Apache-2.0
"""Documents with steps of other robots: checks, records (once) and replays the steps."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FLEET as FLEET_SOURCE
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.profile_layers import PERSON
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Vector
from feedback_node.learning.cards import Agent
from feedback_node.learning.fleet_steps import (
    ROBOT_NAME,
    FleetStep,
    Forgettings,
    Replay,
    ReplayState,
    StepEvent,
    base_of,
    own_steps,
    read_step,
    recorded_step,
)
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import (
    FLEET,
    FORGOTTEN,
    ProfileRevision,
    RevisionCause,
    hidden_layer,
)

KIND = "fleet"
"""Kind of the documents with steps."""

FORMAT = 1

MOST_STEPS = 200
"""Most steps of one document."""

MOST_AGENTS = 1000

SAME = 1e-9
"""Largest difference of the values of two equal profiles."""

LATER = (RefusalCode.UNKNOWN_AGENT, RefusalCode.OTHER_BASE)
"""Codes of refusals that may be temporary: the agent is unknown, or its file differs."""


@dataclass(kw_only=True)
class _AgentReplay:
    """Replays of one agent, by layer.

    Attributes:
        last: Number of the last ledger row that they include.
        shared: Layers with steps of other robots.
        forgettings: When its layers were forgotten.
    """

    agent: Agent
    robot: str
    base: str
    bases: dict[str, str] = field(default_factory=dict)
    last: int = 0
    layers: dict[str, Replay] = field(default_factory=dict)
    shared: set[str] = field(default_factory=set)
    forgettings: Forgettings = field(default_factory=Forgettings)


@dataclass(frozen=True, kw_only=True)
class TakenSteps:
    """Result of taking in a document.

    Attributes:
        recorded: The recorded revisions.
        erased: Layers that another robot has forgotten, with their agents.
        delayed: Why traces of them stay in the file for now; empty if they are gone.
        answer: JSON with the refused steps: robot, number, code, reason, and whether the refusal
            may be temporary.
    """

    recorded: tuple[ProfileRevision, ...]
    erased: tuple[tuple[str, str], ...] = ()
    delayed: str = ""
    answer: str


class FleetDocuments:
    """Takes steps of other robots into the ledger.

    Results for an agent are cached in memory and computed again from the ledger if missing.
    """

    def __init__(self, profiles: Profiles, ledger: Ledger, *, wall: Callable[[], float]) -> None:
        self._profiles = profiles
        self._ledger = ledger
        self._wall = wall
        self._replays: dict[str, _AgentReplay] = {}

    def clear(self) -> None:
        """Drop the cache, because a person or place was forgotten."""
        self._replays.clear()

    def take(self, document: Mapping[str, Any]) -> TakenSteps:
        """Record the new steps of a document, and update the profiles of its agents.

        An invalid step does not affect the others. Each forgotten layer is one transaction; the
        records after it are another one.

        Raises:
            Refused: ``BAD_DOCUMENT``, or as in :class:`Ledger`.
        """
        robot, agents, steps = _checked(document)
        refusals: list[dict[str, Any]] = []
        new: dict[str, list[FleetStep]] = {}
        forgotten: list[FleetStep] = []
        names: set[tuple[str, int]] = set()
        for index, fields in enumerate(steps):
            try:
                step = read_step(fields, self._profiles.space, now=self._wall())
                self._check(step, robot)
                if (step.robot, step.number) in names or self._ledger.find_all(step.feedback_id):
                    continue
                names.add((step.robot, step.number))
                if step.event is StepEvent.FORGET:
                    forgotten.append(step)
                else:
                    new.setdefault(step.agent, []).append(step)
            except LedgerError:
                raise
            except Refused as refusal:
                refusals.append(_refusal(index, fields, refusal))
        recorded: list[ProfileRevision] = []
        erased: list[tuple[str, str]] = []
        delayed = ""
        try:
            for step in forgotten:
                layer, kept, why = self._forget(step, robot)
                recorded += kept
                erased += [(step.agent, layer)] if layer else []
                delayed = why or delayed
            entries: list[LedgerEntry] = []
            for name in sorted(new.keys() | {one for one in agents if self._profiles.knows(one)}):
                entries += self._entries(name, robot, new.get(name, ()), refusals)
            recorded += self._ledger.record(entries) if entries else ()
        except BaseException:
            self._replays.clear()
            raise
        return TakenSteps(
            recorded=tuple(recorded),
            erased=tuple(erased),
            delayed=delayed,
            answer=json.dumps({"refused": refusals}),
        )

    def _forget(self, step: FleetStep, robot: str) -> tuple[str, tuple[ProfileRevision, ...], str]:
        """Erase the layer that another robot has forgotten, except what came after that.

        Returns:
            The name of the layer, empty without one; the entries recorded again; why traces stay.
        """
        cause = RevisionCause(
            cause=FORGOTTEN, source=step.robot, feedback_id=step.feedback_id, step=step.fields()
        )
        known = (row.layer for row in self._ledger.layers(step.agent))
        layer = next((one for one in known if hidden_layer(one) == step.layer), "")
        kept = self._kept(step, layer, robot) if layer else ()
        recorded, delayed = self._ledger.forget_as_told(step.agent, layer, cause, kept)
        self._replays.pop(step.agent, None)
        return layer, recorded, delayed

    def _kept(self, forgotten: FleetStep, layer: str, robot: str) -> Sequence[LedgerEntry]:
        """Return the entries of the steps of a layer that came after it was forgotten."""
        name = forgotten.agent
        entries = self._ledger.entries(agent=name)
        found = [*own_steps(entries, robot, {})]
        found += filter(None, (recorded_step(revision) for _, revision in entries))
        later = {
            one.feedback_id: one for one in found if one.layer == layer and one.key > forgotten.key
        }
        steps = sorted(later.values(), key=lambda one: one.key)
        if not steps:
            return ()
        base = base_of(self._ledger.authored(name))
        replay = Replay(self._profiles.agent(name), self._profiles.space, robot)
        replay.add(one for one in steps if one.base == base)
        begin = self._beginning(name, layer)
        state = replay.state
        if not state.profile:
            state = replace(state, profile=self._profiles.space.ordered(begin.profile))
        return [begin, *self._taken(steps, begin.profile, state)]

    def _beginning(self, name: str, layer: str) -> LedgerEntry:
        begin = self._profiles.first_layer_entry(name, layer)
        return replace(begin, cause=replace(begin.cause, source=FLEET_SOURCE))

    def _check(self, step: FleetStep, robot: str) -> None:
        what = f"step {step.robot}/{step.number}"
        if step.robot == robot:
            raise Refused(
                RefusalCode.OWN_STEP, f"{what}: it is of this robot, whose ledger has it"
            )
        if step.layer.startswith(f"{PERSON}/"):
            raise Refused(
                RefusalCode.NOT_SHARED,
                f"{what}: what a robot learns for a person stays on that robot",
            )
        self._profiles.agent(step.agent)
        if step.event is StepEvent.FORGET:
            return
        base = base_of(self._ledger.authored(step.agent))
        if step.base != base:
            raise Refused(
                RefusalCode.OTHER_BASE,
                f"{what}: {step.agent} was another version of its file there ({step.base}, here "
                f"{base}); it counts once both have the same profile in their files",
            )

    def _entries(
        self, name: str, robot: str, steps: Iterable[FleetStep], refusals: list[dict[str, Any]]
    ) -> list[LedgerEntry]:
        """Return the entries for new steps of an agent, and for layers that were out of order."""
        replays = self._replays_of(name, robot)
        by_layer: dict[str, list[FleetStep]] = {}
        for step in sorted(steps, key=lambda one: one.key):
            if replays.forgettings.include(step):
                what = f"step {step.robot}/{step.number}"
                refusal = Refused(
                    RefusalCode.FORGOTTEN, f"{what}: its layer was forgotten after it"
                )
                refusals.append(_refusal(0, step.fields(), refusal))
                continue
            by_layer.setdefault(step.layer, []).append(step)
        entries: list[LedgerEntry] = []
        for layer in sorted(replays.shared | by_layer.keys()):
            current = self._ledger.current(name, layer)
            taken = by_layer.get(layer, [])
            before = current.profile if current is not None else {}
            if current is None:
                try:
                    begin = self._beginning(name, layer)
                except LedgerError:
                    raise
                except Refused as refusal:
                    refusals += [_refusal(0, one.fields(), refusal) for one in taken]
                    continue
                entries.append(begin)
                before = begin.profile
            replay = self._replay(replays, layer)
            replay.add(taken)
            state = replay.state
            if taken:
                replays.shared.add(layer)
                entries += self._taken(taken, before, state)
            elif _differs(self._profiles.space.ordered(before), state.profile):
                cause = RevisionCause(
                    cause=FLEET,
                    kind=FeedbackKind.SET,
                    source=FLEET_SOURCE,
                    reason="its own steps in their place among the steps of the other robots",
                )
                entries.append(self._entry(name, layer, state, cause))
        return entries

    def _taken(
        self, steps: Sequence[FleetStep], before: Mapping[str, float], state: ReplayState
    ) -> Iterable[LedgerEntry]:
        """Yield entries for new steps of one layer; the last one has the resulting profile."""
        for number, step in enumerate(steps, start=1):
            is_last = number == len(steps)
            word = step.kind.name.lower() if step.event is StepEvent.FEEDBACK else str(step.event)
            more = f", with {len(steps) - 1} more" if is_last and len(steps) > 1 else ""
            fields = step.fields()
            cause = RevisionCause(
                cause=FLEET,
                kind=FeedbackKind.SET,
                source=step.robot,
                reason=f"{word} there, its step {step.number}{more}",
                feedback_id=step.feedback_id,
                step=fields,
            )
            if is_last:
                yield self._entry(step.agent, step.layer, state, cause)
            else:
                unchanged = self._profiles.space.ordered(before)
                yield self._entry(step.agent, step.layer, replace(state, profile=unchanged), cause)

    def _entry(
        self, agent: str, layer: str, state: ReplayState, cause: RevisionCause
    ) -> LedgerEntry:
        profile = self._profiles.space.named(state.profile)
        cause = replace(cause, target=profile, changes=state.changes)
        return LedgerEntry(agent=agent, layer=layer, profile=profile, cause=cause)

    def _replays_of(self, name: str, robot: str) -> _AgentReplay:
        """Return the replays of an agent, including all rows of the ledger."""
        agent = self._profiles.agent(name)
        base = base_of(self._ledger.authored(name))
        found = self._replays.get(name)
        is_known = found is not None and found.agent.matches(agent.entry, agent.host)
        if found is None or not is_known or (found.robot, found.base) != (robot, base):
            found = self._replays[name] = _AgentReplay(agent=agent, robot=robot, base=base)
        entries = self._ledger.entries(after=found.last, agent=name)
        steps = list(own_steps(entries, robot, found.bases))
        for number, revision in entries:
            found.last = number
            step = recorded_step(revision)
            if step is not None:
                steps.append(step)
        for step in steps:
            if step.event is StepEvent.FORGET:
                found.forgettings.add(step)
        for step in steps:
            is_old = step.event is StepEvent.FORGET or found.forgettings.include(step)
            if step.base == base and not is_old:
                if step.robot != robot:
                    found.shared.add(step.layer)
                self._replay(found, step.layer).add([step])
        return found

    def _replay(self, replays: _AgentReplay, layer: str) -> Replay:
        if layer not in replays.layers:
            replays.layers[layer] = Replay(replays.agent, self._profiles.space, replays.robot)
        return replays.layers[layer]


def to_fleet_document(robot: str, agents: Iterable[str], steps: Iterable[FleetStep]) -> str:
    """Return the document that makes a robot take in steps of others.

    Args:
        robot: Name of the robot.
        agents: Agents to update in addition to the agents of the steps.
        steps: Steps of other robots.
    """
    return json.dumps(
        {
            "format": FORMAT,
            "kind": KIND,
            "robot": robot,
            "agents": list(agents),
            "steps": [step.fields() for step in steps],
        },
        allow_nan=False,
    )


def refusals_of(answer: str) -> Sequence[Mapping[str, Any]]:
    """Return the refused steps in the answer of the feedback node.

    Raises:
        Refused: ``OTHER_VERSION``; the answer is from a version that knows no steps.
    """
    try:
        found: Sequence[Mapping[str, Any]] = json.loads(answer)["refused"]
    except (ValueError, KeyError, TypeError):
        raise Refused(
            RefusalCode.OTHER_VERSION,
            "the feedback node does not know what a fleet is; install the same version of "
            "bt-agents for it",
        ) from None
    return found


def _checked(document: Mapping[str, Any]) -> tuple[str, Sequence[str], Sequence[Any]]:
    robot, agents = document.get("robot"), document.get("agents")
    steps = document.get("steps")
    if document.get("format") != FORMAT:
        raise _invalid(f"format {str(document.get('format'))[:20]!a}, expected {FORMAT}")
    if not isinstance(robot, str) or not ROBOT_NAME.fullmatch(robot):
        raise _invalid("expected a robot of 1 to 63 small letters, digits, '-' and '_'")
    if not isinstance(agents, list) or len(agents) > MOST_AGENTS:
        raise _invalid(f"expected a list of {MOST_AGENTS} agents at most")
    if not all(isinstance(one, str) for one in agents):
        raise _invalid("an agent is not a text")
    if not isinstance(steps, list) or len(steps) > MOST_STEPS:
        raise _invalid(f"expected a list of {MOST_STEPS} steps at most")
    return robot, agents, steps


def _refusal(index: int, fields: Any, refusal: Refused) -> dict[str, Any]:
    named = fields if isinstance(fields, Mapping) else {}
    robot, number = named.get("robot"), named.get("number")
    return {
        "robot": robot[:63] if isinstance(robot, str) else "",
        "number": number if isinstance(number, int) and abs(number) < 2**63 else 0,
        "index": index,
        "code": refusal.code,
        "reason": refusal.reason,
        "later": refusal.code in LATER,
    }


def _differs(one: Vector, other: Vector) -> bool:
    return not all(abs(a - b) <= SAME for a, b in zip(one, other, strict=True))


def _invalid(found: str) -> Refused:
    return Refused(RefusalCode.BAD_DOCUMENT, f"document: {found}; nothing was taken in")
