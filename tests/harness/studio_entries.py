# SPDX-License-Identifier: Apache-2.0
"""Entries of a studio, as of a system with two agents."""

from __future__ import annotations

import time
from typing import Any

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
        "step": 0.0,
        "description": "how long to wait",
    }
    name = f"{agent}.{key}"
    given = {"name": name, "host": HOST, "agent": agent, "key": key, "value": value}
    return TunableRecord(**described | given | fields)


def tunings(revision: int = 0, *presets: PresetRecord, changes: int = 0) -> TuningsRecord:
    """Return the changes of the host, some of them in its history."""
    listed = tuple(
        TuningRecord(
            at_s=time.time(),
            revision=number,
            author="somebody",
            reason="",
            name="guide.patience",
            before="8 s",
            after=f"{number} s",
            undoable=True,
        )
        for number in range(1, changes + 1)
    )
    return TuningsRecord(revision=revision, tunings=listed, undo="", redo="", presets=presets)


def agent(name: str, title: str = "") -> AgentRecord:
    return AgentRecord(
        name=name,
        title=title,
        description="Waits.",
        tags=(),
        host=HOST,
        profile={"age": 1.0, "mood": 3.0},
        current={"age": 1.23456789, "mood": 3.0},
        revision=1,
        learning_rate=0.5,
        rules=(),
        version=1,
        waiting=False,
        degraded=False,
        problems=(),
    )


def run(name: str, began_s: float = 0.0) -> RunRecord:
    """Return a run in progress."""
    return RunRecord(
        **dict.fromkeys(("host_instance", "epoch", "scene_id", "scene_label"), "x"),
        **dict.fromkeys(("stop_reason", "message", "tip"), ""),
        **dict.fromkeys(("ticks", "overruns"), 0),
        agent=name,
        host=HOST,
        round=1,
        event="STARTED",
        outcome="NONE",
        stopped_by="NOT_SAID",
        began_s=began_s or time.time(),
        ended_s=None,
        tick=1,
        orphans=(),
        duration_s=0.0,
    )


def market() -> MarketRecord:
    return MarketRecord(
        **dict.fromkeys(("scene_id", "scene_label", "agent", "host", "pinned", "message"), ""),
        epoch="x",
        state="IDLE",
        since_s=time.time(),
        round=1,
        waiting=(),
        awaited_hosts=(),
        hosts=1,
        agents=2,
        strategy="manhattan",
        shadow_strategy="",
        strategies=(),
        vetoed=(),
        starved=(),
        problems=(),
    )


def scene(label: str = "somebody") -> SceneRecord:
    values = tuple(
        ValueRecord(
            name=name, value=2.5, origin="GIVEN", age_s=0.0, std=0.0, confidence=1.0, source="hand"
        )
        for name in ("age", "mood")
    )
    return SceneRecord(
        at_s=time.time(),
        scene_id="0" * 32,
        label=label,
        person=True,
        urgent=False,
        person_id="",
        place="",
        persons=1,
        visits=1,
        remembered={},
        values=values,
    )


def auction(*agents: str) -> RoundRecord:
    """Return a round, which the first of some agents has won."""
    bids = tuple(
        BidRecord(
            agent=name,
            host=HOST,
            vector=(1.0, 3.0),
            contributions=(1.5, 0.5),
            distance=2.0,
            bonus=0.0,
            score=2.0,
            runs=1,
            calculation="|1.0 − 2.5| + |3.0 − 2.5| = 2.0",
        )
        for name in agents
    )
    return RoundRecord(
        at_s=time.time(),
        epoch="x",
        round=1,
        follows=0,
        scene=scene(),
        outcome="AWARDED",
        closed_by="ALL_BIDS",
        preview=False,
        duration_s=0.01,
        strategy="manhattan",
        options={},
        intervention="",
        ranking=bids,
        refused=(),
        silent_hosts=(),
        winner=agents[0],
        margin=0.5,
        shadow_strategy="",
        shadow_winner="",
        change={"age": 2.0},
        reason="it is the nearest",
        explanation=f"{agents[0]} is the nearest.",
    )


def profile_step(name: str, revision: int) -> ProfileStepRecord:
    return ProfileStepRecord(
        at_s=time.time(),
        agent=name,
        layer="",
        kind="POSITIVE",
        source="button",
        reason="",
        round=1,
        leaf="",
        parameters=("age", "mood"),
        before=(1.0, 3.0),
        after=(1.1, 3.0),
        target=(2.5, 2.5),
        weight=1.0,
        learning_rate=0.5,
        revision=revision,
        false_rate=None,
        cancels=False,
    )


def question(text: str, *choices: str) -> QuestionsRecord:
    asked = QuestionRecord(at_s=time.time(), text=text, choices=choices)
    return QuestionsRecord(questions=(asked,))


def awaited() -> ListeningRecord:
    return ListeningRecord(
        type="std_msgs/msg/String", fields={"data": "string", "a_field_with_a_name": "float64"}
    )


def recording() -> RecordingRecord:
    return RecordingRecord(
        since_s=time.time(),
        recording=True,
        folder="journal",
        file="2026.mcap",
        label="",
        notes="",
        author="",
        bookmarks=0,
    )


def event(lane: str, kind: str, began_s: float, ended_s: float | None, text: str) -> EventRecord:
    """Return an event of the timeline, about the guide."""
    return EventRecord(
        lane=lane, kind=kind, agent="guide", text=text, began_s=began_s, ended_s=ended_s
    )
