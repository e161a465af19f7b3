# SPDX-License-Identifier: Apache-2.0
"""Promises of a running system, and the check whether the events of a soak break one; no ROS."""

from __future__ import annotations

import math
import statistics
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

ONE_END = "a scene that was acknowledged ends exactly once"
FEEDBACK_STORED = "feedback that was acknowledged is in the ledger"
SETTINGS_STORED = "tunings, presets, pins, vetoes acknowledged are in force"
ONE_ACTS = "no two agents act at the same time"
NO_GROWTH = "no process grows, nor does the state folder"
RECOVERY = "after a fault nobody waits longer than 3 s for the next act"
NO_FAILURE = "no process ends or fails by itself"
REPLAY = "all decisions and all learning in the journal replay equal"

RECOVERY_S = 3.0
"""Longest time without an act after a fault, on a machine with time to spare [s]."""

EVERYTHING = "everything"
"""Component of the fault that kills all processes at once."""

RESTART_S = 6.0
"""The same after a kill of all processes, which start at the same time [s]."""

LATE_S = 10.0
"""Longest time after which an unanswered request may still be carried out [s]."""

WARM_UP_SHARE = 0.5
"""First part of a life in which growth does not count; caches and histories fill."""

SHORTEST_LIFE_S = 240.0
"""Least age for a meaningful slope [s]."""

MOST_PER_MINUTE: Mapping[str, float] = {"memory_mb": 1.0, "descriptors": 1.0, "threads": 0.5}
"""Growth that is tolerated for a process, and for files in the state folder."""

MOST_FILES_PER_MINUTE = 1.0

_MOST_PAIRS = 200


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something observed from outside; ``at`` is the time since the soak began [s]."""

    at: float


@dataclass(frozen=True, kw_only=True)
class SceneAcknowledged(Event):
    """The scene layer has accepted a scene."""

    scene: str


@dataclass(frozen=True, kw_only=True)
class SceneShown(Event):
    """The market has published that it has a scene."""

    scene: str


@dataclass(frozen=True, kw_only=True)
class SceneEnded(Event):
    """A market has announced an end of a scene."""

    scene: str
    code: str
    epoch: str


@dataclass(frozen=True, kw_only=True)
class FeedbackAcknowledged(Event):
    """The feedback node has accepted feedback."""

    feedback: str


@dataclass(frozen=True, kw_only=True)
class LedgerRead(Event):
    """The ids of all feedback in the ledger."""

    feedback: frozenset[str]


@dataclass(frozen=True, kw_only=True)
class SettingRequested(Event):
    """A new value was requested: of a tunable, of a preset, of a pin or a veto.

    Attributes:
        acknowledged: Whether it was accepted, at ``at``; otherwise it may or may not apply.
    """

    name: str
    value: object
    acknowledged: bool


@dataclass(frozen=True, kw_only=True)
class SettingRead(Event):
    """A value in force, read when the last request must have been carried out."""

    name: str
    value: object


@dataclass(frozen=True, kw_only=True)
class Acted(Event):
    """The robot acted for a run, from ``at`` until ``until``."""

    until: float
    run: str
    what: str


@dataclass
class RobotGoal:
    """Goal at the robot: when it began, and when it ended or was last seen [s]."""

    at: float
    until: float
    over: bool = False


class RobotGoals:
    """Goals at the robot, as its status messages show them.

    Attributes:
        all: Action and goal id → goal.
    """

    def __init__(self) -> None:
        self.all: dict[tuple[str, bytes], RobotGoal] = {}
        self._died = -math.inf

    def take(self, action: str, at: float, listed: Mapping[bytes, bool]) -> None:
        """Handle a status message of an action.

        Args:
            action: Name of the action.
            at: When the message was sent [s].
            listed: Goal id → whether the goal is under way.
        """
        for goal_id, is_under_way in listed.items():
            goal = self.all.get((action, goal_id))
            if goal is None:
                if not is_under_way:
                    continue  # it ended before anybody saw it begin
                goal = self.all[action, goal_id] = RobotGoal(at=at, until=at)
            if goal.over and at >= goal.until:
                continue
            # A message may arrive after the death of the robot that sent it.
            died = is_under_way and at < self._died
            goal.until = self._died if died else at
            goal.over = died or not is_under_way
        for (other, goal_id), goal in self.all.items():
            if other == action and goal_id not in listed and not goal.over:
                goal.over = True  # a restarted robot does not know it

    def end(self, at: float) -> None:
        """End all goals, because the robot dies."""
        self._died = at
        for goal in self.all.values():
            if not goal.over:
                goal.until, goal.over = at, True


@dataclass(frozen=True, kw_only=True)
class Fault(Event):
    """A fault: a component was killed, hung, flooded or left unread; it ended at ``over``."""

    component: str
    kind: str
    over: float


@dataclass(frozen=True, kw_only=True)
class Served(Event):
    """A run has started, the first one after a fault.

    Attributes:
        fault: The fault.
        silence_s: Longest time without an act between the end of the fault and ``at`` [s];
            0 if a run started before the fault was over.
        overloaded: Whether the machine was fully busy meanwhile.
    """

    fault: Fault
    silence_s: float
    overloaded: bool


@dataclass(frozen=True, kw_only=True)
class Measured(Event):
    """Resources that one process used."""

    component: str
    pid: int
    memory_mb: float
    descriptors: int
    threads: int


@dataclass(frozen=True, kw_only=True)
class FilesCounted(Event):
    """Number of files in the state folder."""

    files: int


@dataclass(frozen=True, kw_only=True)
class Failed(Event):
    """A process ended without being killed, or wrote a traceback."""

    component: str
    text: str


@dataclass(frozen=True, kw_only=True)
class Replayed(Event):
    """A recorded decision or profile change was recomputed.

    Attributes:
        item: The decision or change.
        difference: Difference from the recorded result; empty if equal.
    """

    item: str
    difference: str


@dataclass(frozen=True)
class Breach:
    """One moment at which a promise was broken."""

    promise: str
    at: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Result of checking one promise.

    Attributes:
        checked: How often it was checked.
    """

    promise: str
    checked: int
    breaches: tuple[Breach, ...]


