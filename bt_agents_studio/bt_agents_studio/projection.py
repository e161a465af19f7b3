# SPDX-License-Identifier: Apache-2.0
"""Projection of a system's messages, received now or recorded, into the store of a studio."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Origin
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_studio.records import (
    AgentRecord,
    BidRecord,
    FileRecord,
    HostRecord,
    Json,
    LogRecord,
    MarketRecord,
    MoodRecord,
    MoodRuleRecord,
    NodeRecord,
    PresetRecord,
    ProblemRecord,
    ProfileRecord,
    ProfileStepRecord,
    QuestionRecord,
    QuestionsRecord,
    RefusedBidRecord,
    RoundRecord,
    RunRecord,
    SceneRecord,
    StrategyRecord,
    TreeNodeRecord,
    TreeRecord,
    TunableRecord,
    TuningRecord,
    TuningsRecord,
    ValueRecord,
)
from bt_agents_studio.store import Store

_ORIGINS = tuple(one.name for one in Origin)
_STOPPERS = tuple(one.name for one in StoppedBy)
_FEEDBACKS = tuple(one.name for one in FeedbackKind)
_STATES = ("IDLE", "BIDDING", "AWARDING", "RUNNING", "CANCELLING", "COLLECTING")
_STATUSES = ("INVALID", "RUNNING", "SUCCESS", "FAILURE")
_EVENTS = ("", "STARTED", "CANCELLING", "ENDED", "REFUSED")
_OUTCOMES = ("NONE", "SUCCEEDED", "FAILED", "CANCELLED", "LOST")
_DECISIONS = ("", "AWARDED", "NO_BIDS", "PREEMPTS", "WAITS")
_CLOSINGS = ("", "ALL_ANSWERED", "DEADLINE", "STOPPED")
_KINDS = ("TUNABLE", "LEARNING_RATE", "TICK_RATE")
_TYPES = ("NUMBER", "DURATION", "LENGTH", "ANGLE", "INTEGER", "BOOLEAN", "TEXT")

_VALUE_FIELDS = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value"}


class Projection:
    """Messages → entries of a store; messages are read by the names of their fields only.

    Args:
        store: Where the entries go.
        mood: The scene parameter that is the mood; empty for none.
    """

    def __init__(self, store: Store, mood: str = "") -> None:
        self._store = store
        self._mood = mood
        self._lines = 0
        self._moods = 0
        self._handlers: Mapping[str, Callable[[Any, float], None]] = {
            "bt_agents_interfaces/msg/AgentFiles": self._files,
            "bt_agents_interfaces/msg/Auction": self._auction,
            "bt_agents_interfaces/msg/Feedback": self._feedback,
            "bt_agents_interfaces/msg/HostCard": self._card,
            "bt_agents_interfaces/msg/MarketStatus": self._market,
            "bt_agents_interfaces/msg/OpenQuestions": self._questions,
            "bt_agents_interfaces/msg/Profiles": self._profiles,
            "bt_agents_interfaces/msg/Run": self._run,
            "bt_agents_interfaces/msg/Scene": self._scene,
            "bt_agents_interfaces/msg/SceneEnd": self._scene_end,
            "bt_agents_interfaces/msg/TreeStatus": self._tree_status,
            "bt_agents_interfaces/msg/Trees": self._trees,
            "bt_agents_interfaces/msg/Tunables": self._tunables,
            "bt_agents_interfaces/msg/Tunings": self._tunings,
            "std_msgs/msg/String": self._act,
        }

    @property
    def types(self) -> tuple[str, ...]:
        """Types of the messages that it reads, ``package/msg/Name``."""
        return tuple(self._handlers)

    def handle(self, kind: str, message: Any, at_s: float, *, live: bool = False) -> None:
        """Take a message of a type that was sent at a time [s since 1970].

        Args:
            kind: ``package/msg/Name``; others change nothing.
            message: With the fields of the type as attributes.
            at_s: When it was sent.
            live: A ``Scene`` is the live scene of a run.
        """
        if live:
            self._live(message, at_s)
        elif (handler := self._handlers.get(kind)) is not None:
            handler(message, at_s)

    def _market(self, message: Any, at_s: float) -> None:
        del at_s
        self._store.put(
            "market",
            "",
            MarketRecord(
                epoch=message.epoch,
                state=_name(_STATES, message.state),
                since_s=_seconds(message.stamp),
                round=int(message.round),
                scene_id=message.scene_id,
                scene_label=message.scene_label,
                agent=message.agent,
                host=message.host,
                waiting=tuple(message.waiting),
                awaited_hosts=tuple(getattr(message, "awaited_hosts", ())),
                hosts=int(message.hosts),
                agents=int(message.agents),
                strategy=message.strategy,
                shadow_strategy=message.shadow_strategy,
                strategies=tuple(
                    StrategyRecord(
                        name=one.name, description=one.description, options=tuple(one.options)
                    )
                    for one in message.strategies
                ),
                pinned=message.pinned,
                vetoed=tuple(message.vetoed),
                starved=tuple(message.starved),
                problems=_problems(message.problems),
                message=message.message,
            ),
        )

    def _scene(self, message: Any, at_s: float) -> None:
        record = _scene(message)
        self._store.put("scene", "", record)
        self._log(at_s, "scene", text=record.label or record.scene_id)

    def _live(self, message: Any, at_s: float) -> None:
        record = _scene(message)
        self._store.put("live", "", record)
        mood = next((one.value for one in record.values if one.name == self._mood), None)
        if mood is not None:
            self._moods += 1
            self._store.put("moods", str(self._moods), MoodRecord(at_s=at_s, mood=mood))

    def _auction(self, message: Any, at_s: float) -> None:
        record = _round(message)
        self._store.put("rounds", f"{record.epoch}/{record.round}", record)
        if not record.preview:
            self._log(at_s, "market", agent=record.winner, text=record.reason)

    def _run(self, message: Any, at_s: float) -> None:
        event = _name(_EVENTS, message.event)
        before = self._store.get("runs", message.agent)
        same = (
            isinstance(before, RunRecord)
            and (before.epoch, before.round) == (message.epoch, message.round)
            and before
        )
        if event == "STARTED" and not same:
            self._begin(message.agent)
        stamp = _seconds(message.stamp)
        record = RunRecord(
            agent=message.agent,
            host=message.host,
            host_instance=message.host_instance,
            epoch=message.epoch,
            round=int(message.round),
            scene_id=message.scene.scene_id,
            scene_label=message.scene.label,
            event=event,
            outcome=_name(_OUTCOMES, message.outcome),
            stopped_by=_name(_STOPPERS, message.stopped_by),
            stop_reason=message.stop_reason,
            message=message.message,
            began_s=same.began_s if same else stamp - float(message.duration_s),
            ended_s=stamp if event in ("ENDED", "REFUSED") else None,
            tick=same.tick if same else 0,
            tip=same.tip if same else "",
            orphans=tuple(message.orphans),
            ticks=int(message.ticks),
            overruns=int(message.overruns),
            duration_s=float(message.duration_s),
        )
        self._store.put("runs", message.agent, record)
        self._log(at_s, "run", agent=message.agent, text=f"{event.lower()}: {message.message}")

    def _begin(self, agent: str) -> None:
        """Forget what the nodes of an agent did in the run before."""
        self._store.clear("nodes", f"{agent}|")
        self._store.clear("moods")

    def _tree_status(self, message: Any, at_s: float) -> None:
        stamp = _seconds(message.stamp) or at_s
        run = self._store.get("runs", message.agent)
        ours = isinstance(run, RunRecord) and (run.epoch, run.round) == (
            message.epoch,
            message.round,
        )
        if not ours:
            # The first tick may be received before the market announces the run.
            self._begin(message.agent)
            run = _unannounced(message, stamp)
        assert isinstance(run, RunRecord)
        self._store.put(
            "runs", message.agent, replace(run, tick=int(message.tick), tip=message.tip)
        )
        for change in message.changes:
            self._node(message, change, stamp)

    def _node(self, message: Any, change: Any, stamp: float) -> None:
        key = f"{message.agent}|{change.path}"
        before = self._store.get("nodes", key)
        if not isinstance(before, NodeRecord):
            before = _NEW
        status = _name(_STATUSES, change.status)
        failed = status == "FAILURE"
        self._store.put(
            "nodes",
            key,
            NodeRecord(
                status=status,
                message=change.message,
                since_s=stamp,
                tick=int(message.tick),
                # One that ends in the tick in which it begins is not reported as running before.
                starts=before.starts
                + (status == "RUNNING" or (before.status != "RUNNING" and status != "INVALID")),
                successes=before.successes + (status == "SUCCESS"),
                failures=before.failures + failed,
                busy_s=before.busy_s
                + (max(stamp - before.since_s, 0.0) if before.status == "RUNNING" else 0.0),
                reason=change.message if failed else before.reason,
            ),
        )
        if status in ("SUCCESS", "FAILURE") and "@" not in change.path.rpartition("/")[2]:
            text = f"{change.name}: {status.lower()}"
            text += f" ({change.message})" if change.message else ""
            self._log(stamp, "tree", agent=message.agent, path=change.path, text=text)

    def _trees(self, message: Any, at_s: float) -> None:
        del at_s
        named = {one.agent for one in message.trees}
        for agent in self._store.keys("trees"):
            tree = self._store.get("trees", agent)
            if isinstance(tree, TreeRecord) and tree.host == message.host and agent not in named:
                self._store.remove("trees", agent)
        for one in message.trees:
            nodes = tuple(
                TreeNodeRecord(
                    path=node.path,
                    parent=int(node.parent),
                    kind=node.kind,
                    name=node.name,
                    file=node.file,
                    line=int(node.line),
                    column=int(node.column),
                )
                for node in one.nodes
            )
            self._store.put(
                "trees", one.agent, TreeRecord(agent=one.agent, host=message.host, nodes=nodes)
            )

    def _card(self, message: Any, at_s: float) -> None:
        names = tuple(one.name for one in message.agents)
        before = self._store.get("hosts", message.host)
        if isinstance(before, HostRecord):
            for name in set(before.agents) - set(names):
                self._store.remove("agents", name)
            for name in sorted(set(names) - set(before.agents)):
                self._log(at_s, "host", agent=name, text=f"{name} is there")
        self._store.put(
            "hosts",
            message.host,
            HostRecord(
                host=message.host,
                instance=message.host_instance,
                trees=message.trees,
                agents=names,
                broken_files=tuple(message.broken_files),
                problems=_problems(message.problems),
            ),
        )
        for one in message.agents:
            self._store.put("agents", one.name, _agent(one, message.host, message.parameters))

    def _profiles(self, message: Any, at_s: float) -> None:
        del at_s
        width = len(message.parameters)
        held = set()
        for index, agent in enumerate(message.agents):
            layer = message.layers[index]
            key = f"{agent}|{layer}"
            held.add(key)
            vector = message.vectors[index * width : (index + 1) * width]
            record = ProfileRecord(
                agent=agent,
                layer=layer,
                revision=int(message.revisions[index]),
                values=_values(message.parameters, vector),
            )
            self._store.put("profiles", key, record)
        for key in set(self._store.keys("profiles")) - held:
            self._store.remove("profiles", key)

    def _feedback(self, message: Any, at_s: float) -> None:
        record = ProfileStepRecord(
            at_s=_seconds(message.stamp),
            agent=message.agent,
            layer=message.layer,
            kind=_name(_FEEDBACKS, message.kind),
            source=message.source,
            reason=message.reason,
            round=int(message.round),
            leaf=message.leaf,
            parameters=tuple(message.parameters),
            before=_numbers(message.before),
            after=_numbers(message.after),
            target=_numbers(message.target),
            weight=float(message.weight),
            learning_rate=float(message.learning_rate),
            revision=int(message.revision),
            false_rate=_number(message.false_rate),
            cancels=bool(message.cancels),
        )
        key = f"{message.agent}|{message.layer}|{message.revision}"
        self._store.put("feedback", key, record)
        text = f"{record.kind.lower()} by {record.source}"
        text += f": {record.reason}" if record.reason else ""
        self._log(at_s, "feedback", agent=message.agent, path=message.leaf, text=text)

    def _scene_end(self, message: Any, at_s: float) -> None:
        text = f"'{message.scene_id}' {message.code}: {message.message}"
        self._log(at_s, "scene", agent=message.agent, text=text)

    def _act(self, message: Any, at_s: float) -> None:
        self._log(at_s, "robot", text=message.data)

    def _questions(self, message: Any, at_s: float) -> None:
        del at_s
        questions = tuple(
            QuestionRecord(at_s=_seconds(one.stamp), text=one.text, choices=tuple(one.choices))
            for one in message.questions
        )
        self._store.put("questions", "", QuestionsRecord(questions=questions))

    def _files(self, message: Any, at_s: float) -> None:
        del at_s
        for file, text in zip(message.files, message.texts, strict=True):
            self._store.put("files", file, FileRecord(text=text))
        for file in set(self._store.keys("files")) - set(message.files):
            self._store.remove("files", file)

    def _tunables(self, message: Any, at_s: float) -> None:
        del at_s
        held = set()
        for one in message.tunables:
            key = f"{message.host}|{one.name}"
            held.add(key)
            default = _parameter(one.default_value)
            before = self._store.get("tunables", key)
            value = before.value if isinstance(before, TunableRecord) else default
            self._store.put(
                "tunables",
                key,
                TunableRecord(
                    name=one.name,
                    host=message.host,
                    agent=one.agent,
                    key=one.key,
                    kind=_name(_KINDS, one.kind),
                    type=_name(_TYPES, one.type),
                    unit=one.unit,
                    default=default,
                    value=value,
                    minimum=_number(one.minimum) if one.has_range else None,
                    maximum=_number(one.maximum) if one.has_range else None,
                    step=float(one.step) if one.has_range else 0.0,
                    description=one.description,
                ),
            )
        for key in self._store.keys("tunables"):
            if key.startswith(f"{message.host}|") and key not in held:
                self._store.remove("tunables", key)

    def value(self, host: str, name: str, value: Json) -> None:
        """Take the current value of a parameter of a host; one that is no tunable is left out."""
        key = f"{host}|{name}"
        record = self._store.get("tunables", key)
        if isinstance(record, TunableRecord):
            self._store.put("tunables", key, replace(record, value=value))

    def _tunings(self, message: Any, at_s: float) -> None:
        before = self._store.get("tunings", message.host)
        newest = before.revision if isinstance(before, TuningsRecord) else message.revision
        tunings = tuple(
            TuningRecord(
                at_s=_seconds(one.stamp),
                revision=int(one.revision),
                author=one.author,
                reason=one.reason,
                name=one.name,
                before=one.before,
                after=one.after,
                undoable=bool(one.undoable),
            )
            for one in message.tunings
        )
        self._store.put(
            "tunings",
            message.host,
            TuningsRecord(
                revision=int(message.revision),
                tunings=tunings,
                undo=message.undo,
                redo=message.redo,
                presets=tuple(
                    PresetRecord(
                        name=one.name, values=dict(zip(one.names, one.values, strict=True))
                    )
                    for one in message.presets
                ),
            ),
        )
        for one in tunings:
            if one.revision > newest:
                text = f"{one.name}: {one.before} → {one.after} by {one.author}"
                self._log(at_s, "tuning", text=text)

    def _log(self, at_s: float, kind: str, *, text: str, agent: str = "", path: str = "") -> None:
        self._lines += 1
        record = LogRecord(at_s=at_s, kind=kind, agent=agent, path=path, text=text)
        self._store.put("log", str(self._lines), record)


_NEW = NodeRecord(
    status="INVALID",
    message="",
    since_s=0.0,
    tick=0,
    starts=0,
    successes=0,
    failures=0,
    busy_s=0.0,
    reason="",
)


def _unannounced(message: Any, stamp: float) -> RunRecord:
    return RunRecord(
        agent=message.agent,
        host="",
        host_instance=message.host_instance,
        epoch=message.epoch,
        round=int(message.round),
        scene_id="",
        scene_label="",
        event="STARTED",
        outcome="NONE",
        stopped_by="NOT_SAID",
        stop_reason="",
        message="",
        began_s=stamp,
        ended_s=None,
        tick=0,
        tip="",
        orphans=(),
        ticks=0,
        overruns=0,
        duration_s=0.0,
    )


def _scene(message: Any) -> SceneRecord:
    return SceneRecord(
        at_s=_seconds(message.stamp),
        scene_id=message.scene_id,
        label=message.label,
        person=bool(message.person),
        urgent=bool(message.urgent),
        person_id=message.person_id,
        place=message.place,
        persons=int(message.persons),
        visits=int(message.visits),
        remembered={one.key: _parameter(one.value) for one in message.remembered},
        values=tuple(
            ValueRecord(
                name=one.name,
                value=_number(one.value),
                origin=_name(_ORIGINS, one.origin),
                age_s=_number(one.age_s),
                std=_number(one.std),
                confidence=float(one.confidence),
                source=one.source,
            )
            for one in message.values
        ),
    )


def _round(message: Any) -> RoundRecord:
    return RoundRecord(
        at_s=_seconds(message.stamp),
        epoch=message.epoch,
        round=int(message.round),
        follows=int(message.follows),
        scene=_scene(message.scene),
        outcome=_name(_DECISIONS, message.outcome),
        closed_by=_name(_CLOSINGS, message.closed_by),
        preview=bool(message.preview),
        duration_s=float(message.duration_s),
        strategy=message.strategy,
        options=_values(message.option_names, message.option_values, missing=False),
        intervention=message.intervention,
        ranking=tuple(
            BidRecord(
                agent=one.agent,
                host=one.host,
                vector=tuple(float(value) for value in one.vector),
                contributions=tuple(float(value) for value in one.contributions),
                distance=_number(one.distance),
                bonus=float(one.bonus),
                score=_number(one.score),
                runs=int(one.runs),
                calculation=one.calculation,
            )
            for one in message.ranking
        ),
        refused=tuple(
            RefusedBidRecord(
                agent=one.agent,
                host=one.host,
                declined=one.kind == 0,
                code=one.code,
                reason=one.reason,
            )
            for one in message.refused
        ),
        silent_hosts=tuple(message.silent_hosts),
        winner=message.winner,
        margin=_number(message.margin),
        shadow_strategy=message.shadow_strategy,
        shadow_winner=message.shadow_winner,
        change=_values(message.change_names, message.change_values, missing=False),
        reason=message.reason,
        explanation=message.explanation,
    )


def _agent(card: Any, host: str, parameters: Sequence[str]) -> AgentRecord:
    return AgentRecord(
        name=card.name,
        title=card.title,
        description=card.description,
        tags=tuple(card.tags),
        host=host,
        profile=_values(parameters, card.profile),
        current=_values(parameters, card.current),
        revision=int(card.revision),
        learning_rate=float(card.learning_rate),
        rules=tuple(
            MoodRuleRecord(
                when=one.when,
                hold_s=float(one.hold_s),
                give=_name(_FEEDBACKS, one.give),
                cancels=one.action == 1,
            )
            for one in card.rules
        ),
        version=int(card.version),
        waiting=bool(card.waiting),
        degraded=bool(card.degraded),
        problems=_problems(card.problems),
    )


def _problems(messages: Iterable[Any]) -> tuple[ProblemRecord, ...]:
    return tuple(
        ProblemRecord(agent=one.agent, file=one.file, line=int(one.line), message=one.message)
        for one in messages
    )


def _values(
    names: Sequence[str], values: Sequence[float], *, missing: bool = True
) -> dict[str, Any]:
    pairs = zip(names, _numbers(values), strict=False)
    return {name: value for name, value in pairs if missing or value is not None}


def _numbers(values: Iterable[float]) -> tuple[float | None, ...]:
    return tuple(_number(value) for value in values)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _parameter(value: Any) -> Json:
    field = _VALUE_FIELDS.get(int(value.type))
    if field is None:
        return None
    found: Json = getattr(value, field)
    return _number(found) if isinstance(found, float) else found


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _name(names: Sequence[str], number: int) -> str:
    return names[number] if 0 <= number < len(names) else str(number)
