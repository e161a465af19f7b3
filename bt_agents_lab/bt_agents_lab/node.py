# SPDX-License-Identifier: Apache-2.0
"""Journal node, which records every message of a system as it was sent."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.state_folder import state_home
from bt_agents_core.text import printable
from bt_agents_interfaces.msg import Bookmark, HostCard, RecordingStatus
from bt_agents_interfaces.srv import Record
from bt_agents_lab.recorder.daily_recorder import DailyRecorder
from bt_agents_lab.recorder.facts import CARDS, DIAGNOSTICS, is_fact, reporting_node
from bt_agents_lab.recorder.file import RecordedMessage, RecordedTopic, definition
from bt_agents_lab.recorder.recording_control import MarkedMoment, RecordingControl, RecordingState
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.health_publisher import HealthPublisher
from bt_agents_ros.messages import answering, header_at, to_time
from bt_agents_ros.parameters import StartParameter, declare, describe, make_from_parameters
from bt_agents_ros.spinner import run
from bt_agents_ros.system_topics import HOST, SystemTopic, heard_by, topic_called
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import load_type, prefixes
from bt_agents_ros.workarounds.bounded_end import ending_in_time

FLUSH_S = 1.0
"""Longest time that a message waits in memory [s]."""

MOST_HOSTS = 100
"""Maximum number of recorded hosts."""

MOST_REPORTING = 200
"""Maximum number of nodes and devices whose health is recorded."""

_MESSAGE = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


class JournalNode(BaseNode):
    """Node that records the messages of a system into one file for each start and day."""

    def __init__(
        self, folder: Path, *, today: Callable[[], date] = date.today, **node_kwargs: Any
    ) -> None:
        super().__init__("journal", **node_kwargs)
        limits = describe(
            "days to keep files; 0 keeps all",
            minimum=0,
            maximum=36_500,
            integer=True,
            read_only=True,
        )
        days = int(declare(self, "days", 0, limits))
        self._definitions: dict[str, str] = {}
        self._hosts: set[str] = set()
        try:
            self.journal = DailyRecorder(folder, days=days, today=today, report=self._report)
        except (OSError, BtAgentsError) as error:
            with ending_in_time():
                self.destroy_node()
            if isinstance(error, BtAgentsError):
                raise
            raise BtAgentsError(
                f"no place for the journal: {folder} ({error.strerror}); name another folder"
            ) from None
        self._folder = folder
        self._topic_of_status = self._topic(topic_called("journal/status"), "~/status")
        self._topic_of_bookmarks = self._topic(
            topic_called("bt_agents/bookmarks"), "bt_agents/bookmarks"
        )
        self._status = self.create_publisher(RecordingStatus, "~/status", qos.FACT)
        self._bookmarks = self.create_publisher(Bookmark, "bt_agents/bookmarks", qos.FACTS)
        self._health = HealthPublisher(self, lambda: (self.journal.health,))
        self._control = RecordingControl(self.journal, self, time.time_ns, time.monotonic)
        self.create_service(Record, "~/record", self._on_record, qos_profile=qos.SERVICE)
        for heard in heard_by("journal"):
            if HOST not in heard.name and heard not in (CARDS, DIAGNOSTICS):
                self._subscribe(heard, heard.name)
        self._topic_of_cards = self._topic(CARDS, CARDS.name)
        self.create_subscription(
            HostCard, CARDS.name, self._handle_card, qos.listening(CARDS), raw=True
        )
        self._reported: dict[str, tuple[tuple[str, bytes, str], ...]] = {}
        self._topic_of_diagnostics = self._topic(DIAGNOSTICS, DIAGNOSTICS.name)
        self.create_subscription(
            DiagnosticArray,
            DIAGNOSTICS.name,
            self._handle_diagnostics,
            qos.listening(DIAGNOSTICS),
            raw=True,
        )
        steady_timer(self, FLUSH_S, self._flush)
        self.get_logger().info(f"the journal is {self.journal.path}")

    def destroy_node(self) -> None:
        if hasattr(self, "journal"):
            self.journal.close()
        super().destroy_node()

    def on_state(self, state: RecordingState) -> None:
        """Publish the state of the recording, and record it during a recording."""
        message = RecordingStatus(
            header=header_at(to_time(state.since_ns * 1e-9)),
            recording=state.is_recording,
            folder=str(self._folder),
            file=state.file,
            label=state.label,
            notes=state.notes,
            author=state.author,
            bookmarks=state.bookmarks,
        )
        self._status.publish(message)
        fact = self._topic_of_status.name
        if state.is_recording:
            self._record_own(self._topic_of_status, message, fact=fact)
        else:
            self.journal.forget(fact)

    def on_bookmark(self, moment: MarkedMoment) -> None:
        """Publish and record a bookmark."""
        message = Bookmark(
            header=header_at(to_time(moment.at_ns * 1e-9)),
            author=moment.author,
            label=moment.label,
            notes=moment.notes,
        )
        self._bookmarks.publish(message)
        self._record_own(self._topic_of_bookmarks, message)

    def _record_own(self, topic: RecordedTopic, message: Any, fact: str = "") -> None:
        now_ns = time.time_ns()
        recorded = RecordedMessage(
            topic=topic, data=serialize_message(message), sent_ns=now_ns, received_ns=now_ns
        )
        self.journal.record(recorded, fact=fact)

    def _on_record(self, request: Record.Request, response: Record.Response) -> Record.Response:
        told = {"label": request.label, "notes": request.notes, "author": request.author}
        with answering(response):
            match request.action:
                case Record.Request.START:
                    response.message = self._control.start(**told)
                case Record.Request.STOP:
                    response.message = self._control.stop()
                case Record.Request.BOOKMARK:
                    response.message = self._control.mark(**told, age_s=request.age_s)
                case other:
                    raise Refused(
                        RefusalCode.UNKNOWN_ACTION, f"the action is {other}, expected 0, 1 or 2"
                    )
            # A kill must not lose what is acknowledged.
            self.journal.flush(time.time_ns())
            self.get_logger().info(printable(response.message))
        response.file = self._control.state.file
        return response

    def _flush(self) -> None:
        self.journal.flush(time.time_ns())
        self._control.check_file()
        self._health.update()

    def _subscribe(self, heard: SystemTopic, name: str) -> None:
        topic = self._topic(heard, name)
        fact = topic.name if is_fact(heard) else ""

        def handle(data: bytes, info: Mapping[str, Any]) -> None:
            self.journal.record(_received(topic, data, info), fact=fact)

        profile = qos.listening(heard)
        self.create_subscription(load_type(heard.type), name, handle, profile, raw=True)

    def _handle_card(self, data: bytes, info: Mapping[str, Any]) -> None:
        """Record the card of a host, and from then on its other topics."""
        host = str(deserialize_message(data, HostCard).host)
        if host not in self._hosts:
            if len(self._hosts) >= MOST_HOSTS:
                self.get_logger().error(
                    f"{host} is left out of the journal: {MOST_HOSTS} other hosts are recorded, "
                    "expected no more; start it again when some of them are gone",
                    throttle_duration_sec=60.0,
                )
                return
            self._hosts.add(host)
            for heard in heard_by("journal"):
                if HOST in heard.name:
                    self._subscribe(heard, heard.name.replace(HOST, host))
        topic = self._topic_of_cards
        self.journal.record(_received(topic, data, info), fact=f"{topic.name} {host}")

    def _handle_diagnostics(self, data: bytes, info: Mapping[str, Any]) -> None:
        """Record the health of a node at each change; it is published every second.

        Several nodes, such as drivers, may name the same hardware.
        """
        statuses = deserialize_message(data, DiagnosticArray).status
        node = reporting_node(statuses)
        reported = tuple((one.name, one.level, one.message) for one in statuses)
        before = self._reported.get(node, ())
        if reported == before or (not before and len(self._reported) >= MOST_REPORTING):
            return
        self._reported[node] = reported
        topic = self._topic_of_diagnostics
        self.journal.record(_received(topic, data, info), fact=f"{topic.name} {node}")

    def _topic(self, topic: SystemTopic, name: str) -> RecordedTopic:
        if topic.type not in self._definitions:
            self._definitions[topic.type] = definition(topic.type, definition_text)
        return RecordedTopic(
            name=self.resolve_topic_name(name),
            type=topic.type,
            definition=self._definitions[topic.type],
            qos=_offered(qos.listening(topic)),
        )

    def _report(self, text: str, is_error: bool) -> None:
        if is_error:
            self.get_logger().error(text)
        else:
            self.get_logger().info(text)


def definition_text(type_name: str) -> str | None:
    """Return the definition of an installed type, such as ``std_msgs/msg/Bool``, or None."""
    if not _MESSAGE.fullmatch(type_name):
        return None
    for prefix in prefixes():
        try:
            return (prefix / "share" / f"{type_name}.msg").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            continue
    return None


def _offered(profile: QoSProfile) -> str:
    """Return a profile in the form that all versions of ``ros2 bag`` read: rmw numbers in YAML."""
    infinite = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- history: {int(profile.history)}\n"
        f"  depth: {profile.depth}\n"
        f"  reliability: {int(profile.reliability)}\n"
        f"  durability: {int(profile.durability)}\n"
        f"  deadline: {infinite}\n"
        f"  lifespan: {infinite}\n"
        "  liveliness: 1\n"
        f"  liveliness_lease_duration: {infinite}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )


def _received(topic: RecordedTopic, data: bytes, info: Mapping[str, Any]) -> RecordedMessage:
    return RecordedMessage(
        topic=topic, data=data, sent_ns=int(info["source_timestamp"]), received_ns=time.time_ns()
    )


FOLDER = StartParameter(
    name="folder", description="folder of the journal's files; empty: the log folder of bt-agents"
)


def make_node() -> JournalNode:
    """Create the node with the folder that its parameter names.

    Raises:
        BtAgentsError: The folder cannot be written, or another journal writes into it.
    """

    def make(values: Mapping[str, str]) -> JournalNode:
        folder = Path(values["folder"]) if values["folder"] else state_home() / "journal"
        return JournalNode(folder.expanduser())

    return make_from_parameters("journal", (FOLDER,), make)


def main(args: Sequence[str] | None = None) -> int:
    """Run the journal until a signal ends it; return the exit code."""
    return run(make_node, args)


if __name__ == "__main__":
    sys.exit(main())
