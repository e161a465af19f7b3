# SPDX-License-Identifier: Apache-2.0
"""Entries of a studio, as of a system with two agents."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, TypeVar, get_origin, get_type_hints

from bt_agents_studio.records import (
    AgentRecord,
    BidRecord,
    EventRecord,
    Json,
    ListeningRecord,
    MarketRecord,
    PartRecord,
    PresetRecord,
    ProfileStepRecord,
    QuestionRecord,
    QuestionsRecord,
    RecordingRecord,
    RoundRecord,
    RunRecord,
    SceneRecord,
    TunableRecord,
    TuningRecord,
    TuningsRecord,
    ValueRecord,
)

HOST = "/agents"
RecordT = TypeVar("RecordT")

_EMPTY: dict[Any, Any] = {str: "", int: 0, float: 0.0, bool: False, tuple: (), Mapping: {}}
_TIMES = ("at_s", "since_s")


def filled(kind: type[RecordT], /, **fields: Any) -> RecordT:
    """Return a record with these fields; all others are empty, except that times are now."""
    hints = get_type_hints(kind)
    empty = {name: _EMPTY.get(get_origin(hint) or hint) for name, hint in hints.items()}
    times = {name: time.time() for name in _TIMES if name in hints}
    return kind(**empty | times | fields)


def part(*, alive: bool = True) -> PartRecord:
    return PartRecord(alive=alive, seen_s=time.time())


def tunable(agent: str, key: str, value: Json, **fields: Any) -> TunableRecord:
    """Return a time of an agent, from 0 s to 30 s."""
    described: dict[str, Any] = {
        "kind": "TUNABLE",
        "type": "DURATION",
        "unit": "s",
        "default": value,
        "minimum": 0.0,
        "maximum": 30.0,
        "description": "how long to wait",
    }
    named = {"name": f"{agent}.{key}", "host": HOST, "agent": agent, "key": key, "value": value}
    return filled(TunableRecord, **described | named | fields)


def tunings(revision: int = 0, *presets: PresetRecord, changes: int = 0) -> TuningsRecord:
    """Return the changes of the host, some of them in its history."""
    listed = tuple(
        filled(
            TuningRecord,
            revision=number,
            author="somebody",
            name="guide.patience",
            before="8 s",
            after=f"{number} s",
            undoable=True,
        )
        for number in range(1, changes + 1)
    )
    return filled(TuningsRecord, revision=revision, tunings=listed, presets=presets)


def agent(name: str, title: str = "") -> AgentRecord:
    return filled(
        AgentRecord,
        name=name,
        title=title,
        description="Waits.",
        host=HOST,
        profile={"age": 1.0, "mood": 3.0},
        current={"age": 1.23456789, "mood": 3.0},
        revision=1,
        learning_rate=0.5,
        version=1,
    )


def run(name: str, began_s: float = 0.0, *, tip: str = "") -> RunRecord:
    """Return a run in progress."""
    return filled(
        RunRecord,
        **dict.fromkeys(("host_instance", "epoch", "scene_id", "scene_label"), "x"),
        agent=name,
        host=HOST,
        round=1,
        event="STARTED",
        outcome="NONE",
        stopped_by="NOT_SAID",
        began_s=began_s or time.time(),
        tick=1,
        tip=tip,
    )


def market() -> MarketRecord:
    return filled(
        MarketRecord, epoch="x", state="IDLE", round=1, hosts=1, agents=2, strategy="manhattan"
    )


def scene(label: str = "somebody") -> SceneRecord:
    known = {"value": 2.5, "origin": "GIVEN", "age_s": 0.0, "std": 0.0, "confidence": 1.0}
    values = tuple(
        filled(ValueRecord, name=name, source="hand", **known) for name in ("age", "mood")
    )
    number = "0" * 32
    return filled(
        SceneRecord, scene_id=number, label=label, person=True, persons=1, visits=1, values=values
    )


def auction(*agents: str) -> RoundRecord:
    """Return a round, which the first of some agents has won."""
    bids = tuple(
        filled(
            BidRecord,
            agent=name,
            host=HOST,
            vector=(1.0, 3.0),
            contributions=(1.5, 0.5),
            distance=2.0,
            score=2.0,
            runs=1,
            calculation="|1.0 − 2.5| + |3.0 − 2.5| = 2.0",
        )
        for name in agents
    )
    return filled(
        RoundRecord,
        epoch="x",
        round=1,
        scene=scene(),
        outcome="AWARDED",
        closed_by="ALL_ANSWERED",
        duration_s=0.01,
        strategy="manhattan",
        ranking=bids,
        winner=agents[0],
        margin=0.5,
        change={"age": 2.0},
        reason="it is the nearest",
        explanation=f"{agents[0]} is the nearest.",
    )


def profile_step(name: str, revision: int) -> ProfileStepRecord:
    return filled(
        ProfileStepRecord,
        agent=name,
        kind="POSITIVE",
        source="button",
        round=1,
        parameters=("age", "mood"),
        before=(1.0, 3.0),
        after=(1.1, 3.0),
        target=(2.5, 2.5),
        weight=1.0,
        learning_rate=0.5,
        revision=revision,
    )


def question(text: str, *choices: str) -> QuestionsRecord:
    return QuestionsRecord(questions=(filled(QuestionRecord, text=text, choices=choices),))


def awaited() -> ListeningRecord:
    return ListeningRecord(
        type="std_msgs/msg/String", fields={"data": "string", "a_field_with_a_name": "float64"}
    )


def recording() -> RecordingRecord:
    return filled(RecordingRecord, recording=True, folder="journal", file="2026.mcap")


def event(lane: str, kind: str, began_s: float, ended_s: float | None, text: str) -> EventRecord:
    """Return an event of the timeline, about the guide."""
    return EventRecord(
        lane=lane, kind=kind, agent="guide", text=text, began_s=began_s, ended_s=ended_s
    )
