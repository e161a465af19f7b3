# SPDX-License-Identifier: Apache-2.0
"""Projection of a system's messages, received now or recorded, into the store of a studio."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from typing import Any

from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.health import Health
from bt_agents_core.scene import Origin
from bt_agents_core.scene_labels import SceneLabels
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_language.expression.expression_tokens import ExpressionError
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.expression.quantities import QuantityError, number, quantity, quantity_type
from bt_agents_language.yaml.scalars import boolean
from bt_agents_studio.records import (
    OF_A_HOST,
    OF_A_RUN,
    OF_AN_AGENT,
    ROLLING,
    STOPPED,
    UNKNOWN,
    AgentRecord,
    BidRecord,
    BookmarkRecord,
    ControlRecord,
    CountdownRecord,
    EventRecord,
    FileRecord,
    HealthRecord,
    HostRecord,
    Json,
    ListeningRecord,
    LogRecord,
    MarketRecord,
    MoodRecord,
    MoodRuleRecord,
    NodeRecord,
    NodeValueRecord,
    NodeValuesRecord,
    PartRecord,
    PresetRecord,
    ProblemRecord,
    ProfileRecord,
    ProfileStepRecord,
    QuestionRecord,
    QuestionsRecord,
    RecordingRecord,
    RefusedBidRecord,
    RobotActRecord,
    RobotRecord,
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
from bt_agents_studio.store import MOST_ENTRIES, Store

_ORIGINS = tuple(one.name for one in Origin)
_STOPPERS = tuple(one.name for one in StoppedBy)
_FEEDBACKS = tuple(one.name for one in FeedbackKind)
_STATES = ("IDLE", "BIDDING", "AWARDING", "RUNNING", "CANCELLING", "COLLECTING")
_STATUSES = ("INVALID", "RUNNING", "SUCCESS", "FAILURE")
_EVENTS = ("", "STARTED", "CANCELLING", "ENDED", "REFUSED")
_OUTCOMES = ("NONE", "SUCCEEDED", "FAILED", "CANCELLED", "LOST")
_DECISIONS = ("", "AWARDED", "NO_BIDS", "PREEMPTS", "WAITS")
_ACTS = ("", "SAY", "ASK", "SHOW", "DRIVE")
_CLOSINGS = ("", "ALL_ANSWERED", "DEADLINE", "STOPPED")
_LEVELS = tuple(level.name for level in Health)
_KINDS = ("TUNABLE", "LEARNING_RATE", "TICK_RATE")
_TYPES = ("NUMBER", "DURATION", "LENGTH", "ANGLE", "INTEGER", "BOOLEAN", "TEXT")

UNTOLD_S = 5.0
"""Time without news after which the health of a part is stale [s]."""

ROOM = "studio: room"
"""Name in the health of what there was no room for."""

FAILURES = "studio: messages"
"""Name in the health of the messages that could not be shown."""

RECORDING = "recording"
"""Key of the event of the recording that goes on."""

_FULL = "not all that was sent is shown: there was too much of it"
_FAILED = "some messages cannot be shown; the first of each type is in the log of the studio"
_MOST_FAILURES = 30
"""Types of messages that could not be shown, at most."""

_LONGEST_LINE = 1000
_LONGEST_EVENT = 200
_MOST_STATUSES = 500
_LONGEST_NAME = 200
_LONGEST_HEALTH = 500

_TIME, _ATTEMPTS = 1, 2
"""Units of countdowns."""

_MOST_VALUES = 40
"""Values that are shown of a node, the newest."""

_ABOVE, _WITHIN = re.compile("/"), re.compile("[/@]|$")
"""Ends of the paths of what is above a node, and of what it is within."""

_DEEPEST = 200
"""Ends in a path that are looked at."""

_MOST_CONDITIONS = 1000
_LONGEST_CONDITION = 80
"""Characters of a condition of which the thresholds are sought."""

_LARGEST_CHANGE = 1000.0
_HALVINGS = 32

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
        self._names = SceneLabels()
        self._lines = 0
        self._moods = 0
        self._heard: dict[str, float] = {}
        # Type of a message that could not be shown → how many, and the first reason.
        self._failed: dict[str, tuple[int, str]] = {}
        self._handlers: Mapping[str, Callable[[Any, float], None]] = {
            "bt_agents_interfaces/msg/AgentFiles": self._files,
            "bt_agents_interfaces/msg/Auction": self._auction,
            "bt_agents_interfaces/msg/Bookmark": self._bookmark,
            "bt_agents_interfaces/msg/Feedback": self._feedback,
            "bt_agents_interfaces/msg/HostCard": self._card,
            "bt_agents_interfaces/msg/MarketStatus": self._market,
            "bt_agents_interfaces/msg/NodeDetails": self._details,
            "bt_agents_interfaces/msg/OpenQuestions": self._questions,
            "bt_agents_interfaces/msg/Profiles": self._profiles,
            "bt_agents_interfaces/msg/RobotState": self._robot,
            "bt_agents_interfaces/msg/RecordingStatus": self._recording,
            "bt_agents_interfaces/msg/Run": self._run,
            "bt_agents_interfaces/msg/RunControl": self._control,
            "bt_agents_interfaces/msg/Scene": self._scene,
            "bt_agents_interfaces/msg/SceneEnd": self._scene_end,
            "bt_agents_interfaces/msg/TreeStatus": self._tree_status,
            "bt_agents_interfaces/msg/Trees": self._trees,
            "bt_agents_interfaces/msg/Tunables": self._tunables,
            "bt_agents_interfaces/msg/Tunings": self._tunings,
            "diagnostic_msgs/msg/DiagnosticArray": self._health,
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

    def fail(self, what: str, error: Exception, at_s: float) -> bool:
        """Note that a message of a type could not be shown; return whether it is the first."""
        if what not in self._failed and len(self._failed) >= _MOST_FAILURES:
            what = "others"
        reason = f"{type(error).__name__}: {printable_line(str(error))}"[:_LONGEST_NAME]
        count, first = self._failed.get(what, (0, reason))
        self._failed[what] = (count + 1, first)
        if count == 0:
            # Later ones are counted, but not told at once: there may be very many of them.
            self._put_failures(at_s)
        return count == 0

    def _put_failures(self, at_s: float) -> None:
        values = {
            name: f"{count}, first: {reason}" for name, (count, reason) in self._failed.items()
        }
        self._put_health(
            FAILURES,
            HealthRecord(level=Health.ERROR.name, message=_FAILED, values=values, since_s=at_s),
        )

    def _market(self, message: Any, at_s: float) -> None:
        del at_s
        self._store.put(
            "market",
            "",
            MarketRecord(
                epoch=message.epoch,
                state=_name(_STATES, message.state),
                since_s=_seconds(message.header.stamp),
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
        self._names.add(message)
        if not self._is_running():
            self._store.put("scene", "", record)
        self._log(at_s, "scene", text=self._names.name_of(record.scene_id))

    def _is_running(self) -> bool:
        runs = (self._store.get("runs", agent) for agent in self._store.keys("runs"))
        return any(isinstance(run, RunRecord) and run.ended_s is None for run in runs)

    def _live(self, message: Any, at_s: float) -> None:
        record = _scene(message)
        self._store.put("live", "", record)
        mood = next((one.value for one in record.values if one.name == self._mood), None)
        if mood is not None:
            self._moods += 1
            self._store.put("moods", str(self._moods), MoodRecord(at_s=at_s, mood=mood))

    def _auction(self, message: Any, at_s: float) -> None:
        record = round_record(message)
        self._names.add(message.scene)
        self._store.put("rounds", f"{record.epoch}/{record.round}", record)
        if not record.preview:
            self._log(at_s, "market", agent=record.winner, text=record.reason)
            self._event(
                f"round {record.epoch}/{record.round}",
                "MARKET",
                record.outcome,
                (record.at_s, record.at_s),
                agent=record.winner,
                text=record.reason,
            )

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
        if event == "STARTED" and not (same and same.scene_id):
            self._store.put("scene", "", _scene(message.scene))
        stamp = _seconds(message.header.stamp)
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
        self._event(
            f"run {record.epoch}/{record.round}/{record.agent}",
            "AGENT",
            _kind_of_run(record),
            (record.began_s, record.ended_s),
            agent=record.agent,
            text=record.message or record.scene_label,
        )
        if record.ended_s is not None:
            self._store.clear("countdowns", f"{message.agent}|")
        if record.outcome == "LOST":
            self._lose(message.agent)
        self._log(at_s, "run", agent=message.agent, text=f"{event.lower()}: {message.message}")

    def _begin(self, agent: str) -> None:
        """Forget what the nodes of an agent did in the run before."""
        for collection in ("nodes", "countdowns", "values"):
            self._store.clear(collection, f"{agent}|")
        self._store.clear("moods")

    def _lose(self, agent: str) -> None:
        """Note that nobody knows how the nodes ended that an agent was running."""
        for key in self._store.keys("nodes"):
            record = self._store.get("nodes", key)
            if (
                key.startswith(f"{agent}|")
                and isinstance(record, NodeRecord)
                and record.status == "RUNNING"
            ):
                self._store.put("nodes", key, replace(record, status=UNKNOWN))

    def _tree_status(self, message: Any, at_s: float) -> None:
        stamp = _seconds(message.header.stamp) or at_s
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
        self._restart(message)
        stopped = self._stopped(message)
        for change in message.changes:
            self._node(message, change, stamp, stopped)

    def _restart(self, message: Any) -> None:
        """Forget what is below nodes that were stopped and start again in a tick."""
        heads = set[str]()
        for change in message.changes:
            before = self._store.get("nodes", f"{message.agent}|{change.path}")
            starts = _name(_STATUSES, change.status) != "INVALID"
            if starts and isinstance(before, NodeRecord) and before.status == STOPPED:
                heads |= {change.path, _without_modifier(change.path)}
        for key in self._store.keys("nodes") if heads else ():
            agent, _, path = key.partition("|")
            record = self._store.get("nodes", key)
            if (
                agent == message.agent
                and _begins(path, _ABOVE, heads)
                and isinstance(record, NodeRecord)
            ):
                self._store.put("nodes", key, replace(record, status="INVALID", message=""))

    def _stopped(self, message: Any) -> set[str]:
        """Return the paths of the nodes that a tick has stopped while they were running."""
        stopped = set[str]()
        statuses = dict[str, str]()
        for change in message.changes:
            before = self._store.get("nodes", f"{message.agent}|{change.path}")
            was = before.status if isinstance(before, NodeRecord) else ""
            status = _name(_STATUSES, change.status)
            if status == "INVALID" and statuses.get(change.path, was) == "RUNNING":
                stopped.add(_without_modifier(change.path))
            statuses[change.path] = status
        return stopped

    def _node(self, message: Any, change: Any, stamp: float, stopped: set[str]) -> None:
        for one in change.values:
            self._value(message, change.path, one, stamp, written=True)
        key = f"{message.agent}|{change.path}"
        before = self._store.get("nodes", key)
        if not isinstance(before, NodeRecord):
            before = _NEW
        status = _name(_STATUSES, change.status)
        if status == "INVALID" and _begins(change.path, _WITHIN, stopped):
            # What is stopped shows how far it came until it starts again.
            if before.status != "RUNNING":
                return
            status = STOPPED
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
                starts=before.starts + (before.status != "RUNNING" and status != "INVALID"),
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
            text += "".join([f", {one.name} = {one.value}" for one in change.values])
            self._log(stamp, "tree", agent=message.agent, path=change.path, text=text)

    def _details(self, message: Any, at_s: float) -> None:
        stamp = _seconds(message.header.stamp) or at_s
        run = self._store.get("runs", message.agent)
        ours = isinstance(run, RunRecord) and (run.epoch, run.round) == (
            message.epoch,
            message.round,
        )
        if isinstance(run, RunRecord) and not ours and run.began_s > stamp:
            return
        if not ours:
            # The details of the first tick may be received before its changes.
            self._begin(message.agent)
            run = _unannounced(message, stamp)
            self._store.put("runs", message.agent, run)
        for one in message.values:
            self._value(message, one.path, one, stamp, written=bool(one.written))
        assert isinstance(run, RunRecord)
        if run.ended_s is not None:
            return
        times = {one.path: one for one in message.countdowns if int(one.unit) == _TIME}
        rounds = {one.path: one for one in message.countdowns if int(one.unit) == _ATTEMPTS}
        head = f"{message.agent}|"
        left = {}
        for path, one in {**times, **rounds}.items():
            remaining_s = _number(times[path].remaining_s) if path in times else None
            before = self._store.get("countdowns", f"{head}{path}")
            left[path] = CountdownRecord(
                at_s=at_s,
                kind=one.kind,
                remaining_s=remaining_s,
                remaining=int(rounds[path].remaining) if path in rounds else None,
                whole_s=_whole(remaining_s, before),
            )
        for key in self._store.keys("countdowns"):
            if key.startswith(head) and key.removeprefix(head) not in left:
                self._store.remove("countdowns", key)
        for path, record in left.items():
            self._store.put("countdowns", f"{head}{path}", record)

    def _value(self, message: Any, path: str, value: Any, stamp: float, *, written: bool) -> None:
        key = f"{message.agent}|{path}"
        before = self._store.get("values", key)
        known = before.values if isinstance(before, NodeValuesRecord) else ()
        record = NodeValueRecord(
            at_s=stamp, tick=int(message.tick), name=value.name, value=value.value, written=written
        )
        others = [one for one in known if (one.name, one.written) != (record.name, record.written)]
        self._store.put(
            "values", key, NodeValuesRecord(values=(*others[1 - _MOST_VALUES :], record))
        )

    def _control(self, message: Any, at_s: float) -> None:
        before = self._store.get("controls", message.host)
        breakpoints: dict[str, tuple[str, ...]] = {}
        for one in message.breakpoints:
            breakpoints[one.agent] = (*breakpoints.get(one.agent, ()), one.path)
        record = ControlRecord(
            host=message.host,
            epoch=message.epoch,
            round=int(message.round),
            agent=message.agent,
            paused=bool(message.paused),
            paused_at=message.paused_at,
            author=message.author,
            since_s=_seconds(message.header.stamp) or at_s,
            breakpoints=breakpoints,
        )
        self._store.put("controls", message.host, record)
        was = (before.paused, before.paused_at) if isinstance(before, ControlRecord) else None
        if record.paused and was != (True, record.paused_at):
            text = "is paused" + (f" by {record.author}" if record.author else "")
            if record.paused_at:
                text = f"is paused before {record.paused_at}"
            self._log(at_s, "run", agent=record.agent, path=record.paused_at, text=text)
        elif was is not None and was[0] and not record.paused and record.agent:
            self._log(at_s, "run", agent=record.agent, text="goes on")

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
        records = {}
        for index, agent in enumerate(message.agents[:MOST_ENTRIES]):
            layer = message.layers[index]
            vector = message.vectors[index * width : (index + 1) * width]
            records[f"{agent}|{layer}"] = ProfileRecord(
                agent=agent,
                layer=layer,
                revision=int(message.revisions[index]),
                values=_values(message.parameters, vector),
            )
        for key, record in records.items():
            self._store.put("profiles", key, record)
        for key in set(self._store.keys("profiles")) - records.keys():
            self._store.remove("profiles", key)

    def _feedback(self, message: Any, at_s: float) -> None:
        record = ProfileStepRecord(
            at_s=_seconds(message.header.stamp),
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
        moment = (record.at_s, record.at_s)
        self._event(
            f"feedback {key}", "FEEDBACK", record.kind, moment, agent=record.agent, text=text
        )

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

    def _robot(self, message: Any, at_s: float) -> None:
        acts = tuple(
            RobotActRecord(
                at_s=_seconds(one.stamp),
                number=int(one.number),
                kind=_name(_ACTS, one.kind),
                text=one.text,
                clip=one.clip,
                choices=tuple(one.choices),
                rate=_number(one.rate) or 1.0,
                waiting=bool(one.waiting),
            )
            for one in message.acts
        )
        record = RobotRecord(
            acts=acts,
            light=message.light,
            light_blinks=bool(message.light_blinks),
            sound=message.sound,
            sounds=int(message.sounds),
        )
        before = self._store.get("robot")
        known = before.acts if isinstance(before, RobotRecord) else ()
        going_on = {(act.at_s, act.number) for act in acts}
        for act in (*known, *acts):
            place = (act.at_s, act.number)
            ended_s = None if place in going_on else _seconds(message.header.stamp) or at_s
            self._event(
                f"act {act.at_s}/{act.number}",
                "ROBOT",
                act.kind,
                (act.at_s, ended_s),
                text=act.text or act.clip,
            )
        self._store.put("robot", "", record)

    def _recording(self, message: Any, at_s: float) -> None:
        del at_s
        record = RecordingRecord(
            since_s=_seconds(message.header.stamp),
            recording=bool(message.recording),
            folder=message.folder,
            file=message.file,
            label=message.label,
            notes=message.notes,
            author=message.author,
            bookmarks=int(message.bookmarks),
        )
        before = self._store.get("recording")
        is_same = isinstance(before, RecordingRecord) and before.since_s == record.since_s
        if not is_same:
            self._end_recording(record.since_s)
        self._store.put("recording", "", record)
        if record.recording:
            text = record.label or record.file
            span = (record.since_s, None)
            self._event(RECORDING, "RECORDING", "RECORDING", span, text=text)

    def _end_recording(self, ended_s: float) -> None:
        """Note when the recording that goes on has ended, if one does."""
        event = self._store.get("events", RECORDING)
        if isinstance(event, EventRecord):
            self._store.remove("events", RECORDING)
            ended = replace(event, kind="RECORDED", ended_s=ended_s)
            self._store.put("events", f"{RECORDING} {event.began_s}", ended)

    def _bookmark(self, message: Any, at_s: float) -> None:
        stamp = _seconds(message.header.stamp)
        record = BookmarkRecord(
            at_s=stamp, label=message.label, notes=message.notes, author=message.author
        )
        self._store.put("bookmarks", f"{stamp:.6f}", record)
        text = f"{record.label or 'a moment'} is marked"
        self._log(at_s, "journal", text=text + (f" by {record.author}" if record.author else ""))

    def graph(
        self, listening: Mapping[str, ListeningRecord], at_s: float, *, is_journal_there: bool
    ) -> None:
        """Take what trees listen to at a moment, by topic, and whether a journal runs."""
        for topic in set(self._store.keys("listening")) - listening.keys():
            self._store.remove("listening", topic)
        for topic, record in listening.items():
            self._store.put("listening", topic, record)
        if not is_journal_there:
            self._store.remove("recording", "")
            self._end_recording(at_s)

    def _files(self, message: Any, at_s: float) -> None:
        del at_s
        texts = {
            f"{message.host}|{file}": text
            for file, text in zip(message.files, message.texts, strict=True)
        }
        for key, text in texts.items():
            self._store.put("files", key, FileRecord(text=text))
        for key in self._store.keys("files"):
            if key.startswith(f"{message.host}|") and key not in texts:
                self._store.remove("files", key)

    def _tunables(self, message: Any, at_s: float) -> None:
        del at_s
        held = set()
        for one in message.tunables[:MOST_ENTRIES]:
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

    def _health(self, message: Any, at_s: float) -> None:
        for one in message.status[:_MOST_STATUSES]:
            name = printable_line(one.name)[:_LONGEST_NAME]
            self._heard[name] = at_s
            self._put_health(
                name,
                HealthRecord(
                    level=_name(_LEVELS, _octet(one.level)),
                    message=printable_line(one.message)[:_LONGEST_HEALTH],
                    values={
                        printable_line(pair.key)[:_LONGEST_NAME]: printable_line(pair.value)[
                            :_LONGEST_HEALTH
                        ]
                        for pair in one.values[:_MOST_VALUES]
                    },
                    since_s=at_s,
                ),
            )

    def check_health(self, now_s: float) -> None:
        """Mark parts that have fallen silent as stale, and report entries that found no room.

        Call it a few times a second.
        """
        if self._failed:
            self._put_failures(now_s)
        dropped = {
            name: str(count)
            for name, count in sorted(self._store.dropped.items())
            if name not in ROLLING
        }
        if dropped:
            self._put_health(
                ROOM,
                HealthRecord(level=Health.WARN.name, message=_FULL, values=dropped, since_s=now_s),
            )
        for name, heard_s in list(self._heard.items()):
            record = self._store.get("health", name)
            if not isinstance(record, HealthRecord):
                del self._heard[name]
            elif now_s - heard_s > UNTOLD_S:
                values = record.values
                stale = HealthRecord(
                    level=Health.STALE.name, message="it is silent", values=values, since_s=heard_s
                )
                self._put_health(name, stale)

    def _put_health(self, name: str, record: HealthRecord) -> None:
        before = self._store.get("health", name)
        if isinstance(before, HealthRecord) and before.level == record.level:
            record = replace(record, since_s=before.since_s)
        elif record.level in (Health.ERROR.name, Health.STALE.name):
            self._event(
                f"fault {name}/{record.since_s}",
                "FAULT",
                record.level,
                (record.since_s, record.since_s),
                text=f"{name}: {record.message}",
            )
        if record != before:
            self._store.put("health", name, record)

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
                        name=one.name,
                        values=dict(zip(one.names, one.values, strict=True)),
                        settings={
                            name: _setting(text)
                            for name, text in zip(one.names, one.values, strict=True)
                        },
                    )
                    for one in message.presets
                ),
            ),
        )
        for one in tunings:
            if one.revision > newest:
                text = f"{one.name}: {one.before} → {one.after} by {one.author}"
                self._log(at_s, "tuning", text=text)

    def _event(
        self,
        key: str,
        lane: str,
        kind: str,
        span: tuple[float, float | None],
        *,
        text: str,
        agent: str = "",
    ) -> None:
        began_s, ended_s = span
        record = EventRecord(
            lane=lane,
            kind=kind,
            agent=agent,
            text=ellipsize(printable_line(self._names.with_names(text)), _LONGEST_EVENT),
            began_s=began_s,
            ended_s=ended_s,
        )
        self._store.put("events", key, record)

    def _log(self, at_s: float, kind: str, *, text: str, agent: str = "", path: str = "") -> None:
        self._lines += 1
        text = ellipsize(self._names.with_names(text), _LONGEST_LINE)
        record = LogRecord(at_s=at_s, kind=kind, agent=agent, path=path, text=text)
        self._store.put("log", str(self._lines), record)


def _whole(remaining_s: float | None, before: object) -> float | None:
    """Return the whole time of a countdown [s], as far as it has been seen."""
    if (
        remaining_s is None
        or not isinstance(before, CountdownRecord)
        or before.remaining_s is None
        # It has begun again.
        or remaining_s > before.remaining_s
    ):
        return remaining_s
    return before.whole_s


def _without_modifier(path: str) -> str:
    """Return the path of the node that a modifier belongs to; the same path for any other node."""
    head, slash, last = path.rpartition("/")
    return f"{head}{slash}{last.partition('@')[0]}"


def _begins(path: str, ends: re.Pattern[str], heads: set[str]) -> bool:
    """Return whether a path, up to one of some ends, is one of some others."""
    return any(path[: end.start()] in heads for end in islice(ends.finditer(path), _DEEPEST))


def _setting(text: str) -> Json:
    """Return the value that an author has written; its unit says what it is."""
    truth = boolean(text)
    if truth is not None:
        return truth
    try:
        kind = quantity_type(text)
        return number(text) if kind is None else quantity(text, kind)
    except QuantityError:
        return text


def is_in_use(store: Store, collection: str, key: str) -> bool:
    """Return whether an entry is of what goes on: a run, a recording, a host that is there."""
    if not key or key in (ROOM, FAILURES, RECORDING):
        return True
    owner = key.partition("|")[0]
    market = store.get("market")
    if (
        collection in OF_A_RUN | OF_AN_AGENT
        and isinstance(market, MarketRecord)
        and market.agent == owner != ""
    ):
        return True
    if collection in OF_AN_AGENT:
        agent = store.get("agents", owner)
        owner = agent.host if isinstance(agent, AgentRecord) else ""
    elif collection not in OF_A_HOST:
        return False
    part = store.get("parts", owner)
    return isinstance(part, PartRecord) and part.alive


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


def _kind_of_run(run: RunRecord) -> str:
    if run.outcome != "NONE":
        return run.outcome
    return "RUNNING" if run.event == "STARTED" else run.event


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
        at_s=_seconds(message.header.stamp),
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


def round_record(message: Any) -> RoundRecord:
    """Return the record of an ``Auction``."""
    return RoundRecord(
        at_s=_seconds(message.header.stamp),
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
                changes=() if one.baseline_s else _thresholds(one.when),
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


@lru_cache(maxsize=_MOST_CONDITIONS)
def _thresholds(when: str) -> tuple[float, ...]:
    """Return the changes of the mood from which on the condition of a mood rule is true."""
    if len(when) > _LONGEST_CONDITION:
        return ()
    try:
        condition = parse_expression(when)
    except ExpressionError:
        return ()
    if condition.names != {"mood.change"}:
        return ()

    def holds(change: float) -> bool:
        try:
            return condition.is_true(lambda _: change)
        except Undecided:
            return False

    if holds(0.0):
        return ()
    return tuple(
        _threshold(holds, far) for far in (-_LARGEST_CHANGE, _LARGEST_CHANGE) if holds(far)
    )


def _threshold(holds: Callable[[float], bool], far: float) -> float:
    """Return where a condition that is false at 0 and true far from it becomes true."""
    near = 0.0
    for _ in range(_HALVINGS):
        middle = (near + far) / 2
        near, far = (near, middle) if holds(middle) else (middle, far)
    return round(far, 5)


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


def _octet(value: bytes | int) -> int:
    """Return the number of a ``byte``: rclpy receives bytes, MCAP reads a number."""
    return value if isinstance(value, int) else value[0]


def _name(names: Sequence[str], number: int) -> str:
    return names[number] if 0 <= number < len(names) else str(number)
