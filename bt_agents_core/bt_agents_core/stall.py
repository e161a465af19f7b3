# SPDX-License-Identifier: Apache-2.0
"""Notices that this process was held up, so that it does not go on with what is long over."""

from __future__ import annotations

from dataclasses import dataclass

LIMIT_S = 0.5
"""A process that nobody had a turn in for longer than this was held up [s]."""

_LOOK_AGAIN_S = 0.1


class StallDetector:
    """Compares the times at which it is looked at; all are on the steady clock [s].

    Args:
        now: The time.
        limit_s: Nobody looked for longer than this: the process was held up.
        calm_s: How long afterwards to wait for news of what has happened meanwhile.

    Attributes:
        lasted_s: How long it was held up last.
        sure: False after that until somebody who was not has confirmed what holds now.
    """

    def __init__(self, now: float, *, limit_s: float = LIMIT_S, calm_s: float = 0.3) -> None:
        self.lasted_s = 0.0
        self.sure = True
        self._last = now
        self._limit_s = limit_s
        self._calm_s = calm_s
        self._until = now

    def wait_s(self, now: float) -> float:
        """Look at the time; return how long not to act, 0 for not at all [s]."""
        gap, self._last = now - self._last, now
        if gap > self._limit_s:
            self.lasted_s = gap
            self.sure = False
            self._until = now + self._calm_s
        return max(0.0, self._until - now)


@dataclass(frozen=True, kw_only=True)
class RunKey:
    """Who has the robot, in words of a market: its name, the round and the agent; or nobody."""

    epoch: str
    round: int = 0
    agent: str = ""


class AwardMonitor:
    """What the market has said last of who has the robot, and whether that still counts.

    Args:
        now: The time on the steady clock [s].

    Attributes:
        held_up: Notices that this process was held up.
    """

    def __init__(self, now: float) -> None:
        self.held_up = StallDetector(now)
        self._award: RunKey | None = None

    def hear(self, award: RunKey, run: RunKey | None, now: float) -> bool:
        """Take what a market says; return True when the run under way was given away.

        Args:
            award: Who has the robot.
            run: The run under way; None without one.
            now: The time [s].
        """
        if run is not None and run.epoch != award.epoch:
            return False
        before, self._award = self._award, award
        if self.held_up.sure or self.held_up.wait_s(now):
            return False
        if run is None or award == run:
            self.held_up.sure = True
            return False
        # Twice, as the first may be from before the award.
        return before is not None and before.epoch == run.epoch and before != run

    def is_over(self, run: RunKey) -> bool:
        """Return whether the market is at a later round already."""
        said = self._award
        return said is not None and said.epoch == run.epoch and said.round > run.round

    def wait_s(self, run: RunKey, now: float) -> float:
        """Return how long to wait before a run goes on [s].

        A market that has never said who has the robot will not do so now.
        """
        calm_s = self.held_up.wait_s(now)
        speaks = self._award is not None and self._award.epoch == run.epoch
        return calm_s if self.held_up.sure or not speaks else max(calm_s, _LOOK_AGAIN_S)
