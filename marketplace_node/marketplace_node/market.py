# SPDX-License-Identifier: Apache-2.0
"""Market as a state machine: events in, effects out, at most one current interaction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeAlias

from bt_agents_core.errors import Refused
from bt_agents_core.health import PartHealth
from bt_agents_core.open_goals import OpenGoal
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace, scene_name
from bt_agents_core.text import join_first
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.effects import (
    Alarm,
    AnnounceEarlierRun,
    AnnounceRun,
    EarlierRun,
    Note,
    SceneEnded,
    State,
    StatusChanged,
)
from marketplace_node.health import queue_health
from marketplace_node.hosts.goal_takeover import StoredGoals
from marketplace_node.hosts.host_effects import Effect, RunGoal
from marketplace_node.hosts.registry import Registration, RegistrationAnswer
from marketplace_node.interaction.interaction import (
    FEEDBACK_DEFERRED,
    NO_BIDS,
    NOT_TAKEN,
    Interaction,
)
from marketplace_node.interaction.market_failover import GATHER_S, KEPT_S, InheritedRuns
from marketplace_node.interaction.phases import OpenRound, RunEnd, StopRequest
from marketplace_node.interaction.scene_admission import SceneAdmission
from marketplace_node.interaction.stored_scenes import StoredScene, StoreScenes, read_scenes
from marketplace_node.market_state import PREVIEWS, MarketState
from marketplace_node.operator_overrides import OperatorAction, OperatorCommand
from marketplace_node.operators import OperatorCommands, Previews
from marketplace_node.outcomes import RunEventKind, RunOutcome
from marketplace_node.round.auction import check_round
from marketplace_node.round.decision import Bids, External
from marketplace_node.settings import Settings

_Stored: TypeAlias = tuple[tuple[StoredScene, ...], int, tuple[StoredGoals, ...], tuple[str, ...]]
"""Stored scenes, number of scenes taken so far, open goals, and live hosts."""


class Market:
    """State machine of one marketplace, from its start to its end.

    Every method that reports an event takes the steady time ``now`` [s] and returns the effects to
    execute, in order. Events of an old round, run or host change nothing.

    Args:
        space: The scene parameters.
        epoch: Name of this instance of the market; unique over restarts.
        settings: Replaceable by :meth:`configure`.
        rules: Rules of the strategy ``rules``.
        secret: Known to no other process; the tokens of hosts depend on it.
    """

    def __init__(
        self,
        space: SceneSpace,
        epoch: str,
        settings: Settings | None = None,
        rules: tuple[MarketRule, ...] = (),
        *,
        secret: bytes,
    ) -> None:
        self.epoch = epoch
        self._market_state = MarketState(space, epoch, settings or Settings(), rules, secret)
        self._hosts = self._market_state.hosts
        self._interaction: Interaction | None = None
        self._admission = SceneAdmission(self._market_state)
        self._operator_commands = OperatorCommands(self._market_state, self._admission)
        self._previews = Previews(self._market_state)
        self._inherited = InheritedRuns(self._market_state, self._admission)
        self._stored: _Stored = ((), 0, (), ())
        self._has_stored_ends = False
        self._finished_scene_id = ""
        self._last_round = 0
        self._last_text = "waiting for a scene"
        self._status: StatusChanged | None = None

    @property
    def settings(self) -> Settings:
        """Settings in force; replaced by :meth:`configure`."""
        return self._market_state.settings

    @property
    def state(self) -> State:
        """State of the current interaction; ``IDLE`` without one."""
        return self._interaction.state if self._interaction else State.IDLE

    @property
    def goal(self) -> RunGoal | None:
        """Goal of the award in force; None without one."""
        return self._interaction.goal if self._interaction else None

    @property
    def due(self) -> float:
        """The next deadline, steady time [s]; infinite for none."""
        due = self._interaction.due if self._interaction else math.inf
        return min([due, *(open_round.due for open_round in self._open_rounds())])

    def configure(self, settings: Settings, now: float) -> list[Effect]:
        """Replace the settings; deadlines already set stay."""
        self._market_state.settings = settings
        self._hosts.configure(settings)
        return self._settle(now)

    def shut_down(self, reason: str, now: float) -> list[Effect]:
        """Take no more scenes, end the queued ones and stop the running tree."""
        self._admission.close(reason, now)
        self._previews.give_up(RefusalCode.SHUTTING_DOWN, reason)
        self._ask_again(math.inf)
        self._inherited.close(reason)
        if self._interaction is not None:
            self._interaction.stop(StopRequest(reason=reason, code=RefusalCode.SHUTTING_DOWN), now)
        return self._settle(now)

    def scene(self, scene: Scene, now: float) -> list[Effect]:
        """Take a new scene: start an interaction, queue it, or refuse it."""
        self._admission.take(scene, self._interaction)
        return self._settle(now)

    def malformed(self, scene_id: str, refused: Refused, now: float) -> list[Effect]:
        """End a scene that could not be read; ``scene_id`` is empty if it was not found.

        No program can wait for the end of a scene without an id, so that end is not announced: a
        flood of such ends would push others out of the history of the middleware.
        """
        if scene_id:
            self._admission.refuse(scene_id, refused.code, refused.reason)
        else:
            self._market_state.effects.append(Note(message=f"{refused}; no end is announced"))
        return self._settle(now)

    def unreported(self, host: str, runs: Iterable[EarlierRun], now: float) -> list[Effect]:
        """Take the ended runs of an earlier market that a registered host reports."""
        self._inherited.take(host, runs, now, obstacle=self._admission.closed_reason)
        return self._settle(now)

    def register(
        self, registration: Registration, now: float
    ) -> tuple[RegistrationAnswer, list[Effect]]:
        """Register a host; returns ``Connect`` if it needs a new connection."""
        answer = self._hosts.register(registration, now)
        if answer.accepted:
            self._inherited.on_register(registration.host, registration.instance)
        return answer, self._check_host(now)

    def disconnect(self, host: str, now: float) -> list[Effect]:
        """Forget a host that cannot be reached."""
        self._hosts.remove(host)
        return self._check_host(now)

    def heartbeat(
        self, host: str, instance: str, epoch: str, round_number: int, now: float
    ) -> list[Effect]:
        """Take the heartbeat of a host, which names its current run; round 0 means none."""
        if self._hosts.registry.heartbeat(host, instance, now):
            under_way = None if self.state is State.COLLECTING else self.goal
            self._hosts.heartbeat(host, epoch, round_number, under_way, now)
            self._inherited.on_heartbeat(host, epoch, round_number, now)
            if self._interaction is not None:
                self._interaction.on_heartbeat(host, epoch, round_number, now)
        return self._settle(now)

    def open_goals(
        self, host: str, instance: str, goals: tuple[OpenGoal, ...], now: float
    ) -> list[Effect]:
        """Take the list of goals that a start of a host has open at servers."""
        self._hosts.open_goals(host, instance, goals, now)
        return self._settle(now)

    def goals_cancelled(
        self, host: str, instance: str, unconfirmed: tuple[OpenGoal, ...], now: float
    ) -> list[Effect]:
        """Handle the end of a cancellation; ``unconfirmed`` goals may still run."""
        message = self._hosts.takeover.ended(host, instance, unconfirmed)
        if message:
            self._market_state.effects.append(Alarm(message=message))
        return self._settle(now)

    def extend_after_stall(self, since: float, now: float) -> list[Effect]:
        """Renew leases and move deadlines, because the market was stalled since ``since``."""
        self._hosts.extend_after_stall(since, now)
        self._inherited.extend_after_stall(now - since)
        self._admission.extend_after_stall(now - since)
        if self._interaction is not None:
            self._interaction.extend_after_stall(now - since)
        for open_round in self._open_rounds():
            open_round.extend_after_stall(now - since)
        return self._settle(now)

    def extend_leases(self, checked_at: float, now: float) -> list[Effect]:
        """Extend the leases of hosts by a delay of the market itself; it may be a stall."""
        if now - checked_at > self.settings.host_lease_s / 2:
            return self.extend_after_stall(checked_at, now)
        self._hosts.registry.extend_leases(checked_at, now)
        return []

    def called(self, round_number: int, now: float) -> list[Effect]:
        """Start the clock of a round: its call for bids is published."""
        for open_round in self._open_rounds():
            if open_round.number == round_number:
                open_round.called(now)
        return self._settle(now)

    def bids(self, bids: Bids, now: float) -> list[Effect]:
        """Take a host's unchecked answer."""
        rounds = self._open_rounds()
        named = next((r for r in rounds if r.number == bids.round), None)
        real = [r for r in rounds if r.number <= PREVIEWS]
        if named is not None and bids.epoch == self.epoch and named.takes_bids:
            named.take(bids)
            if self._interaction is not None:
                self._interaction.close_when_due(now)
        elif bids.epoch == self.epoch and self._was_opened(bids.round):
            self._note(f"bids of {bids.host} are late: round {bids.round} is closed")
        elif real and real[0].takes_bids:
            # An answer that belongs to no open round is recorded in the first one.
            real[0].take(bids)
        else:
            try:
                check_round(bids, self.epoch, self._market_state.rounds)
                self._note(f"bids of {bids.host} refused: no round has been opened yet")
            except Refused as refused:
                self._note(f"bids of {bids.host} refused: {refused}")
        return self._settle(now)

    def ranked(self, round_number: int, external: External, now: float) -> list[Effect]:
        """Take an external ranking, or the reason why there is none; a late one is only logged."""
        if not any(r.number == round_number and r.ranked(external) for r in self._open_rounds()):
            self._note(f"a ranking from outside is late: round {round_number} is closed")
        elif self._interaction is not None:
            self._interaction.close_when_due(now)
        return self._settle(now)

    def operate(self, command: OperatorCommand, now: float) -> tuple[str, list[Effect]]:
        """Execute a command of an operator; return the answer in words, and the effects.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``NO_SCENE``, or as in :class:`OperatorOverrides` and
                for new scenes; nothing is changed.
        """
        message = self._operator_commands.take(command, self._interaction, now)
        if command.action is not OperatorAction.AWARD:
            self._market_state.store(at_once=True)
        return message, self._settle(now)

    def restore_overrides(self, text: str, now: float) -> tuple[str, list[Effect]]:
        """Restore pins, vetoes and counts that an earlier market stored, before any scene.

        Returns:
            The pins and vetoes in words, empty for none, and the effects.

        Raises:
            Refused: ``MALFORMED``; nothing is changed.
        """
        self._market_state.restore(text)
        return self._market_state.overrides.intervention(""), self._settle(now)

    def restore_scenes(self, text: str, away_s: float, now: float) -> tuple[int, list[Effect]]:
        """Restore the scenes and goals that an earlier market stored, before any scene or host.

        Args:
            text: The stored text.
            away_s: How long there was no market [s].
            now: Steady time [s].

        Returns:
            The number of scenes, and the effects.

        Raises:
            Refused: ``MALFORMED``; nothing is changed.
        """
        stored = read_scenes(text, self._market_state.space)
        if away_s <= KEPT_S:
            self._admission.remember(stored.taken)
        self._hosts.takeover.restore(stored.open_goals, now + GATHER_S)
        self._hosts.earlier_hosts = frozenset(stored.hosts)
        self._admission.remember(end.scene_id for end in stored.ends)
        self._inherited.announce(stored.run_ends)
        self._market_state.effects += stored.ends
        for one in stored.scenes:
            self._restore(one, away_s, now)
        if stored.scenes:
            self._admission.hold(now + GATHER_S)
        return len(stored.scenes), self._settle(now)

    def _restore(self, stored: StoredScene, away_s: float, now: float) -> None:
        scene, run = stored.scene, stored.run
        if run is not None and not run.code:
            self._admission.remember([scene.scene_id])
            self._inherited.expect(scene, run, now)
        elif run is not None:
            message = f"{run.message}; the marketplace was restarted"
            self._market_state.effects.append(
                SceneEnded(
                    scene_id=scene.scene_id, code=run.code, message=message, agent=run.agent
                )
            )
        elif away_s > KEPT_S:
            message = f"there was no marketplace for {away_s:.0f} s, expected {KEPT_S:g} s at most"
            self._admission.refuse(scene.scene_id, RunOutcome.LOST.name, message)
        else:
            self._admission.restore(scene)
            if stored.award is not None:
                self._market_state.overrides.restore_award(scene.scene_id, stored.award)

    def preview(self, scene: Scene | None, strategy: str, now: float) -> tuple[int, list[Effect]]:
        """Open a preview of who would win; ``PreviewEnded`` with the returned number follows.

        Without a scene it uses the last one, without a strategy the one in force.

        Raises:
            Refused: ``NO_SCENE``, ``SHUTTING_DOWN``, ``UNKNOWN_STRATEGY`` or ``BUSY``.
        """
        if self._admission.closed_reason:
            raise Refused(RefusalCode.SHUTTING_DOWN, self._admission.closed_reason)
        number = self._previews.ask(self._operator_commands.scene(scene), strategy, now)
        return number, self._settle(now)

    def goal_accepted(self, goal: RunGoal, now: float) -> list[Effect]:
        """Handle the acceptance of a goal; one that is no longer awaited is cancelled."""
        if self._interaction is None or not self._interaction.accepted(goal, now):
            late = f"it took the run of round {goal.round} too late"
            self._hosts.give_up(goal, late, now, runs=True)
        return self._settle(now)

    def goal_refused(self, goal: RunGoal, reason: str, now: float) -> list[Effect]:
        """Handle a goal that the host refused, or that could not be sent."""
        if self._interaction is not None:
            self._interaction.refused(goal, reason, now)
        return self._settle(now)

    def run_ended(self, goal: RunGoal, end: RunEnd, now: float) -> list[Effect]:
        """Handle the end of a run, as its host reports it."""
        if self._interaction is None or not self._interaction.ended(goal, end, now):
            self._hosts.ended(goal)
        return self._settle(now)

    def collected(self, round_number: int, message: str, now: float) -> list[Effect]:
        """Handle the answer of the feedback service, or its absence; ``message`` says which."""
        if self._interaction is not None and round_number == self._interaction.round:
            self._interaction.collected(message)
        return self._settle(now)

    def feedback_deferred(self, round_number: int, now: float) -> list[Effect]:
        """Stop waiting for the feedback service, which is away and is asked until it answers."""
        return self.collected(round_number, FEEDBACK_DEFERRED, now)

    def cancel(
        self, epoch: str, round_number: int, stop: StopRequest, now: float
    ) -> tuple[bool, str, list[Effect]]:
        """Stop the current interaction.

        Args:
            epoch: Market of the run; empty for this one.
            round_number: Round of the run; 0 for any run and all queued scenes.
            stop: The reason, and whether to ask again.
            now: Steady time [s].

        Returns:
            Whether the request is carried out, the answer in words, and the effects.
        """
        current = self._interaction.round if self._interaction else self._last_round
        if epoch not in ("", self.epoch):
            accepted, message = False, f"the market '{epoch}' is gone, this one is '{self.epoch}'"
        elif self._interaction is None and round_number == 0 and len(self._admission):
            accepted = not stop.again
            message = "nothing runs" + self._admission.forget(stop.reason, now) * accepted
        elif self._interaction is None:
            accepted, message = False, "nothing runs"
        elif round_number not in (0, current):
            accepted = False
            message = f"round {round_number} does not run; the current one is {current}"
        else:
            accepted, message = self._interaction.stop(stop, now)
            if accepted and round_number == 0 and not stop.again:
                message += self._admission.forget(stop.reason, now)
        return accepted, message, self._settle(now)

    def tick(self, now: float) -> list[Effect]:
        """Act on expired leases and deadlines."""
        self._ask_again(now)
        self._inherited.tick(now)
        if self._interaction is not None:
            self._interaction.tick(now)
        self._hosts.take_over_goals(now)
        return self._settle(now, confirms=True)

    def _check_host(self, now: float) -> list[Effect]:
        if self._interaction is not None:
            self._interaction.check_host(now)
        self._hosts.take_over_goals(now)
        return self._settle(now)

    def _ask_again(self, now: float) -> None:
        for scene in self._inherited.due(now):
            self._admission.take(scene, self._interaction)

    def _open_rounds(self) -> list[OpenRound]:
        of_interaction = self._interaction.open_round if self._interaction else None
        of_market = [r for r in (of_interaction, self._admission.open_round) if r is not None]
        return [*of_market, *self._previews.open_rounds]

    def _was_opened(self, round_number: int) -> bool:
        previews = PREVIEWS < round_number <= PREVIEWS + self._market_state.previews
        return previews or 0 < round_number <= self._market_state.rounds

    def _note(self, message: str) -> None:
        self._market_state.effects.append(Note(message=message))

    def _settle(self, now: float, *, confirms: bool = False) -> list[Effect]:
        """End finished scenes, begin waiting ones, report a changed state, return the effects.

        Args:
            now: Steady time [s].
            confirms: Whether to store that all previous ends were announced.
        """
        self._admission.start(now)
        self._previews.update(now)
        self._admission.update(self._interaction, now)
        if self._interaction is not None:
            self._interaction.go_on(now)
        self._finish(now)
        while self._interaction is None and (queued := self._admission.next(now)) is not None:
            self._interaction = Interaction(self._market_state, queued, now)
            self._finish(now)
        status = self._describe(now)
        effects = self._market_state.take_effects()
        ends = tuple(
            effect
            for effect in effects
            if isinstance(effect, SceneEnded) and effect.code != RefusalCode.DUPLICATE
        )
        store = self._store_scenes(effects, ends, now, confirms=confirms)
        for end in ends:
            self._market_state.overrides.forget(end.scene_id)
        if status != self._status:
            self._status = status
            effects.append(status)
        # Stored before the ends are announced, so the next start does not contradict them.
        return [store, *effects] if store is not None else effects

    def _store_scenes(
        self, effects: list[Effect], ends: tuple[SceneEnded, ...], now: float, *, confirms: bool
    ) -> StoreScenes | None:
        """Return the effect that stores what a later market must know; None if it is stored.

        Ends are stored together with the removal of their scenes, so neither can be lost.
        """
        hosts = tuple(entry.host for entry in self._hosts.registry.live(now))
        stored = (*self._stored_scenes(), self._hosts.takeover.stored, hosts)
        changed = stored != self._stored
        if not changed and not (confirms and self._has_stored_ends):
            return None
        self._stored = stored
        run_ends = tuple(run for effect in effects if (run := self._run_end(effect)))
        self._has_stored_ends = bool(ends or run_ends)
        scenes, _, open_goals, _ = stored
        return StoreScenes(
            scenes=scenes,
            taken=self._admission.known,
            open_goals=open_goals,
            hosts=hosts,
            ends=tuple(replace(end, epoch=end.epoch or self.epoch) for end in ends),
            run_ends=run_ends,
            at_once=changed,
        )

    def _run_end(self, effect: Effect) -> EarlierRun | None:
        """Return the run end that an effect announces, in the form for a later market."""
        match effect:
            case AnnounceEarlierRun():
                return effect.run
            case AnnounceRun(event=RunEventKind.ENDED):
                return EarlierRun(**vars(effect), epoch=self.epoch)
            case _:
                return None

    def _stored_scenes(self) -> tuple[tuple[StoredScene, ...], int]:
        """Return the scenes without an end, next first, and the number taken so far."""
        interaction = self._interaction
        under_way = [(interaction.origin, interaction.last_run)] if interaction else []
        queued = [(scene, None) for scene in self._admission.scenes]
        award_of = self._market_state.overrides.award_of
        scenes = [
            StoredScene(scene=scene, award=award_of(scene.scene_id), run=run)
            for scene, run in [*under_way, *queued]
        ]
        return (*self._inherited.stored, *scenes), self._admission.taken

    def _finish(self, now: float) -> None:
        interaction = self._interaction
        if interaction is None or interaction.over is None:
            return
        scene_id = interaction.origin.scene_id
        in_vain = interaction.over.code in (NO_BIDS, NOT_TAKEN)
        if in_vain and self._admission.put_back(interaction, now):
            self._last_round = interaction.round
            self._last_text = f"scene '{scene_id}' waits again: {interaction.over.message}"
            self._interaction = None
            return
        self._finished_scene_id = scene_id
        self._last_round = interaction.round
        self._last_text = f"scene '{scene_id}' is over: {interaction.over.message}"
        self._interaction = None
        self._market_state.effects.append(interaction.over)

    def health(self, now: float) -> tuple[PartHealth, ...]:
        """Return the health of the hosts and of the queue."""
        queued = len(self._admission)
        awaited = self._admission.awaited_hosts(now) if queued else None
        return self._hosts.health(now), queue_health(queued, tuple(awaited or ()))

    def _describe(self, now: float) -> StatusChanged:
        interaction = self._interaction
        goal = interaction.goal if interaction else None
        live = self._hosts.registry.with_heartbeat(now)
        awaited = self._admission.awaited_hosts(now) if len(self._admission) else None
        text = _waiting_text(awaited) if awaited is not None else self._last_text
        return StatusChanged(
            state=self.state,
            round=interaction.round if interaction else self._last_round,
            scene_id=interaction.origin.scene_id if interaction else "",
            scene_label=scene_name(interaction.scene) if interaction else "",
            agent=goal.agent if goal else "",
            host=goal.host if goal else "",
            finished_scene_id=self._finished_scene_id,
            queued=len(self._admission),
            waiting=self._admission.labels,
            awaited_hosts=tuple(awaited or ()),
            refused_hosts=self._hosts.registry.refused(now),
            hosts=len(live),
            agents=sum(len(entry.agents) for entry in live),
            strategy=self.settings.strategy,
            shadow_strategy=self.settings.shadow_strategy,
            pinned=self._market_state.overrides.pinned,
            vetoed=self._market_state.overrides.vetoed,
            starved=self._market_state.starved(),
            problems=self._market_state.undecided(),
            message=interaction.state_text() if interaction else text,
        )


def _waiting_text(awaited: Mapping[str, str]) -> str:
    """Return in words which hosts scenes wait for; empty means hosts that have yet to register."""
    if not awaited:
        return "waiting for hosts to register"
    return f"waiting for {join_first(f'{host} ({why})' for host, why in awaited.items())}"
