# SPDX-License-Identifier: Apache-2.0
"""Goals and inboxes that are frozen during a step: recorded, and replayed."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, cast

from bt_agents.engine.environment import GoalRun, GoalState, Inbox
from bt_agents.recording.format import Entry
from bt_agents.recording.steps import StepLog
from bt_agents_core.field_types import Plain


@dataclass(kw_only=True)
class _GoalFields:
    """Fields of :class:`GoalRun`; there is no entry while they are as right after sending."""

    state: GoalState = GoalState.PENDING
    confirmed: bool = False
    message: str = ""
    result: Mapping[str, Plain] = field(default_factory=dict)
    feedback: Mapping[str, Plain] | None = None


class RecordingGoal:
    """A goal whose fields are recorded when polled; a cancel may change them at once.

    Its number is its position in the order of sending.
    """

    def __init__(self, run: GoalRun, number: int, log: StepLog) -> None:
        self._run = run
        self._number = number
        self._log = log
        self._recorded = asdict(_GoalFields())
        self._step = -1
        self._polled: dict[str, Any] = {}
        self._cancelled = False

    @property
    def state(self) -> GoalState:
        return cast(GoalState, self._field("state"))

    @property
    def confirmed(self) -> bool:
        return bool(self._field("confirmed"))

    @property
    def message(self) -> str:
        return str(self._field("message"))

    @property
    def result(self) -> Mapping[str, Plain]:
        return cast("Mapping[str, Plain]", self._field("result"))

    @property
    def feedback(self) -> Mapping[str, Plain] | None:
        return cast("Mapping[str, Plain] | None", self._field("feedback"))

    def cancel(self) -> None:
        self._run.cancel()
        self._step = self._log.step
        self._polled.clear()
        self._cancelled = True

    def _field(self, name: str) -> Any:
        if self._step != self._log.step:
            self._step = self._log.step
            self._polled.clear()
            self._cancelled = False
        elif name in self._polled:
            return self._polled[name]
        value = self._polled[name] = getattr(self._run, name)
        recorded = self._recorded[name]
        if value is recorded or (name != "feedback" and value == recorded):
            return value
        self._recorded[name] = value
        text = value.name if isinstance(value, GoalState) else value
        entry = {"goal": self._number, "field": name, "value": text}
        if self._cancelled:
            entry["after_cancel"] = True
        self._log.add("goals", entry)
        return value


class ReplayGoal(_GoalFields):
    """A goal with the recorded fields."""

    def __init__(self) -> None:
        super().__init__()
        self._after_cancel: dict[str, Any] = {}

    def load(self, entry: Entry) -> None:
        """Load an entry; values recorded after a cancel appear with the cancel."""
        name, value = entry["field"], entry["value"]
        if name not in _GoalFields.__annotations__:
            raise ValueError(f"a goal has no '{name}'")
        if name == "state":
            value = GoalState[value]
        if entry.get("after_cancel"):
            self._after_cancel[name] = value
        else:
            setattr(self, name, value)

    def cancel(self) -> None:
        """Apply the values that were recorded after the cancel."""
        for name, value in self._after_cancel.items():
            setattr(self, name, value)
        self._after_cancel.clear()


class RecordingInbox:
    """An inbox whose messages are recorded when taken; numbered in the order of opening."""

    def __init__(self, inbox: Inbox, number: int, log: StepLog) -> None:
        # Closures are faster: a waiting leaf asks at each tick, mostly in vain.
        take_next = inbox.take

        def take() -> Mapping[str, Plain] | None:
            message = take_next()
            if message is not None:
                log.add("messages", {"inbox": number, "message": message})
            return message

        self.take = take
        self.close = inbox.close


class ReplayInbox:
    """An inbox with the recorded messages of a step that were not taken yet."""

    def __init__(self) -> None:
        self.messages: deque[Mapping[str, Plain]] = deque()

    def take(self) -> Mapping[str, Plain] | None:
        return self.messages.popleft() if self.messages else None

    def close(self) -> None:
        """Do nothing, because nothing is open."""
