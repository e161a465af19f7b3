# SPDX-License-Identifier: Apache-2.0
"""Interaction: a scene with its rounds, awards and follow-ups, until its last run ends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, follow_up_id
from marketplace_node.effects import Collect, SceneEnded, SendGoal, State
from marketplace_node.explanation.reason import reason_of
from marketplace_node.hosts.host_effects import CancelGoal, RunGoal
from marketplace_node.interaction.phases import Award, OpenRound, RunEnd, StopRequest
from marketplace_node.interaction.stored_scenes import StoredRun
from marketplace_node.market_state import MarketState
from marketplace_node.outcomes import AuctionOutcome, RunEventKind, RunOutcome
from marketplace_node.round.decision import ClosedBy, Decision

FEEDBACK_DEFERRED = "feedback is kept until the feedback node is back"

_REPORTED = (RunOutcome.SUCCEEDED, RunOutcome.FAILED, RunOutcome.CANCELLED)
NO_BIDS = "NO_BIDS"
NOT_TAKEN = "NOT_TAKEN"

_STOPPABLE = (RunOutcome.CANCELLED, RunOutcome.LOST)


@dataclass(eq=False, kw_only=True)
class QueuedScene:
    """Scene that waits for its interaction.

    Attributes:
        asked: True once a challenge for it has been opened.
        round: Number of that challenge; 0 before.
        drawn: Number of the round whose random draw it reuses, because that round decided in its
            favour; 0 for a draw of its own.
        excluded: Agents that may not bid when its turn comes, with the reason.
        declined_by: Hosts that answered without a run for it, each with its instance.
        rounds_in_vain: Rounds that led to no run for it.
        in_vain_since: When the first of them ended, steady time [s]; None before.
    """

    scene: Scene
    asked: bool = False
    round: int = 0
    drawn: int = 0
    excluded: Mapping[str, str] = field(default_factory=dict)
    declined_by: frozenset[tuple[str, str]] = frozenset()
    rounds_in_vain: int = 0
    in_vain_since: float | None = None


@dataclass(frozen=True, kw_only=True)
class _DecidingRun:
    """The ended run that decides how the scene ends; ``agent`` is empty if no tree has run."""

    goal: RunGoal
    code: str
    agent: str


class Interaction:
    """State machine of one interaction; final once ``over`` is set.

    Each agent runs at most once per interaction, so every interaction ends.

    Attributes:
        queued: Queue entry of the scene that started it.
        silent: Hosts that have not answered the last call, or have not taken their run: a later
            call may be answered otherwise.
        round: Number of its open round, else of its last one.
        open_round: The open round; None between rounds.
        due: Its deadline, apart from the open round's, steady time [s].
        over: The end of the scene; None before.
    """

    def __init__(self, market_state: MarketState, queued: QueuedScene, now: float) -> None:
        self.queued = queued
        self.silent: set[str] = set()
        self.state = State.BIDDING
        self.round = 0
        self.open_round: OpenRound | None = None
        self.over: SceneEnded | None = None
        self._market_state = market_state
        self._hosts = market_state.hosts
        self.due = math.inf
        self._decision: Decision | None = None
        self._next_rank = 0
        self._not_taken_by: list[str] = []
        self._award: Award | None = None
        self._asked: frozenset[tuple[str, str]] = frozenset()
        self._excluded = dict(queued.excluded)
        self._follow_ups = 0
        self._again: Scene | None = None
        self._deciding_run: _DecidingRun | None = None
        self._last_text = ""
        self._hurries = False
        self._open(self.origin, now, follows=0, drawn=queued.drawn)

    @property
    def origin(self) -> Scene:
        """The scene that started it."""
        return self.queued.scene

    @property
    def declined_by(self) -> frozenset[tuple[str, str]]:
        """Hosts asked in its last round that are not ``silent``, each with its instance."""
        return frozenset(one for one in self._asked if one[0] not in self.silent)

    @property
    def goal(self) -> RunGoal | None:
        """Goal of the award in force; None without one."""
        return self._award.goal if self._award else None

    @property
    def scene(self) -> Scene:
        """The scene of the current bids or run; follow-ups change it."""
        if self.open_round is not None:
            return self.open_round.scene
        return self._again or (self._award.scene if self._award else self.origin)

    @property
    def last_run(self) -> StoredRun | None:
        """The run that decides how its scene ends; None while none has begun."""
        award, run = self._award, self._deciding_run
        if award is not None and award.accepted and self.state is not State.COLLECTING:
            return self._stored_run(award.goal)
        if run is None:
            return None
        return self._stored_run(run.goal, code=run.code, message=self._last_text)

    def _stored_run(self, goal: RunGoal, *, code: str = "", message: str = "") -> StoredRun:
        return StoredRun(
            epoch=self._market_state.epoch,
            round=goal.round,
            agent=goal.agent,
            agent_id=goal.agent_id,
            host=goal.host,
            instance=goal.instance,
            code=code,
            message=message,
        )

    def state_text(self) -> str:
        """Return the state as a text for people."""
        agent = self.goal.agent if self.goal else ""
        match self.state:
            case State.AWARDING:
                held = self._award.held if self._award else ""
                return f"{agent} gets the run" + (f", but {held}" if held else "")
            case State.RUNNING:
                beside = self._award.beside if self._award else ""
                return f"{agent} is running" + (f"; {beside}" if beside else "")
            case State.CANCELLING:
                stop = self._award.stop if self._award else None
                return f"stopping {agent}" + (f": {stop.reason}" if stop else "")
            case State.COLLECTING:
                return f"{self._last_text}; collecting feedback"
            case _:
                return self.open_round.state_text() if self.open_round else "asking for bids"

    def close_when_due(self, now: float) -> None:
        """Close the open round when all hosts have answered or its time is over."""
        by = self.open_round.closing(now) if self.open_round else None
        if by is not None:
            self._close(by, now)

    def accepted(self, goal: RunGoal, now: float) -> bool:
        """Handle the acceptance of a goal; return False when it is no longer awaited."""
        award = self._award_of(goal)
        if award is not None and not award.accepted:
            award.accepted = True
            assert self._decision is not None, "an award follows a decision"
            self._market_state.count_run(goal.agent, self._decision)
            if award.stop is None:
                award.started = now
                self._enter(State.RUNNING)
                message = "the host took the run" + (f"; {award.beside}" if award.beside else "")
                self._market_state.effects.append(award.event(RunEventKind.STARTED, message))
            else:
                self._cancel(award, now)
        return award is not None

    def refused(self, goal: RunGoal, reason: str, now: float) -> None:
        """Handle a goal that the host refused, or that could not be sent."""
        award = self._award_of(goal)
        if award is not None and not award.accepted:
            self._not_taken(award, reason, now)

    def ended(self, goal: RunGoal, end: RunEnd, now: float) -> bool:
        """Handle the end of a run; return False when it is not the run of the award."""
        award = self._award_of(goal)
        if award is None or not award.accepted:
            return False
        if end.outcome in _REPORTED:
            if award.stop is not None and end.outcome == RunOutcome.CANCELLED:
                more = f" ({end.message})" if end.host_reason else ""
                end = replace(end, message=f"{award.stop.reason}{more}")
            self._end(award, RunOutcome(end.outcome), end, now)
        else:
            message = f"the host reported the unknown outcome {end.outcome}; {end.message}"
            self._end(award, RunOutcome.FAILED, replace(end, message=message), now)
        return True

    def on_heartbeat(self, host: str, epoch: str, round_number: int, now: float) -> None:
        """Record whether the host's heartbeat still names the run."""
        award = self._award
        if award is None or not award.accepted or award.goal.host != host:
            return
        if epoch == self._market_state.epoch and round_number == award.goal.round:
            award.silent_since = None
        elif award.silent_since is None:
            award.silent_since = now

    def extend_after_stall(self, lasted_s: float) -> None:
        """Move all deadlines except its round's by the duration of a stall [s]."""
        self.due += lasted_s
        if self._award is not None and self._award.silent_since is not None:
            self._award.silent_since += lasted_s

    def collected(self, message: str) -> None:
        """Handle the answer of the feedback service, or its absence; ``message`` says which."""
        if self.state is State.COLLECTING:
            self._last_text += f"; {message}"
            self._proceed()

    def stop(self, stop: StopRequest, now: float) -> tuple[bool, str]:
        """Stop the interaction; return whether it will stop, and the answer in words."""
        award = self._award
        self._hurries = self._hurries or stop.hurries
        if award is None:
            self._close(ClosedBy.STOPPED, now, stop=stop)
            return True, f"round {self.round} is stopped before an award"
        if self.state is State.COLLECTING:
            return self._stop_collecting(stop)
        if award.stop is not None:
            # A request to end the interaction wins over one for another agent.
            award.stop = replace(award.stop, again=award.stop.again and stop.again)
            return True, f"{award.goal.agent} is being stopped already"
        # Without a run there is nothing to ask again, unless a veto demands another agent.
        may_follow_up = award.accepted or stop.code == RefusalCode.VETOED
        award.stop = stop if may_follow_up else replace(stop, again=False)
        self._enter(State.CANCELLING, self.due)
        self._market_state.effects.append(award.event(RunEventKind.CANCELLING, stop.reason))
        if award.held:
            self._not_taken(award, award.held, now)
            return True, f"{award.goal.agent} does not begin"
        self._cancel(award, now)
        return True, f"stopping {award.goal.agent}"

    def go_on(self, now: float) -> None:
        """Send the goal or open the round that is due, once everything else is done."""
        if self._award is not None and self._award.held:
            self._send(self._award, now)
        if self.state is State.BIDDING and self._again is not None:
            self._open(self._again, now, follows=self.round)

    def tick(self, now: float) -> None:
        """Act on a lost host and on an expired deadline."""
        self.check_host(now)
        if self.over is not None:
            return
        self.close_when_due(now)
        if self.over is None and now >= self.due:
            self.due = math.inf
            self._overdue(now)

    def check_host(self, now: float) -> None:
        """Give up a run whose host is gone or no longer knows the run."""
        award = self._award
        if award is None or self.state is State.COLLECTING:
            return
        host = award.goal.host
        if not self._hosts.registry.is_live(host, award.goal.instance, now):
            if not award.held:
                self._hosts.give_up(award.goal, award.unfinished, now, runs=award.accepted)
            gone = f"{host} is gone: no heartbeat"
            if award.accepted:
                self._lose(award, gone, now)
            else:
                self._not_taken(award, gone, now)
        elif (
            award.silent_since is not None
            and now - award.silent_since >= self._market_state.settings.host_lease_s
        ):
            self._lose(award, f"{host} runs it no more and has not said how it ended", now)

    def _overdue(self, now: float) -> None:
        settings = self._market_state.settings
        award = self._award
        assert award is not None, "outside of a round only an award has a deadline"
        if self.state is State.COLLECTING:
            self.collected(FEEDBACK_DEFERRED)
        elif award.accepted:
            self._hosts.give_up(award.goal, award.unfinished, now, runs=True)
            limit = settings.cancel_deadline_s
            self._lose(award, f"it did not end within {limit:g} s after it was told to stop", now)
        else:
            silent = "it has not said whether it takes a run"
            self._hosts.give_up(award.goal, silent, now, runs=False)
            limit = settings.goal_deadline_s
            self._not_taken(award, f"{award.goal.host} did not answer within {limit:g} s", now)

    def _open(self, scene: Scene, now: float, *, follows: int, drawn: int = 0) -> None:
        self._again = None
        self.open_round = OpenRound(
            self._market_state, scene, now, follows=follows, excluded=self._excluded, drawn=drawn
        )
        self.round = self.open_round.number
        self._asked = self.open_round.asked
        self.close_when_due(now)

    def _close(self, by: ClosedBy, now: float, *, stop: StopRequest | None = None) -> None:
        assert self.open_round is not None, "only an open round can be closed"
        decision = self.open_round.close(by, now, stopped=stop.reason if stop else "")
        called = now - decision.duration_s
        was_silent = self._hosts.registry.was_silent
        self.silent = {one for one in decision.silent_hosts if was_silent(one, called, now)}
        reason_fn = partial(reason_of, decision)
        self.open_round = None
        if decision.outcome is AuctionOutcome.AWARDED:
            self._decision, self._next_rank, self._not_taken_by = decision, 0, []
            self._award_next(decision, now)
        else:
            self._finish(stop.code if stop else NO_BIDS, reason_fn())
        # Last, because the winner must not wait for the text.
        self._market_state.publish(decision, reason_fn)

    def _award_next(self, decision: Decision, now: float) -> None:
        while self._next_rank < len(decision.ranking):
            bid = decision.ranking[self._next_rank]
            self._next_rank += 1
            goal = RunGoal(
                round=decision.terms.round,
                agent=bid.agent,
                agent_id=bid.agent_id,
                host=bid.host,
                instance=bid.instance,
            )
            self._award = Award(goal=goal, scene=decision.terms.scene)
            obstacle = self._market_state.obstacle(goal, now)
            if obstacle:
                self._decline(self._award, obstacle)
                continue
            self._send(self._award, now)
            return
        self._finish(NOT_TAKEN, f"nobody took the run: {'; '.join(self._not_taken_by)}")

    def _send(self, award: Award, now: float) -> None:
        """Send the goal, unless another host still controls the robot."""
        obstacle = self._market_state.obstacle(award.goal, now)
        if obstacle:
            self._not_taken(award, obstacle, now)
            return
        award.held = self._hosts.hold(award.goal.host, now)
        if award.held:
            self._enter(State.AWARDING)
            return
        award.beside = self._hosts.takeover.take_unconfirmed()
        self._enter(State.AWARDING, now + self._market_state.settings.goal_deadline_s)
        self._market_state.effects.append(SendGoal(goal=award.goal, scene=award.scene))

    def _decline(self, award: Award, reason: str) -> None:
        self._not_taken_by.append(f"{award.goal.agent} ({reason})")
        self._market_state.effects.append(award.event(RunEventKind.REFUSED, reason))

    def _not_taken(self, award: Award, reason: str, now: float) -> None:
        if award.stop is not None:
            message = f"stopped before it began: {award.stop.reason}"
            self._end(award, RunOutcome.CANCELLED, RunEnd(outcome=0, message=message), now)
            return
        assert self._decision is not None, "an award follows a decision"
        self.silent.add(award.goal.host)
        self._decline(award, reason)
        self._award_next(self._decision, now)

    def _cancel(self, award: Award, now: float) -> None:
        if award.accepted:
            self.due = now + self._market_state.settings.cancel_deadline_s
        self._market_state.effects.append(CancelGoal(goal=award.goal))

    def _lose(self, award: Award, message: str, now: float) -> None:
        orphans = self._hosts.lose_goals(award.goal)
        end = RunEnd(outcome=0, message=message, orphans=orphans)
        self._end(award, RunOutcome.LOST, end, now)

    def _end(self, award: Award, outcome: RunOutcome, end: RunEnd, now: float) -> None:
        goal = award.goal
        self._market_state.effects.append(award.end(outcome, end, now))
        self._last_text = f"{goal.agent} {outcome.name.lower()}: {end.message}"
        if award.started is not None or self._deciding_run is None:
            agent = "" if award.started is None else goal.agent
            self._deciding_run = _DecidingRun(goal=goal, code=award.end_code(outcome), agent=agent)
        self._plan_follow_up(award, outcome, end.message)
        if outcome is RunOutcome.LOST or award.started is None:
            self._proceed()
            return
        limit = self._market_state.settings.collect_deadline_s
        self._enter(State.COLLECTING, now + limit)
        self._market_state.effects.append(
            Collect(goal=goal, outcome=outcome, scene=award.scene, deadline_s=limit)
        )
        if self._hurries:
            self._proceed()

    def _plan_follow_up(self, award: Award, outcome: RunOutcome, message: str) -> None:
        agent = award.goal.agent
        if award.stop is None and outcome is RunOutcome.LOST:
            self._excluded[agent] = f"lost: {message}"
            self._again = award.scene
        elif award.stop is not None and award.stop.again and outcome in _STOPPABLE:
            self._excluded[agent] = f"stopped: {award.stop.reason}"
            self._follow_ups += 1
            # The live scene has the id of its origin, but each round needs a scene id of its own.
            scene_id = follow_up_id(self.origin.scene_id, self._follow_ups)
            self._again = (award.stop.scene or award.scene).with_id(scene_id)

    def _stop_collecting(self, stop: StopRequest) -> tuple[bool, str]:
        may_follow = self._again is not None and not stop.again
        if may_follow:
            self._again = None
        if stop.hurries:
            self._proceed()
        if may_follow:
            return True, "no other agent is asked"
        return False, f"the run of round {self.round} has ended already"

    def _proceed(self) -> None:
        if self._again is None:
            self._finish("", self._last_text)
        else:
            self._award = None
            self._enter(State.BIDDING)

    def _finish(self, code: str, message: str) -> None:
        """End the scene; if a tree has run for it, with the outcome of the last run."""
        agent = ""
        if self._deciding_run is not None:
            code, agent = self._deciding_run.code, self._deciding_run.agent
        self.over = SceneEnded(
            scene_id=self.origin.scene_id,
            code=code,
            message=message,
            round=self.round,
            agent=agent,
        )

    def _award_of(self, goal: RunGoal) -> Award | None:
        award = self._award
        over = award is None or award.goal != goal or self.state is State.COLLECTING
        return None if over else award

    def _enter(self, state: State, due: float = math.inf) -> None:
        self.state = state
        self.due = due
