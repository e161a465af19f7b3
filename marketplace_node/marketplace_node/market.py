# SPDX-License-Identifier: Apache-2.0
"""The market as a state machine: events in, effects out, at most one interaction under way."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from bt_agents.errors import Refused
from bt_agents.scene import Scene, SceneSpace
from marketplace_node.auction import Bids, check_round
from marketplace_node.effects import (
    Connect,
    Effect,
    Goal,
    Note,
    SceneOver,
    SceneRefused,
    State,
    StatusChanged,
)
from marketplace_node.floor import Floor
from marketplace_node.interaction import Interaction, RunEnd, Stop
from marketplace_node.registry import Answer, Registration
from marketplace_node.settings import MAX_QUEUE, Settings

_REMEMBERED_SCENES = 4 * MAX_QUEUE


class Market:
    """One marketplace from its start to its end.

    Every method that reports an event takes the steady time ``now`` [s] and returns what is to be
    done, in order. Events of an old round, run or host change nothing.

    Args:
        space: The scene parameters.
        epoch: Name of this instance of the market; unique over restarts.
        settings: Replaceable by :meth:`configure`.

    Attributes:
        late_bids: How many answers came after their round was closed.
    """

    def __init__(self, space: SceneSpace, epoch: str, settings: Settings | None = None) -> None:
        self.epoch = epoch
        self.late_bids = 0
        self._floor = Floor(space, epoch, settings or Settings())
        self._interaction: Interaction | None = None
        self._queue: deque[Scene] = deque()
        self._known_scenes: deque[str] = deque(maxlen=_REMEMBERED_SCENES)
        self._finished_scene_id = ""
        self._last_words = "waiting for a scene"
        self._shut = ""
        self._status: StatusChanged | None = None

    @property
    def settings(self) -> Settings:
        """The settings in force."""
        return self._floor.settings

    @property
    def state(self) -> State:
        """What the market is doing."""
        return self._interaction.state if self._interaction else State.IDLE

    def configure(self, settings: Settings, now: float) -> list[Effect]:
        """Replace the settings; deadlines that are already set stay."""
        self._floor.settings = settings
        self._floor.registry.lease_s = settings.host_lease_s
        return self._settle(now)

    def shut(self, reason: str, now: float) -> list[Effect]:
        """Take no more scenes, give up those that wait and stop the running tree."""
        self._shut = reason
        self._drop_queue("SHUTTING_DOWN", reason)
        if self._interaction is not None:
            self._interaction.stop(Stop(reason=reason), now)
        return self._settle(now)

    def scene(self, scene: Scene, now: float) -> list[Effect]:
        """Take a new scene: start an interaction, let it wait, or refuse it."""
        try:
            self._admit(scene, now)
        except Refused as refused:
            self._refuse_scene(scene.scene_id, refused.code, refused.reason)
        return self._settle(now)

    def register(self, registration: Registration, now: float) -> tuple[Answer, list[Effect]]:
        """Enter a host; ``Connect`` follows when it has to be reached anew."""
        registry = self._floor.registry
        before = registry.get(registration.host)
        answer = registry.register(registration, now)
        entry = registry.get(registration.host)
        if answer.accepted and entry is not None:
            if before is None or before.instance != entry.instance:
                self._floor.free(entry.host)
            if before is None or replace(before, agents=entry.agents) != entry:
                self._floor.effects.append(Connect(entry=entry))
        return answer, self._check_host(now)

    def disconnect(self, host: str, now: float) -> list[Effect]:
        """Forget a host that cannot be reached."""
        self._floor.registry.remove(host)
        self._floor.free(host)
        return self._check_host(now)

    def heartbeat(
        self, host: str, instance: str, epoch: str, round_number: int, now: float
    ) -> list[Effect]:
        """A host is alive and says which run it is busy with; round 0 means none."""
        if self._floor.registry.beat(host, instance, now):
            self._floor.heartbeat(host, epoch, round_number, now)
            if self._interaction is not None:
                self._interaction.heard(host, epoch, round_number, now)
        return self._settle(now)

    def excuse(self, since: float, now: float) -> list[Effect]:
        """Renew the leases: the market itself has not listened since ``since``."""
        self._floor.registry.excuse(since, now)
        return self._settle(now)

    def called(self, round_number: int, now: float) -> list[Effect]:
        """Start the clock of the round, as its call for bids is published."""
        if self._interaction is not None and round_number == self._floor.round:
            self._interaction.called(now)
        return self._settle(now)

    def bids(self, bids: Bids, now: float) -> list[Effect]:
        """Take a host's answer, whatever it looks like."""
        interaction = self._interaction
        bidding = interaction is not None and interaction.bidding
        newest_closed = self._floor.round - 1 if bidding else self._floor.round
        if bids.epoch == self.epoch and 0 < bids.round <= newest_closed:
            self.late_bids += 1
            self._note(f"LATE: bids of {bids.host} for round {bids.round}, which is closed")
        elif interaction is not None and bidding:
            interaction.take(bids, now)
        else:
            try:
                check_round(bids, self.epoch, self._floor.round)
                self._note(f"bids of {bids.host} refused: no round has been opened yet")
            except Refused as refused:
                self._note(f"bids of {bids.host} refused: {refused}")
        return self._settle(now)

    def goal_accepted(self, goal: Goal, now: float) -> list[Effect]:
        """The host has taken the goal; one that nobody waits for any more is cancelled."""
        if self._interaction is not None:
            self._interaction.accepted(goal, now)
        else:
            self._floor.give_up(goal, f"it took the run of round {goal.round} too late", now)
        return self._settle(now)

    def goal_refused(self, goal: Goal, reason: str, now: float) -> list[Effect]:
        """The host does not take the goal, or it could not be sent."""
        if self._interaction is not None:
            self._interaction.refused(goal, reason, now)
        return self._settle(now)

    def run_ended(self, goal: Goal, end: RunEnd, now: float) -> list[Effect]:
        """The host reports the end of a run."""
        if self._interaction is not None:
            self._interaction.ended(goal, end, now)
        else:
            self._floor.ended(goal)
        return self._settle(now)

    def collected(self, round_number: int, message: str, now: float) -> list[Effect]:
        """The feedback service has answered, or will not answer; ``message`` says which."""
        if self._interaction is not None and round_number == self._floor.round:
            self._interaction.collected(message, now)
        return self._settle(now)

    def cancel(
        self, epoch: str, round_number: int, stop: Stop, now: float
    ) -> tuple[bool, str, list[Effect]]:
        """Stop the interaction under way.

        Args:
            epoch: Market of the run; empty for this one.
            round_number: Round of the run; 0 for whatever runs.
            stop: Why, and whether to ask again.
            now: Steady time [s].

        Returns:
            Whether it is done, the answer in words, and the effects.
        """
        current = self._floor.round
        if epoch not in ("", self.epoch):
            accepted, message = False, f"the market '{epoch}' is gone, this one is '{self.epoch}'"
        elif self._interaction is None:
            accepted, message = False, "nothing runs"
        elif round_number not in (0, current):
            accepted = False
            message = f"round {round_number} does not run; the current one is {current}"
        else:
            accepted, message = self._interaction.stop(stop, now)
        return accepted, message, self._settle(now)

    def tick(self, now: float) -> list[Effect]:
        """Act on leases and deadlines that have passed."""
        if self._interaction is not None:
            self._interaction.tick(now)
        return self._settle(now)

    def _check_host(self, now: float) -> list[Effect]:
        if self._interaction is not None:
            self._interaction.check_host(now)
        return self._settle(now)

    def _admit(self, scene: Scene, now: float) -> None:
        if self._shut:
            raise Refused("SHUTTING_DOWN", self._shut)
        if scene.scene_id in self._known_scenes:
            raise Refused(
                "DUPLICATE",
                f"scene '{scene.scene_id}' was taken before; give every scene an id of its own",
            )
        if self._interaction is not None:
            self._admit_meanwhile(scene, self._interaction, now)
        self._known_scenes.append(scene.scene_id)
        self._queue.append(scene)

    def _admit_meanwhile(self, scene: Scene, interaction: Interaction, now: float) -> None:
        busy = f"scene '{interaction.origin.scene_id}' is under way"
        limit = self.settings.queue_limit
        if self.settings.on_new_scene == "refuse":
            raise Refused("BUSY", f"{busy} and on_new_scene is 'refuse'")
        if self.settings.on_new_scene == "preempt":
            reason = f"preempted by scene '{scene.scene_id}'"
            self._drop_queue("PREEMPTED", reason)
            interaction.stop(Stop(reason=reason), now)
        elif len(self._queue) >= limit:
            raise Refused("QUEUE_FULL", f"{busy} and {len(self._queue)} wait, at most {limit} may")

    def _drop_queue(self, code: str, reason: str) -> None:
        while self._queue:
            self._refuse_scene(self._queue.popleft().scene_id, code, reason)

    def _refuse_scene(self, scene_id: str, code: str, reason: str) -> None:
        self._floor.effects.append(SceneRefused(scene_id=scene_id, code=code, reason=reason))

    def _note(self, message: str) -> None:
        self._floor.effects.append(Note(message=message))

    def _settle(self, now: float) -> list[Effect]:
        """End what is over, begin what waits, report a changed state, hand over the effects."""
        self._finish()
        while self._interaction is None and self._queue:
            self._interaction = Interaction(self._floor, self._queue.popleft(), now)
            self._finish()
        status = self._describe(now)
        effects = self._floor.effects
        if status != self._status:
            self._status = status
            effects.append(status)
        self._floor.effects = []
        return effects

    def _finish(self) -> None:
        interaction = self._interaction
        if interaction is None or interaction.over is None:
            return
        scene_id = interaction.origin.scene_id
        self._finished_scene_id = scene_id
        self._last_words = f"scene '{scene_id}' is over: {interaction.over}"
        self._interaction = None
        self._floor.effects.append(SceneOver(scene_id=scene_id, message=interaction.over))

    def _describe(self, now: float) -> StatusChanged:
        interaction = self._interaction
        goal = interaction.goal if interaction else None
        live = self._floor.registry.live(now)
        return StatusChanged(
            state=self.state,
            round=self._floor.round,
            scene_id=interaction.origin.scene_id if interaction else "",
            agent=goal.agent if goal else "",
            host=goal.host if goal else "",
            finished_scene_id=self._finished_scene_id,
            queued=len(self._queue),
            hosts=len(live),
            agents=sum(len(entry.agents) for entry in live),
            message=interaction.words() if interaction else self._last_words,
        )