def check(events: Iterable[Event]) -> list[Verdict]:
    """Return the verdict on each promise from the events of a whole soak."""
    ordered = sorted(events, key=lambda event: event.at)
    verdicts = []
    for promise, find in _CHECKS.items():
        found = list(find(ordered))
        breaches = tuple(Breach(promise, *one) for one in found if one is not None)
        verdicts.append(Verdict(promise=promise, checked=len(found), breaches=breaches))
    return verdicts


_Findings = Iterator[tuple[float, str] | None]
"""For each check None, or when and how it broke the promise."""


def _of(kind: type, events: Sequence[Event]) -> list:
    return [event for event in events if isinstance(event, kind)]


def _check_ends(events: Sequence[Event]) -> _Findings:
    """Check scenes, except those that the scene layer was killed before delivering.

    The same end of the same market may be announced twice, for example after a kill.
    """
    ends: dict[str, list[SceneEnded]] = defaultdict(list)
    shown: set[str] = set()
    for event in events:
        if isinstance(event, SceneEnded) and _is_new(event, ends[event.scene]):
            ends[event.scene].append(event)
        if isinstance(event, SceneShown | SceneEnded):
            shown.add(event.scene)
    kills = [
        fault.at
        for fault in _of(Fault, events)
        if fault.kind == "killed" and fault.component in ("scene_layer", EVERYTHING)
    ]
    for one in _of(SceneAcknowledged, events):
        if one.scene not in shown and died_unsent(one.at, kills):
            continue
        found = ends[one.scene]
        if not found:
            yield one.at, f"scene {one.scene} has no end"
        elif len(found) == 1:
            yield None
    for scene, found in ends.items():
        if len(found) > 1:
            codes = " and ".join(end.code for end in found)
            yield found[1].at, f"scene {scene} ends as {codes}"


def died_unsent(acknowledged_at: float, kills: Iterable[float]) -> bool:
    """Return whether a scene missing at the market may have died with the scene layer.

    Args:
        acknowledged_at: When the scene layer's answer arrived, perhaps after its end [s].
        kills: When the scene layer was killed [s].
    """
    return any(acknowledged_at - 1.0 <= at for at in kills)


def _is_new(end: SceneEnded, before: Sequence[SceneEnded]) -> bool:
    announced_again = any((one.epoch, one.code) == (end.epoch, end.code) for one in before)
    return end.code != "DUPLICATE" and not announced_again


def _check_feedback(events: Sequence[Event]) -> _Findings:
    reads = _of(LedgerRead, events)
    for one in _of(FeedbackAcknowledged, events):
        later = [read for read in reads if read.at >= one.at]
        lost = [read.at for read in later if one.feedback not in read.feedback]
        if not later:
            lost = [one.at]
        yield (lost[0], f"feedback {one.feedback} is not in the ledger") if lost else None


def _check_settings(events: Sequence[Event]) -> _Findings:
    requests: dict[str, list[SettingRequested]] = defaultdict(list)
    for event in events:
        if isinstance(event, SettingRequested):
            requests[event.name].append(event)
        elif isinstance(event, SettingRead) and event.name in requests:
            asked = requests[event.name]
            sure = [one for one in asked if one.acknowledged]
            if not sure:
                continue
            last = sure[-1]
            possible = [last.value] + [
                one.value for one in asked if not one.acknowledged and one.at >= last.at - LATE_S
            ]
            if event.value in possible:
                yield None
            else:
                yield (
                    event.at,
                    f"{event.name} is {event.value!r}, but {last.value!r} was acknowledged at "
                    f"{last.at:.1f} s",
                )


def _check_acts(events: Sequence[Event]) -> _Findings:
    acts: list[Acted] = _of(Acted, events)
    latest: dict[str, Acted] = {}
    for act in acts:
        beside = [
            other for run, other in latest.items() if run != act.run and other.until > act.at
        ]
        if beside:
            overlap_s = min(beside[0].until, act.until) - act.at
            yield (
                act.at,
                f"{act.what} of {act.run} beside {beside[0].what} of {beside[0].run}, "
                f"for {overlap_s:.2f} s",
            )
        else:
            yield None
        if act.run not in latest or latest[act.run].until < act.until:
            latest[act.run] = act


