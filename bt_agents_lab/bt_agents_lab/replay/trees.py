# SPDX-License-Identifier: Apache-2.0
"""Replay of tree runs in a journal, compared change by change."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from typing import Any

from bt_agents.engine.run import TreeOutcome
from bt_agents.recording.format import Recording, read_recording
from bt_agents.recording.recorded_run import ReplayedStep, replay
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_lab.replay.findings import ReplayFinding, compared, not_recorded
from bt_agents_lab.replay.recording_index import RecordedRun
from bt_agents_lab.replay.texts import ParsedTexts
from bt_agents_language.model.specs import AgentSpec

KIND = "run of a tree"

_STATUSES = ("INVALID", "RUNNING", "SUCCESS", "FAILURE")
"""Names of the status numbers in ``StatusChange.msg``."""

Change = tuple[str, str, str, str]
"""Path, name, status and message of a node."""


class _Missing(Exception):
    """Missing part of a recording, named by the text."""


def replay_runs(runs: Iterable[RecordedRun]) -> Iterator[ReplayFinding]:
    """Tick each run again and yield whether the changes of each tick are equal."""
    for run in runs:
        where = run.name
        try:
            ticks = _again(run)
        except _Missing as missing:
            yield not_recorded(KIND, where, str(missing))
        except Refused as refused:
            yield compared(KIND, where, refused.reason)
        else:
            if isinstance(ticks, int):
                yield compared(KIND, where, "", ticks)
            elif run.torn:
                yield not_recorded(KIND, where, "the journal has lost messages around it")
            else:
                yield compared(KIND, where, ticks)


def _again(run: RecordedRun) -> int | str:
    """Return the number of equal ticks, or the first difference as text.

    Raises:
        Refused: The record is damaged.
        _Missing: Something was not recorded.
    """
    if not run.records:
        raise _Missing("nothing was recorded of what its tree received")
    if run.records[0].tick != 0:
        raise _Missing("its record begins in the middle")
    recording = read_recording(line for one in run.records for line in one.record.splitlines())
    spec, parsed = _spec_of(run, recording)
    recorded = _by_tick(run)
    folder = parsed.folder + "/"
    prefix = str(recording.head.get("file", "")).removesuffix(spec.file.removeprefix(folder))
    ticks = unrecorded = 0
    for step in replay(recording, spec, parsed.space):
        ticks = step.tick
        again = [
            (one.path, one.name, one.status.name, one.message.replace(folder, prefix))
            for one in step.changes
        ]
        if again and len(again) == step.recorded_changes and step.tick not in recorded:
            unrecorded += 1
            recorded[step.tick] = again
        was = recorded.get(step.tick, [])
        head, recorded[step.tick] = was[: len(again)], was[len(again) :]
        difference = _difference(step, head, again) or _end_difference(step, folder, prefix)
        if difference:
            return f"tick {step.tick}: {difference}"
    if not recording.complete:
        why = recording.stopped or "its host or the journal has ended before it"
        raise _Missing(f"{ticks} ticks are equal, then the record ends: {why}")
    left = next((changes for changes in recorded.values() if changes), None)
    if left:
        return f"after its end: {left[0][0]} {left[0][2]}, as it was reported, does not come again"
    if unrecorded:
        raise _Missing(f"the changes of {unrecorded} of {ticks} ticks were not received")
    return ticks


def _spec_of(run: RecordedRun, recording: Recording) -> tuple[AgentSpec, ParsedTexts]:
    """Return the agent as it was, from the texts in which its version first appeared."""
    name, version = recording.head.get("agent"), recording.head.get("version")
    fitting = [texts for texts in run.texts if texts.versions.get(str(name)) == version]
    if not fitting:
        raise _Missing(f"there is no text of version {version} of {name}")
    try:
        # Use the oldest: a library may have changed since, and waits like the tree.
        parsed = fitting[-1].parsed_for(str(name))
    except BtAgentsError as error:
        raise _Missing(f"its texts cannot be read here: {error}") from None
    spec = next((agent for agent in parsed.trees.agents if agent.name == name), None)
    if spec is None:
        broken = "; ".join(one.error.lines[0] for one in parsed.trees.broken)
        raise _Missing(f"its text cannot be read here: {broken or 'there is no such agent'}")
    return spec, parsed


def _by_tick(run: RecordedRun) -> dict[int, list[Change]]:
    """Return the recorded changes of each tick; a tick may have several messages."""
    recorded: dict[int, list[Change]] = {}
    for status in run.statuses:
        recorded.setdefault(status.tick, []).extend(
            (one.path, one.name, _status(one.status), one.message) for one in status.changes
        )
    return recorded


def _status(number: int) -> str:
    return _STATUSES[number] if 0 <= number < len(_STATUSES) else str(number)


def _difference(step: ReplayedStep, before: list[Change], again: list[Change]) -> str:
    """Return the first difference in a step as text; empty if there is none."""
    for was, now in zip_longest(before, again):
        if was != now:
            return f"{_shown(was)} was reported, now {_shown(now)}"
    for stored, asked in zip_longest(_plain(step.recorded_requests), _plain(step.requests)):
        if stored != asked:
            return f"{_asked(stored)} was asked for, now {_asked(asked)}"
    return ""


def _end_difference(step: ReplayedStep, folder: str, prefix: str) -> str:
    if step.result is None:
        return "it had ended, now it goes on" if step.recorded_end is not None else ""
    if step.recorded_end is None:
        return f"it went on, now it ends: {step.result.message}"
    result = step.result
    pairs = {
        "outcome": (TreeOutcome(step.recorded_end["outcome"]).value, result.outcome.value),
        "message": (step.recorded_end["message"], result.message.replace(folder, prefix)),
        "tip": (step.recorded_end["tip"], result.tip),
        "orphans": (list(step.recorded_end["orphans"]), list(result.orphans)),
        "ticks": (step.recorded_end["ticks"], result.ticks),
        "duration_s": (step.recorded_end["duration_s"], result.duration_s),
    }
    for name, (was, now) in pairs.items():
        if was != now:
            return f"the {name} of its end was {was}, now {now}"
    return ""


def _plain(asked: list[Any]) -> list[str]:
    return [json.dumps(one, sort_keys=True, default=list) for one in asked]


def _asked(text: str | None) -> str:
    return "nothing" if text is None else text[:200]


def _shown(change: Change | None) -> str:
    if change is None:
        return "nothing"
    path, name, status, message = change
    return f"{path} '{name}' {status}" + (f" ({message})" if message else "")
