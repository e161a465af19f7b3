# SPDX-License-Identifier: Apache-2.0
"""Cause of a stopped run, who wanted it and why, as nodes exchange them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class StopCause(IntEnum):
    """Cause of a stopped run; the numbers match ``RunAgent.action`` and ``Run.msg``.

    Attributes:
        NOT_STOPPED: Its tree ended by itself.
        BY_MARKET: The marketplace told the host to stop it.
        MARKET_LOST: Its marketplace was silent for too long, or was replaced by another one.
        BY_HOST: The host stopped it for its own reason.
    """

    NOT_STOPPED = 0
    BY_MARKET = 1
    MARKET_LOST = 2
    BY_HOST = 3


class StoppedBy(IntEnum):
    """Who wanted a run stopped; the numbers match ``Run.msg``.

    Attributes:
        NOT_SAID: It was not stopped, or nothing was stated.
        OPERATOR: A person who operates the robot.
        MOOD_RULE: A mood rule of the agent.
        OTHER_SCENE: A more urgent scene.
    """

    NOT_SAID = 0
    OPERATOR = 1
    MOOD_RULE = 2
    OTHER_SCENE = 3

    @classmethod
    def of(cls, number: int) -> StoppedBy:
        """Return the member for a number in a message; an unknown number is ``NOT_SAID``."""
        return cls(number) if number in set(cls) else cls.NOT_SAID


STOPPERS = ("operator", "mood rule", "other scene", "market", "host")
"""Who can stop a run, in the words of ``cancel.by``."""

_BY_MARKET = {
    StoppedBy.OPERATOR: "operator",
    StoppedBy.MOOD_RULE: "mood rule",
    StoppedBy.OTHER_SCENE: "other scene",
}


@dataclass(frozen=True, kw_only=True)
class Cancellation:
    """Values of ``cancel.by`` and ``cancel.reason``.

    Attributes:
        by: One of :data:`STOPPERS`.
        reason: Why, in words.
    """

    by: str
    reason: str


def stopper(cause: StopCause, by: StoppedBy = StoppedBy.NOT_SAID) -> str:
    """Return the word of :data:`STOPPERS` for who stopped a run."""
    if cause is StopCause.BY_HOST:
        return "host"
    return _BY_MARKET.get(by, "market")
