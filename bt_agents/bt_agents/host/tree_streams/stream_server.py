# SPDX-License-Identifier: Apache-2.0
"""Services and publishers of the streams that py-trees-tree-watcher and similar tools expect."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from math import inf
from typing import Any

from rclpy.exceptions import NameValidationException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from std_msgs.msg import String

from bt_agents.engine.run import Run
from bt_agents.host.run_server import RunServer
from bt_agents.host.tree_streams.blackboard import MOST_VARIABLES, activity_table, chosen, table
from bt_agents.host.tree_streams.messages import PACKAGE, WatcherInterfaces
from bt_agents.host.tree_streams.stream import (
    LONGEST_TOPIC,
    SnapshotParameters,
    SnapshotSchedule,
    StreamUse,
    check_count,
    requested_topic,
)
from bt_agents.host.tree_streams.watched_run import WatchedRun
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_ros import qos
from bt_agents_ros.parameters import declare_and_watch, describe
from bt_agents_ros.system_topics import HOST, TREE_STREAM_SERVICES

DEFAULT_PERIOD = "default_snapshot_period"
"""Parameter for the default period, which may be infinite."""

_snapshot_numbers = count()
_blackboard_numbers = count()


@dataclass(eq=False, kw_only=True)
class _SnapshotStream:
    publisher: Any
    parameters: SnapshotParameters
    use: StreamUse
    schedule: SnapshotSchedule = field(default_factory=SnapshotSchedule)
    sent: tuple[WatchedRun, int] | None = None

    @property
    def with_activity(self) -> bool:
        return self.parameters.blackboard_activity


@dataclass(eq=False, kw_only=True)
class _BlackboardStream:
    publisher: Any
    variables: tuple[str, ...]
    visited_only: bool
    with_activity: bool
    use: StreamUse
    sent: str | None = None


class TreeStreams:
    """Streams of the current run and its blackboard; each watcher opens its own stream.

    Without subscribers, nothing is noted during ticks. The last snapshot of a run stays latched.
    """

    def __init__(self, node: Node, runs: RunServer, interfaces: WatcherInterfaces) -> None:
        self._node = node
        self._runs = runs
        self._interfaces = interfaces
        self._run: WatchedRun | None = None
        self._snapshots: dict[str, _SnapshotStream] = {}
        self._blackboards: dict[str, _BlackboardStream] = {}
        callbacks = {
            "OpenSnapshotStream": self._open_snapshots,
            "CloseSnapshotStream": self._close_snapshots,
            "ReconfigureSnapshotStream": self._reconfigure,
            "GetBlackboardVariables": self._variables,
            "OpenBlackboardStream": self._open_blackboard,
            "CloseBlackboardStream": self._close_blackboard,
        }
        for service in TREE_STREAM_SERVICES:
            name, kind = service.name.replace(HOST, "~"), service.type.rpartition("/")[2]
            node.create_service(
                getattr(interfaces.srv, kind), name, callbacks[kind], qos_profile=qos.SERVICE
            )
        self._declare_default_stream()
        runs.on_start.append(self._on_start)
        runs.on_tick.append(self._on_tick)
        runs.on_end.append(lambda *_: self._on_end())

    def check_subscribers(self) -> None:
        """Check the subscribers and close unused streams; called with each heartbeat."""
        now = time.monotonic()
        kinds: tuple[tuple[dict[str, Any], Callable[[Any], None]], ...] = (
            (self._snapshots, self._publish_snapshot),
            (self._blackboards, self._publish_blackboard),
        )
        for streams, publish in kinds:
            for topic, stream in list(streams.items()):
                if stream.use.update(stream.publisher.get_subscription_count(), now):
                    self._note()
                    publish(stream)
                if stream.use.is_over(now):
                    self._drop(streams, topic)
        self._note()

    def _on_start(self, run: Run) -> None:
        """Follow a run whose tree is built and not ticked yet."""
        self._run = WatchedRun(run)
        self._note()

    def _on_tick(self) -> None:
        run = self._run
        if run is None or not self._watched:
            return
        # The tree of the clean-up is built during the run.
        self._note()
        run.take_tick(self._runs.tick_began, time.monotonic())
        self._publish(changed=run.changed)

    def _on_end(self) -> None:
        """Publish how the run has ended, which its last tick did not know."""
        if self._watched:
            self._publish(changed=True)

    def _publish(self, *, changed: bool) -> None:
        now = time.monotonic()
        for snapshots in self._snapshots.values():
            period_s = snapshots.parameters.period_s
            if snapshots.use.watched and snapshots.schedule.take(
                now, changed=changed, period_s=period_s
            ):
                self._publish_snapshot(snapshots, changed=changed, again=True)
        for blackboard in self._blackboards.values():
            if blackboard.use.watched:
                self._publish_blackboard(blackboard)

    @property
    def _watched(self) -> list[_SnapshotStream | _BlackboardStream]:
        """The streams that have subscribers."""
        streams: list[_SnapshotStream | _BlackboardStream] = [*self._snapshots.values()]
        streams += self._blackboards.values()
        return [one for one in streams if one.use.watched]

    def _note(self) -> None:
        """Note only what streams with subscribers need."""
        if self._run is not None:
            watched = self._watched
            activity = any(one.with_activity for one in watched)
            self._run.note(visits=bool(watched), activity=activity)

    def _publish_snapshot(
        self, stream: _SnapshotStream, *, changed: bool = True, again: bool = False
    ) -> None:
        watched = self._run
        if watched is None:
            return
        sent = (watched, watched.run.ticks)
        if stream.sent == sent and not again:
            return
        stream.sent = sent
        to, wanted = self._interfaces, stream.parameters
        stream.publisher.publish(
            to.msg.BehaviourTree(
                behaviours=[to.behaviour(node, state) for node, state in watched.nodes()],
                changed=changed,
                blackboard_on_visited_path=(
                    to.values(watched.blackboard.values(watched.visited_keys()))
                    if wanted.blackboard_data
                    else []
                ),
                blackboard_activity=(
                    to.activity(watched.activity) if wanted.blackboard_activity else []
                ),
                statistics=to.statistics(
                    watched.run.ticks, self._node.get_clock().now().to_msg(), watched.ticks
                ),
            )
        )

    def _publish_blackboard(self, stream: _BlackboardStream) -> None:
        """Publish the variables of a stream if one of their values has changed."""
        watched = self._run
        if watched is None:
            return
        visited = set(watched.visited_keys()) if stream.visited_only else None
        names = chosen(stream.variables, watched.blackboard.keys(), visited)
        text = table(watched.blackboard.values(names))
        if text == stream.sent:
            return
        stream.sent = text
        if stream.with_activity:
            keys = {name.partition(".")[0] for name in names}
            accesses = [one for one in watched.activity if one.key in keys]
            text = f"Blackboard Data\n{text}\nBlackboard Activity Stream\n"
            text += activity_table(accesses)
        stream.publisher.publish(String(data=text))

    def _open_snapshots(self, request: Any, response: Any) -> Any:
        with self._refusals("snapshot_streams/open"):
            name = request.topic_name or f"_snapshots_{next(_snapshot_numbers)}"
            response.topic_name = self._open(name, _parameters(request.parameters))
        return response

    def _open(self, name: str, parameters: SnapshotParameters, *, kept: bool = False) -> str:
        topic = self._expanded(requested_topic(name))
        stream = self._snapshots.get(topic)
        if stream is None:
            if not kept:
                check_count(len(self._snapshots))
            stream = self._snapshots[topic] = _SnapshotStream(
                publisher=self._publisher(self._interfaces.msg.BehaviourTree, topic),
                parameters=parameters,
                use=StreamUse(time.monotonic(), kept=kept),
            )
        stream.parameters = parameters
        self._publish_snapshot(stream)
        return topic

    def _close_snapshots(self, request: Any, response: Any) -> Any:
        response.result = self._drop(self._snapshots, request.topic_name)
        return response

    def _reconfigure(self, request: Any, response: Any) -> Any:
        stream = self._snapshots.get(request.topic_name)
        if stream is not None:
            with self._refusals("snapshot_streams/reconfigure"):
                stream.parameters = _parameters(request.parameters)
                response.result = True
            self._note()
        return response

    def _variables(self, _request: Any, response: Any) -> Any:
        if self._run is not None:
            response.variables = self._run.blackboard.variables()
        return response

    def _open_blackboard(self, request: Any, response: Any) -> Any:
        with self._refusals("blackboard_streams/open"):
            check_count(len(self._blackboards))
            variables = tuple(request.variables)
            if len(variables) > MOST_VARIABLES or any(len(v) > LONGEST_TOPIC for v in variables):
                raise Refused(
                    RefusalCode.TOO_LARGE,
                    f"{len(variables)} variables, the longest of "
                    f"{max(map(len, variables))} characters; expected at most {MOST_VARIABLES} "
                    f"of {LONGEST_TOPIC} characters",
                )
            topic = self._expanded(f"~/blackboard_streams/_watcher_{next(_blackboard_numbers)}")
            stream = self._blackboards[topic] = _BlackboardStream(
                publisher=self._publisher(String, topic),
                variables=variables,
                visited_only=request.filter_on_visited_path,
                with_activity=request.with_activity_stream,
                use=StreamUse(time.monotonic()),
            )
            self._publish_blackboard(stream)
            response.topic = topic
        return response

    def _close_blackboard(self, request: Any, response: Any) -> Any:
        response.result = self._drop(self._blackboards, request.topic_name)
        return response

    def _declare_default_stream(self) -> None:
        values: dict[str, Any] = {}

        def declared(name: str, default: Any, description: str, **limits: Any) -> None:
            values[name] = declare_and_watch(
                self._node, name, default, describe(description, **limits), changed(name)
            )

        def changed(name: str) -> Callable[[Any], None]:
            def take(value: Any) -> None:
                values[name] = value
                self._set_default_stream(values)

            return take

        declared(
            "default_snapshot_stream",
            False,
            "whether there is a snapshot stream on ~/snapshots all the time",
        )
        declared(
            DEFAULT_PERIOD,
            2.0,
            "time between two snapshots of it without changes; infinity for changes alone [s]",
            minimum=0.0,
            maximum=inf,
        )
        declared(
            "default_snapshot_blackboard_data",
            True,
            "whether they have the values of the blackboard",
        )
        declared(
            "default_snapshot_blackboard_activity",
            False,
            "whether they have the values that were read and written",
        )
        self._set_default_stream(values)

    def _set_default_stream(self, values: dict[str, Any]) -> None:
        topic = self._expanded("~/snapshots")
        if not values["default_snapshot_stream"]:
            self._drop(self._snapshots, topic)
            return
        self._open(
            topic,
            SnapshotParameters(
                period_s=values[DEFAULT_PERIOD],
                blackboard_data=values["default_snapshot_blackboard_data"],
                blackboard_activity=values["default_snapshot_blackboard_activity"],
            ),
            kept=True,
        )
        self._note()

    def _publisher(self, kind: Any, topic: str) -> Any:
        try:
            return self._node.create_publisher(kind, topic, qos.FACT)
        except Exception as error:
            raise Refused(
                RefusalCode.UNUSABLE_TOPIC, f"{topic} cannot be published: {error}"
            ) from None

    def _drop(self, streams: dict[str, Any], topic: str) -> bool:
        """Close a stream; return whether there was one."""
        stream = streams.pop(topic, None)
        if stream is None:
            return False
        self._node.destroy_publisher(stream.publisher)
        self._note()
        return True

    def _expanded(self, topic: str) -> str:
        node = self._node
        try:
            return str(expand_topic_name(topic, node.get_name(), node.get_namespace()))
        except (NameValidationException, ValueError) as error:
            raise Refused(
                RefusalCode.UNUSABLE_TOPIC, f"'{topic}' cannot be the name of a topic: {error}"
            ) from None

    @contextmanager
    def _refusals(self, service: str) -> Iterator[None]:
        """Log a refusal, because the answers of these services have no field for it."""
        try:
            yield
        except Refused as refused:
            reason = ellipsize(printable_line(str(refused)), 300)
            self._node.get_logger().warning(
                f"~/{service} refused: {refused.code}: {reason}", throttle_duration_sec=5.0
            )


def offer_tree_streams(node: Node, runs: RunServer) -> TreeStreams | None:
    """Offer the streams if their types are installed; if not, log once that there are none."""
    interfaces = WatcherInterfaces.installed()
    if interfaces is None:
        node.get_logger().info(
            f"{PACKAGE} is not installed, so the tools of py_trees_ros see nothing of this host"
        )
        return None
    return TreeStreams(node, runs, interfaces)


def _parameters(message: Any) -> SnapshotParameters:
    return SnapshotParameters(
        period_s=message.snapshot_period,
        blackboard_data=message.blackboard_data,
        blackboard_activity=message.blackboard_activity,
    )
