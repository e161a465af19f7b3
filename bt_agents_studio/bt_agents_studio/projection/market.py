# SPDX-License-Identifier: Apache-2.0
"""The market: its state, its scenes and its rounds."""

from __future__ import annotations

from typing import Any

from bt_agents_studio.projection.conversion import finite_values, parameter_value, record_of
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.records import (
    MarketRecord,
    MoodRecord,
    RefusedBidRecord,
    RoundRecord,
    RunRecord,
    SceneRecord,
)
from bt_agents_studio.store import Store


def scene_record(message: Any) -> SceneRecord:
    """Return the record of a ``Scene``."""
    remembered = {one.key: parameter_value(one.value) for one in message.remembered}
    return record_of(SceneRecord, message, remembered=remembered)


def round_record(message: Any) -> RoundRecord:
    """Return the record of an ``Auction``."""
    return record_of(
        RoundRecord,
        message,
        scene=scene_record(message.scene),
        options=finite_values(message.option_names, message.option_values, missing=False),
        refused=tuple(
            record_of(RefusedBidRecord, one, declined=one.kind == 0) for one in message.refused
        ),
        change=finite_values(message.change_names, message.change_values, missing=False),
    )


class MarketProjection:
    """Messages of the market and of the scene layer → ``market``, ``scene``, ``live``, ``rounds``.

    Args:
        store: Store of the entries.
        log: Log of events.
        mood: The scene parameter that is the mood; empty for none.
    """

    def __init__(self, store: Store, log: EventLog, mood: str) -> None:
        self._store = store
        self._log = log
        self._mood = mood
        self._moods = 0
        self.handlers = {
            "bt_agents_interfaces/msg/Auction": self._auction,
            "bt_agents_interfaces/msg/MarketStatus": self._status,
            "bt_agents_interfaces/msg/Scene": self._scene,
            "bt_agents_interfaces/msg/SceneEnd": self._scene_end,
        }

    def live(self, message: Any, at_s: float) -> None:
        """Take the live scene of a run."""
        record = scene_record(message)
        self._store.put("live", "", record)
        mood = next((one.value for one in record.values if one.name == self._mood), None)
        if mood is not None:
            self._moods += 1
            self._store.put("moods", str(self._moods), MoodRecord(at_s=at_s, mood=mood))

    def _status(self, message: Any, _at_s: float) -> None:
        self._store.put("market", "", record_of(MarketRecord, message))

    def _scene(self, message: Any, at_s: float) -> None:
        name = self._log.add_scene(message)
        if not self._is_running():
            self._store.put("scene", "", scene_record(message))
        self._log.line(at_s, "scene", text=name)

    def _is_running(self) -> bool:
        runs = (self._store.get("runs", agent) for agent in self._store.keys("runs"))
        return any(isinstance(run, RunRecord) and run.ended_s is None for run in runs)

    def _auction(self, message: Any, at_s: float) -> None:
        record = round_record(message)
        self._log.add_scene(message.scene)
        self._store.put("rounds", f"{record.epoch}/{record.round}", record)
        if not record.preview:
            self._log.line(at_s, "market", agent=record.winner, text=record.reason)
            self._log.event(
                f"round {record.epoch}/{record.round}",
                "MARKET",
                record.outcome,
                (record.at_s, record.at_s),
                agent=record.winner,
                text=record.reason,
            )

    def _scene_end(self, message: Any, at_s: float) -> None:
        text = f"'{message.scene_id}' {message.code}: {message.message}"
        self._log.line(at_s, "scene", agent=message.agent, text=text)
