# SPDX-License-Identifier: Apache-2.0
"""Admission of scenes: reject, queue, or open a preemption round; and the queue itself."""

from __future__ import annotations

from collections import deque

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Scene
from bt_agents_core.stop_cause import StoppedBy
from marketplace_node.effects import SceneEnded, State
from marketplace_node.interaction.award import PREEMPTED, SHUTTING_DOWN, STOPPED, StopRequest
from marketplace_node.interaction.interaction import Interaction, QueuedScene
from marketplace_node.interaction.open_round import OpenRound
from marketplace_node.interaction.preemption import PreemptionRound
from marketplace_node.market_state import MarketState
from marketplace_node.settings import MAX_QUEUE

_REMEMBERED_SCENES = 4 * MAX_QUEUE


class SceneAdmission:
    """Admits scenes into the queue, or opens a preemption round where new scenes preempt.

    One challenge is open at a time, and only while a tree runs: scenes that come earlier, or
    during another challenge, are asked about when it is their turn. Once ``closed_reason`` is set
    no more scenes are taken.
    """

    def __init__(self, market_state: MarketState) -> None:
        self.closed_reason = ""
        self._market_state = market_state
        self._queue: list[QueuedScene] = []
        self._known: deque[str] = deque(maxlen=_REMEMBERED_SCENES)
        self._challenge: PreemptionRound | None = None
        self._preempted_at: float | None = None

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def waiting(self) -> tuple[str, ...]:
        """Labels of the queued scenes, or their ids without one, next first."""
        return tuple(one.scene.label or one.scene.scene_id for one in self._queue)

    @property
    def open_round(self) -> OpenRound | None:
        """The call for bids of the challenge under way."""
        return self._challenge.open_round if self._challenge else None

    def take(self, scene: Scene, interaction: Interaction | None) -> None:
        """Put a scene in the queue, or end it at once."""
        try:
            self.join(scene, interaction)
        except Refused as refused:
            self.refuse(scene.scene_id, refused.code, refused.reason)

    def join(self, scene: Scene, interaction: Interaction | None) -> None:
        """Put a scene in the queue: last, or an urgent one that preempts before the others.

        Raises:
            Refused: ``SHUTTING_DOWN``, ``DUPLICATE``, ``BUSY`` or ``QUEUE_FULL``.
        """
        self._check(scene, interaction)
        self._known.append(scene.scene_id)
        self._market_state.last_scene = scene
        place = len(self._queue)
        if self._preempts and scene.urgent:
            urgent = [index for index, other in enumerate(self._queue) if other.scene.urgent]
            place = urgent[-1] + 1 if urgent else 0
        self._queue.insert(place, QueuedScene(scene=scene))

    def refuse(self, scene_id: str, code: str, message: str, round_number: int = 0) -> None:
        """End a scene for which nothing has run."""
        self._market_state.effects.append(
            SceneEnded(scene_id=scene_id, code=code, message=message, round=round_number)
        )

    def next(self) -> QueuedScene | None:
        """Take the scene whose turn it is; None when none waits."""
        return self._queue.pop(0) if self._queue else None

    def close(self, reason: str, now: float) -> None:
        """End all scenes that wait, and from now on each one that comes."""
        self.closed_reason = reason
        self._give_up_preemption(reason, now)
        while (waiting := self.next()) is not None:
            self.refuse(waiting.scene.scene_id, SHUTTING_DOWN, reason)

    def forget(self, reason: str, now: float) -> str:
        """End all queued scenes on request; return a text for the answer."""
        self._give_up_preemption(reason, now)
        count = len(self._queue)
        while (waiting := self.next()) is not None:
            self.refuse(waiting.scene.scene_id, STOPPED, f"stopped while it waited: {reason}")
        noun = "scene that waited is" if count == 1 else "scenes that waited are"
        return f"; {count} {noun} forgotten" if count else ""

    def update(self, interaction: Interaction | None, now: float) -> None:
        """Decide the challenge that is due, and open those that are allowed now."""
        if not _running(interaction) and self._challenge is not None:
            ends = interaction is not None and interaction.state is State.CANCELLING
            self._give_up_preemption("the run is being stopped" if ends else "the run ended", now)
        if self._challenge is not None and not self._preempts:
            mode = self._market_state.settings.on_new_scene
            self._give_up_preemption(f"on_new_scene is '{mode}' now", now)
        while interaction is not None and _running(interaction):
            if self._challenge is None:
                waiting = next((one for one in self._queue if not one.asked), None)
                if not self._preempts or waiting is None or interaction.goal is None:
                    return
                self._challenge = PreemptionRound(
                    self._market_state, waiting, interaction.goal.agent, now
                )
            if not self._decide(self._challenge, interaction, now):
                return

    @property
    def _preempts(self) -> bool:
        return self._market_state.settings.on_new_scene == "preempt"

    def _check(self, scene: Scene, interaction: Interaction | None) -> None:
        if self.closed_reason:
            raise Refused(SHUTTING_DOWN, self.closed_reason)
        if scene.scene_id in self._known:
            raise Refused(
                "DUPLICATE",
                f"scene '{scene.scene_id}' was taken before; give every scene an id of its own",
            )
        if interaction is None:
            return
        busy = f"scene '{interaction.origin.scene_id}' is under way"
        if self._market_state.settings.on_new_scene == "reject":
            raise Refused("BUSY", f"{busy} and on_new_scene is 'reject'")
        if self._preempts and _running(interaction) and self._challenge is None:
            return  # it is asked about at once, and waits only when that does not stop the run
        waiting = len(self._queue) - (self._challenge is not None)
        limit = self._market_state.settings.queue_limit
        if waiting >= limit + self._finds_room(scene):
            raise Refused("QUEUE_FULL", f"{busy} and {waiting} wait, at most {limit} may")

    def _finds_room(self, scene: Scene) -> bool:
        """Whether a scene is urgent enough to wait for its challenge in a full queue."""
        others = (waiting for waiting in self._queue if not waiting.asked)
        return self._preempts and scene.urgent and not any(w.scene.urgent for w in others)

    def _decide(self, challenge: PreemptionRound, interaction: Interaction, now: float) -> bool:
        by = challenge.open_round.closing(now)
        if by is None:
            return False
        self._challenge = None
        waiting, no_room = challenge.waiting, self._full()
        stops, reason = challenge.decide(
            by, now, cooldown_left_s=self._cooldown_left(now), no_room=no_room
        )
        if stops:
            self._preempted_at = now
            self._queue.remove(waiting)
            self._queue.insert(0, waiting)
            preempted = f"preempted by scene '{waiting.scene.scene_id}': {reason}"
            stop = StopRequest(reason=preempted, by=StoppedBy.OTHER_SCENE, code=PREEMPTED)
            interaction.stop(stop, now)
        elif no_room:
            self._queue.remove(waiting)
            self.refuse(waiting.scene.scene_id, "QUEUE_FULL", reason, waiting.round)
        return True

    def _full(self) -> str:
        """Return why the scene of the challenge cannot wait; empty when it can."""
        others, limit = len(self._queue) - 1, self._market_state.settings.queue_limit
        return f"{others} wait already and at most {limit} may" if others >= limit else ""

    def _cooldown_left(self, now: float) -> float:
        if self._preempted_at is None:
            return 0.0
        return self._preempted_at + self._market_state.settings.preempt_cooldown_s - now

    def _give_up_preemption(self, reason: str, now: float) -> None:
        if self._challenge is not None:
            self._challenge.give_up(reason, now)
            self._challenge.waiting.asked = False
            self._challenge = None


def _running(interaction: Interaction | None) -> bool:
    return (
        interaction is not None and interaction.over is None and interaction.state is State.RUNNING
    )
