# SPDX-License-Identifier: Apache-2.0
"""The robot's acts and questions, as a person perceives them."""

from __future__ import annotations

from typing import Any

from bt_agents_studio.projection.conversion import finite, record_of, seconds
from bt_agents_studio.projection.event_log import EventLog
from bt_agents_studio.records import QuestionsRecord, RobotActRecord, RobotRecord
from bt_agents_studio.store import Store


class RobotProjection:
    """Messages of a robot → ``robot``, ``questions``.

    Args:
        store: Store of the entries.
        log: Log of events.
    """

    def __init__(self, store: Store, log: EventLog) -> None:
        self._store = store
        self._log = log
        self.handlers = {
            "bt_agents_interfaces/msg/OpenQuestions": self._questions,
            "bt_agents_interfaces/msg/RobotState": self._robot,
            "std_msgs/msg/String": self._act,
        }

    def _act(self, message: Any, at_s: float) -> None:
        self._log.line(at_s, "robot", text=message.data)

    def _questions(self, message: Any, _at_s: float) -> None:
        self._store.put("questions", "", record_of(QuestionsRecord, message))

    def _robot(self, message: Any, at_s: float) -> None:
        acts = tuple(
            record_of(RobotActRecord, one, rate=finite(one.rate) or 1.0) for one in message.acts
        )
        before = self._store.get("robot")
        known = before.acts if isinstance(before, RobotRecord) else ()
        going_on = {(act.at_s, act.number) for act in acts}
        for act in (*known, *acts):
            place = (act.at_s, act.number)
            ended_s = None if place in going_on else seconds(message.header.stamp) or at_s
            self._log.event(
                f"act {act.at_s}/{act.number}",
                "ROBOT",
                act.kind,
                (act.at_s, ended_s),
                text=act.text or act.clip,
            )
        self._store.put("robot", "", record_of(RobotRecord, message, acts=acts))
