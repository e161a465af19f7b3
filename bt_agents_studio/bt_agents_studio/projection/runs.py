# SPDX-License-Identifier: Apache-2.0
"""The last run of each agent: progress and values of its nodes, limits and pauses."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import islice
from typing import Any

from bt_agents_studio.projection.conversion import finite, name_of, record_of, seconds
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.projection.market import scene_record
from bt_agents_studio.records import (
    STOPPED,
    UNKNOWN,
    ControlRecord,
    CountdownRecord,
    NodeRecord,
    NodeValueRecord,
    NodeValuesRecord,
    RunRecord,
    TreeRecord,
)
from bt_agents_studio.store import Store

_STATUSES = ("INVALID", "RUNNING", "SUCCESS", "FAILURE")

_TIME, _ATTEMPTS = 1, 2
"""Units of countdowns."""

_MOST_VALUES = 40
"""Maximum number of values to show of a node; the newest are kept."""

_ABOVE, _WITHIN = re.compile("/"), re.compile("[/@]|$")
"""Where a path may be cut: at ancestors, or also at modifiers and at its end."""

_DEEPEST = 200
"""Maximum number of cuts to try in a path."""


class RunProjection:
    """Messages about runs → ``runs``, ``trees``, ``nodes``, ``values``, ``countdowns``, ….

    Args:
        store: Store of the entries.
        log: Log of events.
    """

    def __init__(self, store: Store, log: EventLog) -> None:
        self._store = store
        self._log = log
        self.handlers = {
            "bt_agents_interfaces/msg/NodeDetails": self._details,
            "bt_agents_interfaces/msg/Run": self._run,
            "bt_agents_interfaces/msg/RunControl": self._control,
            "bt_agents_interfaces/msg/TreeStatus": self._tree_status,
            "bt_agents_interfaces/msg/Trees": self._trees,
        }

    def _run(self, message: Any, at_s: float) -> None:
        before = self._run_of(message)
        stamp = seconds(message.header.stamp)
        record = record_of(
            RunRecord,
            message,
            scene_id=message.scene.scene_id,
            scene_label=message.scene.label,
            began_s=before.began_s if before else stamp - message.duration_s,
            ended_s=None,
            tick=before.tick if before else 0,
            tip=before.tip if before else "",
        )
        if record.event in ("ENDED", "REFUSED"):
            record = replace(record, ended_s=stamp)
        if record.event == "STARTED" and not before:
            self._begin(message.agent)
        if record.event == "STARTED" and not (before and before.scene_id):
            self._store.put("scene", "", scene_record(message.scene))
        self._store.put("runs", message.agent, record)
        self._log.event(
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
        text = f"{record.event.lower()}: {message.message}"
        self._log.line(at_s, "run", agent=message.agent, text=text)

    def _run_of(self, message: Any) -> RunRecord | None:
        """Return the run of a message if it is the last one of its agent."""
        run = self._store.get("runs", message.agent)
        if isinstance(run, RunRecord) and (run.epoch, run.round) == (message.epoch, message.round):
            return run
        return None

    def _begin(self, agent: str) -> None:
        """Forget the previous run of an agent's nodes."""
        for collection in ("nodes", "countdowns", "values"):
            self._store.clear(collection, f"{agent}|")
        self._store.clear("moods")

    def _lose(self, agent: str) -> None:
        """Mark the outcome of an agent's running nodes as unknown."""
        for key in self._store.keys("nodes"):
            record = self._store.get("nodes", key)
            if (
                key.startswith(f"{agent}|")
                and isinstance(record, NodeRecord)
                and record.status == "RUNNING"
            ):
                self._store.put("nodes", key, replace(record, status=UNKNOWN))

    def _tree_status(self, message: Any, at_s: float) -> None:
        stamp = seconds(message.header.stamp) or at_s
        run = self._run_of(message)
        if run is None:
            # The first tick may arrive before the market announces the run.
            self._begin(message.agent)
            run = _unannounced(message, stamp)
        run = replace(run, tick=message.tick, tip=message.tip)
        self._store.put("runs", message.agent, run)
        self._restart(message)
        stopped = self._stopped(message)
        for change in message.changes:
            self._node(message, change, stamp, stopped)

    def _restart(self, message: Any) -> None:
        """Reset the descendants of nodes that were stopped and restart in a tick."""
        heads = set[str]()
        for change in message.changes:
            before = self._store.get("nodes", f"{message.agent}|{change.path}")
            starts = name_of(_STATUSES, change.status) != "INVALID"
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
            status = name_of(_STATUSES, change.status)
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
            before = NodeRecord()
        status = name_of(_STATUSES, change.status)
        if status == "INVALID" and _begins(change.path, _WITHIN, stopped):
            # A stopped node shows its progress until it restarts.
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
                tick=message.tick,
                # A node that ends in the tick of its start is never reported as running.
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
            self._log.line(stamp, "tree", agent=message.agent, path=change.path, text=text)

    def _details(self, message: Any, at_s: float) -> None:
        stamp = seconds(message.header.stamp) or at_s
        last = self._store.get("runs", message.agent)
        run = self._run_of(message)
        if run is None and isinstance(last, RunRecord) and last.began_s > stamp:
            return
        if run is None:
            # The details of the first tick may arrive before its changes.
            self._begin(message.agent)
            run = _unannounced(message, stamp)
            self._store.put("runs", message.agent, run)
        for one in message.values:
            self._value(message, one.path, one, stamp, written=one.written)
        if run.ended_s is not None:
            return
        times = {one.path: one for one in message.countdowns if one.unit == _TIME}
        rounds = {one.path: one for one in message.countdowns if one.unit == _ATTEMPTS}
        head = f"{message.agent}|"
        left = {}
        for path, one in {**times, **rounds}.items():
            remaining_s = finite(times[path].remaining_s) if path in times else None
            before = self._store.get("countdowns", f"{head}{path}")
            left[path] = CountdownRecord(
                at_s=at_s,
                kind=one.kind,
                remaining_s=remaining_s,
                remaining=rounds[path].remaining if path in rounds else None,
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
            at_s=stamp, tick=message.tick, name=value.name, value=value.value, written=written
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
        since_s = seconds(message.header.stamp) or at_s
        record = record_of(ControlRecord, message, since_s=since_s, breakpoints=breakpoints)
        self._store.put("controls", message.host, record)
        was = (before.paused, before.paused_at) if isinstance(before, ControlRecord) else None
        if record.paused and was != (True, record.paused_at):
            text = "is paused" + (f" by {record.author}" if record.author else "")
            if record.paused_at:
                text = f"is paused before {record.paused_at}"
            self._log.line(at_s, "run", agent=record.agent, path=record.paused_at, text=text)
        elif was is not None and was[0] and not record.paused and record.agent:
            self._log.line(at_s, "run", agent=record.agent, text="goes on")

    def _trees(self, message: Any, _at_s: float) -> None:
        trees = {one.agent: record_of(TreeRecord, one, host=message.host) for one in message.trees}
        for agent in self._store.keys("trees"):
            tree = self._store.get("trees", agent)
            if isinstance(tree, TreeRecord) and tree.host == message.host and agent not in trees:
                self._store.remove("trees", agent)
        for agent, tree in trees.items():
            self._store.put("trees", agent, tree)


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
        round=message.round,
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


def _whole(remaining_s: float | None, before: object) -> float | None:
    """Return the whole time of a countdown as far as observed [s]."""
    if (
        remaining_s is None
        or not isinstance(before, CountdownRecord)
        or before.remaining_s is None
        # It has restarted.
        or remaining_s > before.remaining_s
    ):
        return remaining_s
    return before.whole_s


def _without_modifier(path: str) -> str:
    """Return the path of the node that a modifier belongs to; the same path for any other node."""
    head, slash, last = path.rpartition("/")
    return f"{head}{slash}{last.partition('@')[0]}"


def _begins(path: str, ends: re.Pattern[str], heads: set[str]) -> bool:
    """Return whether a path, cut at a match of ``ends``, is one of ``heads``."""
    return any(path[: end.start()] in heads for end in islice(ends.finditer(path), _DEEPEST))
