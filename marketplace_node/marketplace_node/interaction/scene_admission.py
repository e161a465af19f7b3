# SPDX-License-Identifier: Apache-2.0
"""Admission of scenes: reject, queue, or open a preemption round; and the queue itself."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene
from bt_agents_core.stop_cause import StoppedBy
from marketplace_node.effects import SceneEnded, State
from marketplace_node.interaction.interaction import Interaction, QueuedScene
from marketplace_node.interaction.phases import PREEMPTED, STOPPED, OpenRound, StopRequest
from marketplace_node.interaction.preemption import PreemptionRound
from marketplace_node.market_state import MarketState
from marketplace_node.settings import MAX_QUEUE

_REMEMBERED_SCENES = 4 * MAX_QUEUE

ROUNDS_IN_VAIN = 3
"""A scene whose hosts do not answer is given up after this many rounds at the earliest.

``host_wait_s`` must have passed since the first of them, too: a host that is shutting down refuses
its goals until it is gone.
"""


class SceneAdmission:
    """Admits scenes into the queue, and opens preemption rounds where new scenes preempt.

    One challenge is open at a time, and only while a tree runs; a scene that arrives earlier or
    during another challenge waits for its turn. Once ``closed_reason`` is set, no more scenes are
    taken. ``taken`` counts the remembered ids.

    A scene stays queued while no host can be asked about it and a host that could run it is
    expected; other scenes pass it meanwhile. A market that knows no host yet expects one for
    ``host_wait_s``.
    """

    def __init__(self, market_state: MarketState) -> None:
        self.closed_reason = ""
        self.taken = 0
        self._market_state = market_state
        self._queue: list[QueuedScene] = []
        self._known: deque[str] = deque(maxlen=_REMEMBERED_SCENES)
        self._challenge: PreemptionRound | None = None
        self._preempted_at: float | None = None
        self._started: float | None = None
        self._held_until = -math.inf

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the queued scenes, or their ids if they have no label, next first."""
        return tuple(one.scene.label or one.scene.scene_id for one in self._queue)

    @property
    def open_round(self) -> OpenRound | None:
        """The round of the open challenge; None without one."""
        return self._challenge.open_round if self._challenge else None

    def take(self, scene: Scene, interaction: Interaction | None) -> None:
        """Queue a scene, or end it at once."""
        try:
            self.join(scene, interaction)
        except Refused as refused:
            # A sender that is unsure of the delivery sends the scene again; it has ended already.
            self.remember([scene.scene_id])
            self.refuse(scene.scene_id, refused.code, refused.reason)

    def join(self, scene: Scene, interaction: Interaction | None) -> None:
        """Queue a scene: last, or after the other urgent ones if it is urgent and scenes preempt.

        Raises:
            Refused: ``SHUTTING_DOWN``, ``DUPLICATE``, ``BUSY`` or ``QUEUE_FULL``.
        """
        self._check(scene, interaction)
        self.remember([scene.scene_id])
        self._market_state.last_scene = scene
        place = len(self._queue)
        if self._preempts and scene.urgent:
            urgent = [index for index, other in enumerate(self._queue) if other.scene.urgent]
            place = urgent[-1] + 1 if urgent else 0
        self._queue.insert(place, QueuedScene(scene=scene))

    def restore(self, scene: Scene) -> None:
        """Append a scene that an earlier market took to the queue, whatever its length."""
        self.remember([scene.scene_id])
        self._market_state.last_scene = scene
        self._queue.append(QueuedScene(scene=scene))

    def remember(self, scene_ids: Iterable[str]) -> None:
        """Remember ids, so that no scene with one of them is taken again."""
        for scene_id in scene_ids:
            if scene_id not in self._known:
                self._known.append(scene_id)
                self.taken += 1

    def knows(self, scene_id: str) -> bool:
        """Return whether this id is remembered."""
        return scene_id in self._known

    def hold(self, until: float) -> None:
        """Let all scenes wait until the hosts are back, but no longer than a steady time [s]."""
        self._held_until = until

    @property
    def known(self) -> tuple[str, ...]:
        """The remembered ids, of the latest scenes."""
        return tuple(self._known)

    @property
    def scenes(self) -> list[Scene]:
        """The queued scenes, next first."""
        return [queued.scene for queued in self._queue]

    def refuse(self, scene_id: str, code: str, message: str, round_number: int = 0) -> None:
        """End a scene that no tree has run for."""
        self._market_state.effects.append(
            SceneEnded(scene_id=scene_id, code=code, message=message, round=round_number)
        )

    def next(self, now: float) -> QueuedScene | None:
        """Dequeue the next scene; None when the queue is empty or all scenes wait for hosts."""
        hosts = enumerate(self._awaited(now))
        place = next((place for place, awaited in hosts if awaited is None), None)
        return None if place is None else self._queue.pop(place)

    def put_back(self, interaction: Interaction, now: float) -> bool:
        """Requeue a scene that no host has run; return False when no host is expected for it."""
        queued = interaction.queued
        queued.rounds_in_vain += 1
        if queued.in_vain_since is None:
            queued.in_vain_since = now
        tried_s = now - queued.in_vain_since
        enough = tried_s >= self._market_state.settings.host_wait_s
        if self.closed_reason or (enough and queued.rounds_in_vain >= ROUNDS_IN_VAIN):
            return False
        for host in interaction.silent:
            self._market_state.hosts.unheard(host)
        expected = self._market_state.hosts.expected(now)
        queued.declined_by |= {one for one in interaction.declined_by if one[0] not in expected}
        if not self._expected_for(queued, expected):
            return False
        queued.asked = False
        self._queue.insert(0, queued)
        return True

    def awaited_hosts(self, now: float) -> dict[str, str] | None:
        """Return the hosts that scenes wait for, each with the reason; None when no scene waits.

        The mapping is empty when they wait for hosts that have yet to register.
        """
        found = [hosts for hosts in self._awaited(now) if hosts is not None]
        return {host: why for hosts in found for host, why in hosts.items()} if found else None

    def start(self, now: float) -> None:
        """Record when the market was started; only the first call counts."""
        if self._started is None:
            self._started = now

    def extend_after_stall(self, lasted_s: float) -> None:
        """Wait longer, because the market was stalled for ``lasted_s`` [s]."""
        self._held_until += lasted_s
        if self._started is not None:
            self._started += lasted_s

    def _awaited(self, now: float) -> Iterator[dict[str, str] | None]:
        """Yield the hosts that each queued scene waits for; None where it need not wait."""
        if not self._queue:
            return
        state = self._market_state
        expected = state.hosts.expected(now)
        none_known = not state.hosts.registry.entries()
        started = now if self._started is None else self._started
        held = now < self._held_until and not state.hosts.earlier_hosts_back(now)
        first_expected = none_known and now - started < state.settings.host_wait_s

        for queued in self._queue:
            hosts = self._expected_for(queued, expected)
            scene_id, but = queued.scene.scene_id, queued.declined_by
            if first_expected or held:
                yield {}
            elif not hosts or state.can_ask(scene_id, queued.excluded, but, now):
                yield None
            else:
                yield hosts

    def _expected_for(self, queued: QueuedScene, expected: dict[str, str]) -> dict[str, str]:
        """Return the expected hosts that could run a scene and have not declined it."""
        found = {}
        for host, reason in expected.items():
            entry = self._market_state.hosts.registry.get(host)
            assert entry is not None, "only a registered host is expected"
            declined = (host, entry.instance) in queued.declined_by
            scene_id = queued.scene.scene_id
            if not declined and self._market_state.may_run(entry, scene_id, queued.excluded):
                found[host] = reason
        return found

    def close(self, reason: str, now: float) -> None:
        """End all queued scenes, and from now on every new one."""
        self.closed_reason = reason
        self._give_up_preemption(reason, now)
        self._refuse_all(RefusalCode.SHUTTING_DOWN, reason)

    def forget(self, reason: str, now: float) -> str:
        """End all queued scenes on request; return a part of the answer in words."""
        self._give_up_preemption(reason, now)
        count = len(self._queue)
        self._refuse_all(STOPPED, f"stopped while it waited: {reason}")
        noun = "scene" if count == 1 else "scenes"
        return f"; dropped {count} waiting {noun}" if count else ""

    def update(self, interaction: Interaction | None, now: float) -> None:
        """Decide the challenge that is due, and open the next one that is allowed now."""
        if not _running(interaction) and self._challenge is not None:
            ends = interaction is not None and interaction.state is State.CANCELLING
            self._give_up_preemption("the run is being stopped" if ends else "the run ended", now)
        if self._challenge is not None and not self._preempts:
            mode = self._market_state.settings.on_new_scene
            self._give_up_preemption(f"on_new_scene is '{mode}' now", now)
        while interaction is not None and _running(interaction):
            if self._challenge is None:
                queued = next((one for one in self._queue if not one.asked), None)
                if not self._preempts or queued is None or interaction.goal is None:
                    return
                self._challenge = PreemptionRound(
                    self._market_state, queued, interaction.goal.agent, now
                )
            if not self._decide(self._challenge, interaction, now):
                return

    @property
    def _preempts(self) -> bool:
        return self._market_state.settings.on_new_scene == "preempt"

    def _check(self, scene: Scene, interaction: Interaction | None) -> None:
        if self.closed_reason:
            raise Refused(RefusalCode.SHUTTING_DOWN, self.closed_reason)
        if self.knows(scene.scene_id):
            raise Refused(
                RefusalCode.DUPLICATE,
                f"scene '{scene.scene_id}' was taken before; give every scene an id of its own",
            )
        if interaction is None and not self._queue:
            return
        if interaction is None:
            busy = f"scene '{self._queue[0].scene.scene_id}' waits for a host"
        else:
            busy = f"scene '{interaction.origin.scene_id}' is under way"
        if self._market_state.settings.on_new_scene == "reject":
            raise Refused(RefusalCode.BUSY, f"{busy} and on_new_scene is 'reject'")
        if self._preempts and _running(interaction) and self._challenge is None:
            return  # its challenge opens at once; it stays queued only if that stops no run
        # Without an interaction the first scene only waits for a host, so it does not count.
        waiting = len(self._queue) - (self._challenge is not None or interaction is None)
        limit = self._market_state.settings.queue_limit
        if waiting >= limit + self._finds_room(scene):
            raise Refused(
                RefusalCode.QUEUE_FULL, f"{busy} and {waiting} wait, at most {limit} may"
            )

    def _refuse_all(self, code: str, message: str) -> None:
        refused, self._queue = self._queue, []
        for queued in refused:
            self.refuse(queued.scene.scene_id, code, message)

    def _finds_room(self, scene: Scene) -> bool:
        """Whether a scene may wait for its challenge in a full queue, because it is urgent."""
        others = (queued for queued in self._queue if not queued.asked)
        return self._preempts and scene.urgent and not any(w.scene.urgent for w in others)

    def _decide(self, challenge: PreemptionRound, interaction: Interaction, now: float) -> bool:
        by = challenge.open_round.closing(now)
        if by is None:
            return False
        self._challenge = None
        queued, no_room = challenge.queued, self._full()
        stops, reason = challenge.decide(
            by, now, cooldown_left_s=self._cooldown_left(now), no_room=no_room
        )
        if stops:
            self._preempted_at = now
            self._queue.remove(queued)
            self._queue.insert(0, queued)
            preempted = f"preempted by scene '{queued.scene.scene_id}': {reason}"
            stop = StopRequest(reason=preempted, by=StoppedBy.OTHER_SCENE, code=PREEMPTED)
            interaction.stop(stop, now)
        elif no_room:
            self._queue.remove(queued)
            self.refuse(queued.scene.scene_id, RefusalCode.QUEUE_FULL, reason, queued.round)
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
            self._challenge.queued.asked = False
            self._challenge = None


def _running(interaction: Interaction | None) -> bool:
    return (
        interaction is not None and interaction.over is None and interaction.state is State.RUNNING
    )
