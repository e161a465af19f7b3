# SPDX-License-Identifier: Apache-2.0
"""Failover: runs inherited from an earlier market are announced, and asked again if cut off."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from bt_agents_core.scene import AGAIN, Scene, origin_id
from marketplace_node.effects import AnnounceEarlierRun, EarlierRun, Note, RunOutcome, SceneEnded
from marketplace_node.market_state import MarketState

MAX_RUNS = 10
"""As many runs a host may hand over at once."""

ASK_AGAIN_S = 10.0
"""A person waits about this long for a robot that has broken off in the middle [s]."""

GATHER_S = 1.5
"""After that long the hosts of a restarted market have registered and hear its calls [s]."""

_REMEMBERED = 400


class InheritedRuns:
    """Runs inherited from an earlier market, each taken once, each scene ended once."""

    def __init__(self, market_state: MarketState) -> None:
        self._market_state = market_state
        self._runs: deque[tuple[str, int, str]] = deque(maxlen=_REMEMBERED)
        self._scenes: deque[tuple[str, str]] = deque(maxlen=_REMEMBERED)
        self._again: list[tuple[float, Scene]] = []

    def due(self, now: float) -> list[Scene]:
        """Return the scenes to ask for again now, each once."""
        scenes = [scene for at, scene in self._again if now >= at]
        self._again = [(at, scene) for at, scene in self._again if now < at]
        return scenes

    def extend_after_stall(self, lasted_s: float) -> None:
        """Wait longer, as nobody has listened for so long [s]."""
        self._again = [(at + lasted_s, scene) for at, scene in self._again]

    def take(
        self, host: str, runs: Iterable[EarlierRun], now: float, *, obstacle: str = ""
    ) -> None:
        """Record what a host hands over, and plan to ask again for what was cut off.

        The first report about a round counts. With an ``obstacle`` nothing is asked for again.
        """
        fresh = [run for run in runs if self._is_new(host, run)]
        for run in fresh:
            self._market_state.effects.append(AnnounceEarlierRun(run=run))
        # The last run for a scene says how the scene ended.
        for run in sorted(fresh, key=lambda run: run.goal.round, reverse=True):
            origin = origin_id(run.scene.scene_id)
            if (run.epoch, origin) in self._scenes:
                continue
            self._scenes.append((run.epoch, origin))
            if run.cut_off:
                self._lose(origin, run, now, obstacle)
            else:
                message = f"{run.goal.agent} {run.outcome.name.lower()}: {run.message}"
                self._end(origin, run, run.outcome, message)

    def _is_new(self, host: str, run: EarlierRun) -> bool:
        which = (run.epoch, run.goal.round, run.goal.agent)
        if run.epoch == self._market_state.epoch:
            problem = ", but this market knows its own runs"
        elif run.goal.host != host:
            problem = f", but it was a run of '{run.goal.host}'"
        elif which in self._runs:
            problem = " once more"
        else:
            self._runs.append(which)
            return True
        report = f"{host} says how the run of round {run.goal.round} of market '{run.epoch}' ended"
        self._market_state.effects.append(Note(message=f"{report}{problem}; it is left out"))
        return False

    def _lose(self, origin: str, run: EarlierRun, now: float, obstacle: str) -> None:
        if not obstacle and origin.endswith(AGAIN):
            obstacle = "it was asked again once already"
        if not obstacle and not abs(run.age_s) < ASK_AGAIN_S:
            obstacle = f"it was cut off {run.age_s:.0f} s ago, more than {ASK_AGAIN_S:g} s"
        if obstacle:
            message = f"the marketplace was restarted; not asked again, as {obstacle}"
            self._end(origin, run, RunOutcome.LOST, message)
            return
        scene_id = origin + AGAIN
        message = f"the marketplace was restarted; asked again as scene '{scene_id}'"
        self._end(origin, run, RunOutcome.LOST, message)
        self._again.append((now + GATHER_S, run.scene.with_id(scene_id)))

    def _end(self, scene_id: str, run: EarlierRun, outcome: RunOutcome, message: str) -> None:
        self._market_state.effects.append(
            SceneEnded(scene_id=scene_id, code=outcome.name, message=message, agent=run.goal.agent)
        )
