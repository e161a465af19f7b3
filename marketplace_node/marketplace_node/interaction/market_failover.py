# SPDX-License-Identifier: Apache-2.0
"""Failover: announces the runs of an earlier market, and asks again for those cut off."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from bt_agents_core.scene import AGAIN, Scene, origin_id
from marketplace_node.effects import AnnounceEarlierRun, EarlierRun, Note, SceneEnded
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.interaction.scene_admission import SceneAdmission
from marketplace_node.interaction.stored_scenes import StoredRun, StoredScene
from marketplace_node.market_state import MarketState
from marketplace_node.outcomes import RunOutcome

ASK_AGAIN_S = 10.0
"""How long a person waits for a robot that stopped in the middle, roughly [s]."""

GATHER_S = 1.5
"""The hosts of a restarted market register and connect to its calls within this time [s]."""

_REMEMBERED = 400


KEPT_S = 60.0
"""Longest outage of the market after which queued scenes are still served [s]."""


@dataclass(eq=False, kw_only=True)
class _UnreportedRun:
    """Run of an earlier market whose end its host has yet to report.

    Attributes:
        due: When the market stops waiting for the host, steady time [s].
        latest: Latest value of ``due``, steady time [s].
    """

    scene: Scene
    run: StoredRun
    due: float
    latest: float


class InheritedRuns:
    """Runs inherited from an earlier market; takes each run once and ends each scene once.

    Args:
        market_state: Shared by all rounds.
        admission: Knows the scenes taken before.
    """

    def __init__(self, market_state: MarketState, admission: SceneAdmission) -> None:
        self._market_state = market_state
        self._admission = admission
        self._unreported: dict[str, _UnreportedRun] = {}
        self._runs: deque[tuple[str, int, str]] = deque(maxlen=_REMEMBERED)
        self._scenes: deque[tuple[str, str]] = deque(maxlen=_REMEMBERED)
        self._again: list[tuple[float, Scene]] = []

    @property
    def stored(self) -> list[StoredScene]:
        """Scenes without an end: of unreported runs, and those to ask for again."""
        unreported = [
            StoredScene(scene=one.scene, run=one.run) for one in self._unreported.values()
        ]
        return unreported + [StoredScene(scene=scene) for _, scene in self._again]

    def expect(self, scene: Scene, run: StoredRun, now: float) -> None:
        """Wait for the report of how a scene's run ended; without a report the run is lost."""
        settings = self._market_state.settings
        self._unreported[scene.scene_id] = _UnreportedRun(
            scene=scene,
            run=run,
            due=now + max(settings.host_wait_s, GATHER_S),
            latest=now + max(settings.host_wait_s, settings.cancel_deadline_s),
        )

    def announce(self, runs: Iterable[EarlierRun]) -> None:
        """Announce run ends that an earlier market stored and may not have announced."""
        for run in runs:
            self._runs.append((run.epoch, run.goal.round, run.goal.agent))
            self._market_state.effects.append(AnnounceEarlierRun(run=run))

    def on_register(self, host: str, instance: str) -> None:
        """End the runs of an earlier start of a host, and their scenes."""
        for one in list(self._unreported.values()):
            if one.run.host == host and one.run.instance != instance:
                self._market_state.hosts.lose_goals(_goal_of(one.run))
                self._give_up(one, f"{host} was started again, too")

    def on_heartbeat(self, host: str, epoch: str, round_number: int, now: float) -> None:
        """Wait longer for the report of a run that its host is still stopping."""
        for one in self._unreported.values():
            if (one.run.host, one.run.epoch, one.run.round) == (host, epoch, round_number):
                one.due = min(max(one.due, now + GATHER_S), one.latest)

    def tick(self, now: float) -> None:
        """End the runs that were not reported in time, and their scenes."""
        for one in list(self._unreported.values()):
            if now >= one.due:
                self._give_up(one, f"{one.run.host} has not said how its run ended")

    def close(self, reason: str) -> None:
        """End all unreported runs, and their scenes."""
        for one in list(self._unreported.values()):
            self._give_up(one, reason)

    def _give_up(self, one: _UnreportedRun, reason: str) -> None:
        del self._unreported[one.scene.scene_id]
        run = EarlierRun(
            epoch=one.run.epoch,
            goal=_goal_of(one.run),
            scene=one.scene,
            outcome=RunOutcome.LOST,
            message=f"the marketplace was restarted, and {reason}",
            orphans=self._market_state.hosts.takeover.orphans(one.run.host, one.run.instance),
        )
        # If its host reports the run after all, the report counts as a repetition.
        self.announce([run])
        self._end(one.scene.scene_id, run, run.outcome, run.message)

    def due(self, now: float) -> list[Scene]:
        """Return the scenes to ask for again now; each is returned once."""
        back = self._market_state.hosts.earlier_hosts_back(now)
        scenes = [scene for at, scene in self._again if back or now >= at]
        self._again = [(at, scene) for at, scene in self._again if not back and now < at]
        return scenes

    def extend_after_stall(self, lasted_s: float) -> None:
        """Wait longer, because the market was stalled for ``lasted_s`` [s]."""
        self._again = [(at + lasted_s, scene) for at, scene in self._again]
        for one in self._unreported.values():
            one.due += lasted_s
            one.latest += lasted_s

    def take(
        self, host: str, runs: Iterable[EarlierRun], now: float, *, obstacle: str = ""
    ) -> None:
        """Record the runs that a host reports, and plan to ask again for those cut off.

        The first report about a round counts. With an ``obstacle``, nothing is asked for again.
        """
        fresh = [run for run in runs if self._is_new(host, run)]
        for run in fresh:
            self._market_state.effects.append(AnnounceEarlierRun(run=run))
        # The last run for a scene determines how the scene ended.
        for run in sorted(fresh, key=lambda run: run.goal.round, reverse=True):
            origin = origin_id(run.scene.scene_id)
            if (run.epoch, origin) in self._scenes:
                continue
            self._scenes.append((run.epoch, origin))
            if self._unreported.pop(origin, None) is None and self._admission.knows(origin):
                continue  # it is queued, or has ended
            self._admission.remember([origin])
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


def _goal_of(run: StoredRun) -> RunGoal:
    return RunGoal(
        round=run.round,
        agent=run.agent,
        agent_id=run.agent_id,
        host=run.host,
        instance=run.instance,
    )