@dataclass(frozen=True, kw_only=True)
class Growth:
    """Slopes of one process over its life, in the units of :data:`MOST_PER_MINUTE`."""

    component: str
    pid: int
    since: float
    until: float
    per_minute: Mapping[str, float]


def growths(events: Iterable[Event]) -> Iterator[Growth]:
    """Return the growth of each process that has lived long enough to judge."""
    lives: dict[tuple[str, int], list[Measured]] = defaultdict(list)
    for one in _of(Measured, list(events)):
        lives[one.component, one.pid].append(one)
    for (component, pid), life in lives.items():
        begin, age_s = life[0].at, life[-1].at - life[0].at
        grown = [one for one in life if one.at - begin >= WARM_UP_SHARE * age_s]
        if age_s < SHORTEST_LIFE_S or len(grown) < 2:
            continue
        per_minute = {
            name: 60.0 * slope([(one.at, float(getattr(one, name))) for one in grown])
            for name in MOST_PER_MINUTE
        }
        yield Growth(
            component=component, pid=pid, since=begin, until=life[-1].at, per_minute=per_minute
        )


def longest_wait(
    begin: float, until: float, acts: Iterable[float], wanted: Iterable[tuple[float, float]]
) -> float:
    """Return the longest time without an act in which somebody waits for one [s].

    Args:
        begin: When to begin.
        until: When an act begins, at the latest.
        acts: Moments when an act begins or ends.
        wanted: Since when, and until when, a scene waits.
    """
    signs = sorted({begin, *(one for one in acts if begin < one < until), max(begin, until)})
    scenes = sorted(wanted)
    longest = 0.0
    for last, following in pairwise(signs):
        since = over = last
        for one_since, one_over in scenes:
            if one_over <= last or one_since >= following:
                continue
            since = since if one_since <= over else one_since
            over = max(over, min(one_over, following))
            longest = max(longest, over - since)
    return longest


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Return the median of the slopes between points, which is robust against outliers."""
    step = max(1, len(points) // _MOST_PAIRS)
    kept = points[::step]
    slopes = [
        (later[1] - earlier[1]) / (later[0] - earlier[0])
        for index, earlier in enumerate(kept)
        for later in kept[index + 1 :]
        if later[0] > earlier[0]
    ]
    return statistics.median(slopes) if slopes else 0.0


def _check_growth(events: Sequence[Event]) -> _Findings:
    for growth in growths(events):
        bad = [
            f"{name} {growth.per_minute[name]:+.2f} a minute (at most {most:g})"
            for name, most in MOST_PER_MINUTE.items()
            if growth.per_minute[name] > most
        ]
        text = f"{growth.component} (process {growth.pid}, since {growth.since:.0f} s)"
        yield (growth.until, f"{text}: {'; '.join(bad)}") if bad else None
    files = [(one.at, float(one.files)) for one in _of(FilesCounted, events)]
    if files and files[-1][0] - files[0][0] >= SHORTEST_LIFE_S:
        begin = files[0][0] + WARM_UP_SHARE * (files[-1][0] - files[0][0])
        per_minute = 60.0 * slope([one for one in files if one[0] >= begin])
        bad_files = per_minute > MOST_FILES_PER_MINUTE
        yield (files[-1][0], f"files {per_minute:+.2f} a minute") if bad_files else None


def _check_recovery(events: Sequence[Event]) -> _Findings:
    served = {id(one.fault): one for one in _of(Served, events)}
    for fault in _of(Fault, events):
        one = served.get(id(fault))
        text = f"{fault.component} {fault.kind}"
        if one is None:
            yield fault.at, f"{text}: no scene was served after it"
        elif one.overloaded:
            continue
        elif one.silence_s > (RESTART_S if fault.component == EVERYTHING else RECOVERY_S):
            yield fault.at, f"{text}: nobody acted for {one.silence_s:.1f} s"
        else:
            yield None


def _check_failures(events: Sequence[Event]) -> _Findings:
    for _component in {one.component for one in _of(Measured, events)}:
        yield None
    for one in _of(Failed, events):
        yield one.at, f"{one.component}: {one.text}"


def _check_replay(events: Sequence[Event]) -> _Findings:
    for one in _of(Replayed, events):
        yield (one.at, f"{one.item}: {one.difference}") if one.difference else None


_CHECKS: Mapping[str, Callable[[Sequence[Event]], _Findings]] = {
    ONE_END: _check_ends,
    FEEDBACK_STORED: _check_feedback,
    SETTINGS_STORED: _check_settings,
    ONE_ACTS: _check_acts,
    NO_GROWTH: _check_growth,
    RECOVERY: _check_recovery,
    NO_FAILURE: _check_failures,
    REPLAY: _check_replay,
}
PROMISES = tuple(_CHECKS)
