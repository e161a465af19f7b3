# SPDX-License-Identifier: Apache-2.0
"""Runs that are recorded step by step, and their replay."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from bt_agents.engine.environment import Clock, Environment
from bt_agents.engine.run import Run, RunLimits, RunResult, StatusChange
from bt_agents.recording.format import FORMAT, Entry, Recording, bad_recording, to_line
from bt_agents.recording.recorded_environment import (
    RecordingContext,
    RecordingEnvironment,
    ReplayContext,
    ReplayEnvironment,
)
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue, Vector
from bt_agents_core.stop_cause import Cancellation
from bt_agents_language.model.specs import AgentSpec

MOST_CHARACTERS = 2_000_000
"""Longest recording, enough for 45 min at 20 ticks per second [characters]."""

Sink = Callable[[int, str], None]
"""Receives one line of the recording: number of the tick, the line."""


class RecordingRun(Run):
    """A :class:`Run` that records its inputs from outside and its requests.

    See :mod:`bt_agents.recording.format`.

    Args:
        spec: See :class:`Run`, also for the other arguments with the same names.
        seed: Seed of the random source of the nodes.
        version: Version of the agent's file.
        sink: Receives the lines.
        most: Number of characters after which the recording stops.
    """

    def __init__(
        self,
        spec: AgentSpec,
        *,
        space: SceneSpace,
        scene: Scene,
        profile: Vector,
        live: Callable[[], Scene],
        tunables: Mapping[str, Plain],
        environment: Environment,
        steady: Clock,
        seed: int,
        sink: Sink,
        limits: RunLimits | None = None,
        version: int = 0,
        most: int = MOST_CHARACTERS,
        host: str = "",
    ) -> None:
        limits = limits or RunLimits()
        recorded = self._recorded = RecordingEnvironment(environment, live, tunables, steady)
        self._sink = sink
        self._left = most
        self._last = 0
        self._changed = 0
        super().__init__(
            spec,
            space=space,
            scene=scene,
            profile=profile,
            live=recorded.live,
            tunables=tunables,
            environment=recorded,
            steady=recorded.steady,
            limits=limits,
            random=Random(seed),
            stopwatch=steady,
            plugins=recorded.plugin,
            context=RecordingContext,
            host=host,
        )
        self._write(
            {
                "format": FORMAT,
                "agent": spec.name,
                "host": host,
                "version": version,
                "file": spec.file,
                "seed": seed,
                "limits": asdict(limits),
                "parameters": list(space.names),
                "scene": asdict(scene),
                "profile": list(profile),
                **recorded.first(),
            }
        )

    def tick(self) -> list[StatusChange]:
        recorded = self._recorded
        steps = recorded.steps
        if not steps.began and recorded.recorded_tunables != recorded.tunables:
            recorded.record_tunables()
        changes = Run.tick(self)
        if self.kept and not steps.closed:
            steps.entry["kept"] = list(self.kept)
        if changes or steps.entry or self.result is not None:
            self._changed += len(changes)
            self._end_step()
        else:
            steps.step += 1
        return changes

    def cancel(
        self, reason: str, *, clean_up: bool = True, cancellation: Cancellation | None = None
    ) -> list[StatusChange]:
        call: Entry = {"call": "cancel", "reason": reason, "clean_up": clean_up}
        if cancellation is not None:
            call["cancellation"] = asdict(cancellation)
        self._record_call(call)
        changes = super().cancel(reason, clean_up=clean_up, cancellation=cancellation)
        self._changed += len(changes)
        return changes

    def shorten_settling(self, settle_s: float) -> None:
        self._record_call({"call": "shorten_settling", "settle_s": settle_s})
        super().shorten_settling(settle_s)

    def give_up(self, reason: str) -> RunResult:
        result = super().give_up(reason)
        self._stop(f"the engine has failed: {reason}")
        return result

    def _record_call(self, call: Entry) -> None:
        """Record a call of the host, which starts the step of the next tick."""
        recorded = self._recorded
        steps = recorded.steps
        if not steps.began and recorded.recorded_tunables != recorded.tunables:
            recorded.record_tunables()
        steps.began = True
        steps.add("calls", call)

    def _end_step(self) -> None:
        entry = self._recorded.steps.end()
        step = self._recorded.steps.step
        head: Entry = {"step": step}
        if step > self._last + 1:
            head["quiet"] = step - self._last - 1
        if self._changed:
            head["changes"] = self._changed
        if self.result is not None:
            entry["end"] = {**asdict(self.result), "outcome": self.result.outcome.value}
        self._last = step
        self._changed = 0
        self._write({**head, **entry})

    def _write(self, entry: Entry) -> None:
        if self._recorded.steps.closed:
            return
        try:
            line = to_line(entry)
        except (TypeError, ValueError, RecursionError) as error:
            self._stop(f"a value cannot be written down: {error}")
            return
        self._left -= len(line)
        if self._left < 0:
            self._stop("the recording got too long")
            return
        self._sink(self.ticks, line)

    def _stop(self, reason: str) -> None:
        if not self._recorded.steps.closed:
            self._recorded.steps.closed = True
            self._sink(self.ticks, json.dumps({"stopped": reason}))


@dataclass(frozen=True, kw_only=True)
class ReplayedStep:
    """One step of a replayed run, with what was recorded about it.

    ``tick`` is the number of ticks of the tree so far. Requests have the form of the recording; of
    changes, only the number was recorded. The result and the recorded end are None before the end.
    """

    tick: int
    changes: list[StatusChange]
    recorded_changes: int
    requests: list[Entry]
    recorded_requests: list[Entry]
    result: RunResult | None
    recorded_end: Mapping[str, Any] | None


def replay(recording: Recording, spec: AgentSpec, space: SceneSpace) -> Iterator[ReplayedStep]:
    """Replay a run step by step, to its end or the end of the recording.

    Raises:
        Refused: ``BAD_RECORD``; an entry is malformed.
    """
    try:
        yield from _replay(recording, spec, space)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise bad_recording(f"{type(error).__name__}: {error}") from error


def _replay(recording: Recording, spec: AgentSpec, space: SceneSpace) -> Iterator[ReplayedStep]:
    head = recording.head
    if head["parameters"] != list(space.names):
        raise bad_recording(
            f"it has the parameters {head['parameters']}, expected {list(space.names)}"
        )
    scene = _scene(head["scene"])
    environment = ReplayEnvironment(head, scene)
    run = Run(
        spec,
        space=space,
        scene=scene,
        profile=tuple(head["profile"]),
        live=lambda: environment.live,
        tunables=environment.tunables,
        environment=environment,
        steady=environment.steady,
        limits=RunLimits(**head["limits"]),
        random=Random(head["seed"]),
        stopwatch=lambda: 0.0,
        plugins=environment.plugin,
        context=ReplayContext,
        host=str(head.get("host", "")),
    )
    for number in range(1, recording.steps + 1):
        entry = recording.entries.get(number, {})
        environment.load(entry)
        changes: list[StatusChange] = []
        for call in entry.get("calls", ()):
            if call["call"] == "shorten_settling":
                run.shorten_settling(float(call["settle_s"]))
            else:
                changes += run.cancel(
                    str(call["reason"]),
                    clean_up=bool(call["clean_up"]),
                    cancellation=_cancellation(call.get("cancellation")),
                )
        run.set_breakpoints(entry.get("kept", ()))
        changes += run.tick()
        yield ReplayedStep(
            tick=run.ticks,
            changes=changes,
            recorded_changes=int(entry.get("changes", 0)),
            requests=environment.requests,
            recorded_requests=list(entry.get("requests", ())),
            result=run.result,
            recorded_end=entry.get("end"),
        )
        if run.result is not None:
            return


def _cancellation(fields: Mapping[str, Any] | None) -> Cancellation | None:
    if fields is None:
        return None
    return Cancellation(by=str(fields["by"]), reason=str(fields["reason"]))


def _scene(fields: Mapping[str, Any]) -> Scene:
    values = [{**value, "origin": Origin(value["origin"])} for value in fields["values"]]
    return Scene(**{**fields, "values": tuple(SceneValue(**value) for value in values)})
