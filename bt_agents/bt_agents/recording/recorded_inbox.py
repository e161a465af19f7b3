# SPDX-License-Identifier: Apache-2.0
"""Inboxes whose messages are recorded when they are taken, and replayed in the same step."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from bt_agents.engine.environment import Inbox
from bt_agents.recording.step_log import StepLog
from bt_agents_core.field_types import Plain


class RecordingInbox:
    """An inbox whose messages are recorded when they are taken.

    Args:
        inbox: The inbox.
        number: Its number in the order in which inboxes were opened.
        log: Takes the entries.
    """

    def __init__(self, inbox: Inbox, number: int, log: StepLog) -> None:
        # Closures: a leaf that waits asks at each tick, mostly for nothing.
        take_next = inbox.take

        def take() -> Mapping[str, Plain] | None:
            message = take_next()
            if message is not None:
                log.add("messages", {"inbox": number, "message": message})
            return message

        self.take = take
        self.close = inbox.close


class ReplayInbox:
    """An inbox that has the recorded messages of a step.

    Attributes:
        messages: Those of this step that were not taken yet.
    """

    def __init__(self) -> None:
        self.messages: deque[Mapping[str, Plain]] = deque()

    def take(self) -> Mapping[str, Plain] | None:
        """See :class:`Inbox`."""
        return self.messages.popleft() if self.messages else None

    def close(self) -> None:
        """See :class:`Inbox`."""
