# SPDX-License-Identifier: Apache-2.0
"""Projection of a system's messages, live or recorded, into the store of a studio."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bt_agents_studio.projection.agents import AgentProjection
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.projection.health import FAILURES, ROOM, HealthProjection
from bt_agents_studio.projection.market import MarketProjection
from bt_agents_studio.projection.recording import RECORDING, RecordingProjection
from bt_agents_studio.projection.robot import RobotProjection
from bt_agents_studio.projection.runs import RunProjection
from bt_agents_studio.records import (
    OF_A_HOST,
    OF_A_RUN,
    OF_AN_AGENT,
    AgentRecord,
    ListeningRecord,
    MarketRecord,
    PartRecord,
)
from bt_agents_studio.store import Store


class Projection:
    """Messages → entries of a store; reads messages only by their field names.

    Args:
        store: Store of the entries.
        mood: The scene parameter that is the mood; empty for none.

    Attributes:
        agents: Takes the values of tunables, which are parameters, not messages.
        health: Records messages that could not be shown, and silent parts.
    """

    def __init__(self, store: Store, mood: str = "") -> None:
        log = EventLog(store)
        self._store = store
        self._market = MarketProjection(store, log, mood)
        self._recording = RecordingProjection(store, log)
        self.agents = AgentProjection(store, log)
        self.health = HealthProjection(store, log)
        parts = (
            self._market,
            self.agents,
            self.health,
            self._recording,
            RobotProjection(store, log),
            RunProjection(store, log),
        )
        self._handlers: Mapping[str, Callable[[Any, float], None]] = {
            kind: handler for part in parts for kind, handler in part.handlers.items()
        }

    @property
    def types(self) -> tuple[str, ...]:
        """Types of the messages that it reads, ``package/msg/Name``."""
        return tuple(self._handlers)

    def handle(self, kind: str, message: Any, at_s: float, *, live: bool = False) -> None:
        """Handle a message with the time when it was sent [s since 1970].

        Args:
            kind: ``package/msg/Name``; other types are ignored.
            message: Object with the fields of the type as attributes.
            at_s: When it was sent.
            live: A ``Scene`` is the live scene of a run.
        """
        if live:
            self._market.live(message, at_s)
        elif (handler := self._handlers.get(kind)) is not None:
            handler(message, at_s)

    def graph(
        self, listening: Mapping[str, ListeningRecord], at_s: float, *, is_journal_there: bool
    ) -> None:
        """Take the topics that trees subscribe to at a moment, and whether a journal runs."""
        for topic in set(self._store.keys("listening")) - listening.keys():
            self._store.remove("listening", topic)
        for topic, record in listening.items():
            self._store.put("listening", topic, record)
        if not is_journal_there:
            self._recording.lose(at_s)


def is_in_use(store: Store, collection: str, key: str) -> bool:
    """Return whether an entry belongs to a current run, recording or host."""
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
