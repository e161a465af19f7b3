# SPDX-License-Identifier: Apache-2.0
"""The journal node: records every message of a system as it was sent."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import state_home
from bt_agents_interfaces.msg import (
    AgentFiles,
    Auction,
    Bids,
    CallForBids,
    Feedback,
    HostCard,
    MarketStatus,
    MoodTrace,
    Persons,
    Profiles,
    Run,
    RunRecord,
    Scene,
    SceneEnd,
    Trees,
    TreeStatus,
    Tunables,
    Tunings,
)
from bt_agents_lab.recorder.daily_recorder import DailyRecorder
from bt_agents_lab.recorder.file import RecordedMessage, RecordedTopic, definition
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.parameters import StartParameter, declare, describe, make_from_parameters
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import prefixes

FLUSH_S = 1.0
"""Longest time that a message waits in memory [s]."""

MOST_HOSTS = 100
"""Hosts that are recorded, at most."""

_PACKAGE = "bt_agents_interfaces"
_MESSAGE = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


@dataclass(frozen=True, kw_only=True)
class _Source:
    """A topic that is recorded; a fact holds until the next message of its topic."""

    name: str
    kind: Any
    profile: QoSProfile
    fact: bool = False


_SYSTEM = (
    _Source(name="scene", kind=Scene, profile=qos.FACTS),
    _Source(name="scene/live", kind=Scene, profile=qos.SENSOR),
    _Source(name="scene/persons", kind=Persons, profile=qos.FACTS),
    _Source(name="calls", kind=CallForBids, profile=qos.EVENTS),
    _Source(name="bids", kind=Bids, profile=qos.EVENTS),
    _Source(name="auctions", kind=Auction, profile=qos.FACTS),
    _Source(name="runs", kind=Run, profile=qos.FACTS),
    _Source(name="scene_ends", kind=SceneEnd, profile=qos.FACTS),
    _Source(name="market", kind=MarketStatus, profile=qos.FACTS, fact=True),
    _Source(name="feedback", kind=Feedback, profile=qos.FACTS),
    _Source(name="profiles", kind=Profiles, profile=qos.FACTS, fact=True),
    _Source(name="mood_traces", kind=MoodTrace, profile=qos.FACTS),
)

_HOST = (
    _Source(name="files", kind=AgentFiles, profile=qos.FACTS, fact=True),
    _Source(name="trees", kind=Trees, profile=qos.FACTS, fact=True),
    _Source(name="tunables", kind=Tunables, profile=qos.FACTS, fact=True),
    _Source(name="tunings", kind=Tunings, profile=qos.FACTS, fact=True),
    _Source(name="status", kind=TreeStatus, profile=qos.EVENTS),
    _Source(name="records", kind=RunRecord, profile=qos.EVENTS),
)


class JournalNode(BaseNode):
    """Recorder of the messages of a system, into one file for each start and day."""

    def __init__(
        self, folder: Path, *, today: Callable[[], date] = date.today, **node_kwargs: Any
    ) -> None:
        super().__init__("journal", **node_kwargs)
        limits = describe(
            "days of which files are kept; 0 keeps all",
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
        except OSError as error:
            self.destroy_node()
            raise BtAgentsError(
                f"no place for the journal: {folder} ({error.strerror}); name another folder"
            ) from None
        except BtAgentsError:
            self.destroy_node()
            raise
        for source in _SYSTEM:
            self._subscribe(source, source.name)
        self._topic_of_cards = self._topic(HostCard, "cards")
        self.create_subscription(HostCard, "cards", self._handle_card, qos.FACTS, raw=True)
        steady_timer(self, FLUSH_S, lambda: self.journal.flush(time.time_ns()))
        self.get_logger().info(f"the journal is {self.journal.path}")

    def destroy_node(self) -> None:
        if hasattr(self, "journal"):
            self.journal.close()
        super().destroy_node()

    def _subscribe(self, source: _Source, name: str) -> None:
        topic = self._topic(source.kind, name)
        fact = topic.name if source.fact else ""

        def handle(data: bytes, info: Mapping[str, Any]) -> None:
            self.journal.record(_received(topic, data, info), fact=fact)

        self.create_subscription(source.kind, name, handle, source.profile, raw=True)

    def _handle_card(self, data: bytes, info: Mapping[str, Any]) -> None:
        """Record the card of a host, and its other topics from then on."""
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
            for source in _HOST:
                self._subscribe(source, f"{host}/{source.name}")
        topic = self._topic_of_cards
        self.journal.record(_received(topic, data, info), fact=f"{topic.name} {host}")

    def _topic(self, kind: Any, name: str) -> RecordedTopic:
        type_name = f"{_PACKAGE}/msg/{kind.__name__}"
        if type_name not in self._definitions:
            self._definitions[type_name] = definition(type_name, definition_text)
        return RecordedTopic(
            name=self.resolve_topic_name(name),
            type=type_name,
            definition=self._definitions[type_name],
        )

    def _report(self, text: str, is_error: bool) -> None:
        if is_error:
            self.get_logger().error(text)
        else:
            self.get_logger().info(text)


def definition_text(type_name: str) -> str | None:
    """Return the text of an installed type, such as ``std_msgs/msg/Bool``; None without one."""
    if not _MESSAGE.fullmatch(type_name):
        return None
    for prefix in prefixes():
        try:
            return (prefix / "share" / f"{type_name}.msg").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            continue
    return None


def _received(topic: RecordedTopic, data: bytes, info: Mapping[str, Any]) -> RecordedMessage:
    return RecordedMessage(
        topic=topic, data=data, sent_ns=int(info["source_timestamp"]), received_ns=time.time_ns()
    )


FOLDER = StartParameter(
    name="folder", description="folder of the files; empty means that of the logs of bt-agents"
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
