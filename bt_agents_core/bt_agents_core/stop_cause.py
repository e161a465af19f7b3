# SPDX-License-Identifier: Apache-2.0
"""Cause of the stop of a run, who wanted it and why, as they travel between the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class StopCause(IntEnum):
    """Cause of the stop of a run; the numbers are those of ``RunAgent.action`` and ``Run.msg``.

    Attributes:
        NOT_STOPPED: Its tree has ended by itself.
        BY_MARKET: The marketplace told the host to stop it.
        MARKET_LOST: Its marketplace was silent for too long, or another one has taken its place.
        BY_HOST: The host had a reason of its own.
    """

    NOT_STOPPED = 0
    BY_MARKET = 1
    MARKET_LOST = 2
    BY_HOST = 3


class StoppedBy(IntEnum):
    """Who wanted a run stopped; the numbers are those of ``Run.msg``.

    Attributes:
        NOT_SAID: It was not stopped, or nobody has said.
        OPERATOR: A person who operates the robot.
        MOOD_RULE: A mood rule of the agent.
        OTHER_SCENE: A scene that is more urgent.
    """

    NOT_SAID = 0
    OPERATOR = 1
    MOOD_RULE = 2
    OTHER_SCENE = 3

    @classmethod
    def of(cls, number: int) -> StoppedBy:
        """Return whom the number of a message means; one that means nobody is not said."""
        return cls(number) if number in set(cls) else cls.NOT_SAID


STOPPERS = ("operator", "mood rule", "other scene", "market", "host")
"""Who may stop a run, in the words of ``cancel.by``."""

_BY_MARKET = {
    StoppedBy.OPERATOR: "operator",
    StoppedBy.MOOD_RULE: "mood rule",
    StoppedBy.OTHER_SCENE: "other scene",
}


@dataclass(frozen=True, kw_only=True)
class Cancellation:
    """What ``cancel.by`` and ``cancel.reason`` name.

    Attributes:
        by: One of :data:`STOPPERS`.
        reason: Why, in words.
    """

    by: str
    reason: str


def stopper(cause: StopCause, by: StoppedBy = StoppedBy.NOT_SAID) -> str:
    """Return the word of :data:`STOPPERS` for whoever stopped a run."""
    if cause is StopCause.BY_HOST:
        return "host"
    return _BY_MARKET.get(by, "market")
