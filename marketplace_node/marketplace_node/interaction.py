# SPDX-License-Identifier: Apache-2.0
"""One interaction: a scene, its bids and awards, follow-up rounds, the end of the last run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from bt_agents.scene import Scene
from marketplace_node import explain
from marketplace_node.auction import Auction, Bids, ClosedBy, Decision, Outcome
from marketplace_node.effects import (
    AnnounceRun,
    CancelGoal,
    Collect,
    Goal,
    OpenCall,
    PublishAuction,
    RunEventKind,
    RunOutcome,
    SendGoal,
    State,
)
from marketplace_node.floor import Floor

_REPORTED = (RunOutcome.SUCCEEDED, RunOutcome.FAILED, RunOutcome.CANCELLED)
_STOPPABLE = (RunOutcome.CANCELLED, RunOutcome.LOST)


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Why a run is told to stop, and whether to ask again afterwards.

    Attributes:
        reason: Why, in words.
        again: True: ask the market again, without the stopped agent.
        scene: What to ask for then; None means the scene as awarded.
    """

    reason: str
    again: bool = False
    scene: Scene | None = None


@dataclass(frozen=True, kw_only=True)
class RunEnd:
    """How a run ended; ``outcome`` is as in ``RunAgent.action`` and may be anything."""

    outcome: int
    message: str
    orphans: tuple[str, ...] = ()
    ticks: int = 0


@dataclass(eq=False, kw_only=True)
class _Run:
    """An award: ``started`` is None for one that was stopped before it was accepted."""

    goal: Goal
    accepted: bool = False
    started: float | None = None
    stop: Stop | None = None
    unheard_since: float | None = None


class Interaction:
    """Conducts one interaction; whoever drives it calls nothing more once ``over`` is set.

    Each agent runs at most once in an interaction, so it comes to an end.

    Attributes:
        origin: The scene that started it.
        state: What is going on.
        over: How it ended, in words; None before.
    """

    def __init__(self, floor: Floor, origin: Scene, now: float) -> None:
        self.origin = origin
        self.state = State.BIDDING
        self.over: str | None = None
        self._floor = floor
        self._deadline: float | None = None
        self._excluded: dict[str, str] = {}
        self._follow_ups = 0
        self._again: Scene | None = None
        self._last_words = ""
        self._round = _Round(scene=origin)
        self._open(origin, now, follows=0)

    @property
    def goal(self) -> Goal | None:
        """The award of the moment."""
        return self._round.run.goal if self._round.run else None

    @property
    def bidding(self) -> bool:
        """True while the round is open."""
        return self._round.auction is not None

    def words(self) -> str:
        """Return the state in words."""
        agent = self.goal.agent if self.goal else ""
        match self.state:
            case State.AWARDING:
                return f"{agent} gets the run"
            case State.RUNNING:
                return f"{agent} is running"
            case State.CANCELLING:
                return f"{agent} is told to stop"
            case State.COLLECTING:
                return f"{self._last_words}; collecting feedback"
            case _:
                return "asking for bids"

    def called(self, now: float) -> None:
        """Start the clock of the round, as its call for bids is published."""
        if self._round.auction is not None:
            self._round.opened = now
            self._deadline = now + self._floor.settings.bid_deadline_s

    def take(self, bids: Bids, now: float) -> None:
        """Take a host's answer to the open round."""
        auction = self._round.auction
        if auction is not None:
            auction.take(bids)
            if auction.complete:
                self._close(ClosedBy.ALL_ANSWERED, now)

    def accepted(self, goal: Goal, now: float) -> None:
        """The host has taken the goal; one that nobody waits for any more is cancelled."""
        run = self._waiting(goal)
        if run is None:
            self._floor.give_up(goal, f"it took the run of round {goal.round} too late", now)
        elif not run.accepted:
            run.accepted = True
            self._floor.count_run(goal.agent)
            if run.stop is None:
                run.started = now
                self._enter(State.RUNNING)
                self._announce(run, RunEventKind.STARTED, "the host took the run")
            else:
                self._cancel(run, now)

    def refused(self, goal: Goal, reason: str, now: float) -> None:
        """The host does not take the goal, or it could not be sent."""
        run = self._waiting(goal)
        if run is not None and not run.accepted:
            self._not_taken(run, reason, now)

    def ended(self, goal: Goal, end: RunEnd, now: float) -> None:
        """The host reports the end of a run."""
        run = self._waiting(goal)
        if run is None or not run.accepted:
            self._floor.ended(goal)
        elif end.outcome in _REPORTED:
            if run.stop is not None and end.outcome == RunOutcome.CANCELLED:
                end = replace(end, message=f"{run.stop.reason} ({end.message})")
            self._end(run, RunOutcome(end.outcome), end, now)
        else:
            message = f"the host reported the unknown outcome {end.outcome}; {end.message}"
            self._end(run, RunOutcome.FAILED, replace(end, message=message), now)

    def heard(self, host: str, epoch: str, round_number: int, now: float) -> None:
        """Note whether the host's heartbeat still names the run."""
        run = self._round.run
        if run is None or not run.accepted or run.goal.host != host:
            return
        if epoch == self._floor.epoch and round_number == run.goal.round:
            run.unheard_since = None
        elif run.unheard_since is None:
            run.unheard_since = now

    def collected(self, message: str, now: float) -> None:
        """The feedback service has answered, or will not answer; ``message`` says which."""
        if self.state is State.COLLECTING:
            self._last_words += f"; {message}"
            self._proceed(now)

    def stop(self, stop: Stop, now: float) -> tuple[bool, str]:
        """Stop what is going on; return whether it will, and the answer in words."""
        run = self._round.run
        if run is None:
            self._close(ClosedBy.STOPPED, now, stopped=stop.reason)
            return True, f"round {self._floor.round} is stopped before an award"
        if self.state is State.COLLECTING:
            if self._again is None or stop.again:
                return False, f"the run of round {self._floor.round} has ended already"
            self._again = None
            return True, "no other agent is asked"
        if run.stop is not None:
            # Whoever wants an end wins over whoever wants another agent.
            run.stop = replace(run.stop, again=run.stop.again and stop.again)
            return True, f"{run.goal.agent} is being stopped already"
        # Without a run there is nothing to ask again about.
        run.stop = stop if run.accepted else replace(stop, again=False)
        self._enter(State.CANCELLING, self._deadline)
        self._announce(run, RunEventKind.CANCELLING, stop.reason)
        self._cancel(run, now)
        return True, f"{run.goal.agent} is told to stop"

    def tick(self, now: float) -> None:
        """Act on a host that is gone and on a deadline that has passed."""
        self.check_host(now)
        if self.over is None and self._deadline is not None and now >= self._deadline:
            self._deadline = None
            self._overdue(now)

    def check_host(self, now: float) -> None:
        """Give up a run whose host is gone or no longer knows of it."""
        run = self._round.run
        if run is None or self.state is State.COLLECTING:
            return
        host = run.goal.host
        if not self._floor.registry.is_live(host, run.goal.instance, now):
            self._floor.give_up(run.goal, self._unfinished(run), now)
            gone = f"{host} is gone: no heartbeat"
            if run.accepted:
                self._lose(run, gone, now)
            else:
                self._not_taken(run, gone, now)
        elif (
            run.unheard_since is not None
            and now - run.unheard_since >= self._floor.settings.host_lease_s
        ):
            self._lose(run, f"{host} runs it no more and has not said how it ended", now)

    def _overdue(self, now: float) -> None:
        settings = self._floor.settings
        run = self._round.run
        if run is None:
            self._close(ClosedBy.DEADLINE, now)
        elif self.state is State.COLLECTING:
            self.collected("feedback was not collected in time", now)
        elif run.accepted:
            self._floor.give_up(run.goal, self._unfinished(run), now)
            limit = settings.cancel_deadline_s
            self._lose(run, f"it did not end within {limit:g} s after it was told to stop", now)
        else:
            self._floor.give_up(run.goal, "it has not said whether it takes a run", now)
            limit = settings.goal_deadline_s
            self._not_taken(run, f"{run.goal.host} did not answer within {limit:g} s", now)

    def _open(self, scene: Scene, now: float, *, follows: int) -> None:
        asked, unasked = self._floor.whom_to_ask(self._excluded, now)
        terms = self._floor.terms(scene, follows=follows, excluded=self._excluded, unasked=unasked)
        self._again = None
        self._round = _Round(scene=scene, auction=Auction(self._floor.space, terms, asked))
        if not asked:
            self._close(ClosedBy.ALL_ANSWERED, now)
            return
        limit = self._floor.settings.bid_deadline_s
        self._enter(State.BIDDING, now + 2 * limit)
        self._floor.effects.append(
            OpenCall(
                round=self._floor.round,
                scene=scene,
                deadline_s=limit,
                excluded=tuple(self._excluded),
                hosts=len(self._floor.registry.live(now)),
            )
        )

    def _close(self, by: ClosedBy, now: float, *, stopped: str = "") -> None:
        current = self._round
        assert current.auction is not None, "only an open round can be closed"
        opened = now if current.opened is None else current.opened
        decision = current.auction.close(by, now - opened, stopped=stopped)
        reason = explain.reason(decision)
        current.decision, current.auction = decision, None
        self._floor.effects.append(PublishAuction(decision=decision, reason=reason))
        if decision.outcome is Outcome.AWARDED:
            self._award(decision, now)
        else:
            self.over = reason

    def _award(self, decision: Decision, now: float) -> None:
        current = self._round
        while current.next_rank < len(decision.ranking):
            bid = decision.ranking[current.next_rank]
            current.next_rank += 1
            goal = Goal(
                round=decision.terms.round,
                agent=bid.agent,
                agent_id=bid.agent_id,
                host=bid.host,
                instance=bid.instance,
            )
            current.run = _Run(goal=goal)
            obstacle = self._floor.obstacle(goal, now)
            if obstacle:
                self._decline(current.run, obstacle)
                continue
            self._enter(State.AWARDING, now + self._floor.settings.goal_deadline_s)
            self._floor.effects.append(SendGoal(goal=goal, scene=current.scene))
            return
        self.over = f"nobody took the run: {'; '.join(current.not_taken)}"

    def _decline(self, run: _Run, reason: str) -> None:
        self._round.not_taken.append(f"{run.goal.agent} ({reason})")
        self._announce(run, RunEventKind.REFUSED, reason)

    def _not_taken(self, run: _Run, reason: str, now: float) -> None:
        if run.stop is not None:
            message = f"stopped before it began: {run.stop.reason}"
            self._end(run, RunOutcome.CANCELLED, RunEnd(outcome=0, message=message), now)
            return
        assert self._round.decision is not None, "an award follows a decision"
        self._decline(run, reason)
        self._award(self._round.decision, now)

    def _cancel(self, run: _Run, now: float) -> None:
        if run.accepted:
            self._deadline = now + self._floor.settings.cancel_deadline_s
        self._floor.effects.append(CancelGoal(goal=run.goal))

    def _lose(self, run: _Run, message: str, now: float) -> None:
        self._end(run, RunOutcome.LOST, RunEnd(outcome=0, message=message), now)

    def _end(self, run: _Run, outcome: RunOutcome, end: RunEnd, now: float) -> None:
        duration = 0.0 if run.started is None else now - run.started
        self._announce(run, RunEventKind.ENDED, end.message, outcome, end, duration)
        self._last_words = f"{run.goal.agent} {outcome.name.lower()}: {end.message}"
        self._plan_follow_up(run, outcome, end.message)
        if outcome is RunOutcome.LOST or run.started is None:
            self._proceed(now)
            return
        limit = self._floor.settings.collect_deadline_s
        self._enter(State.COLLECTING, now + limit)
        self._floor.effects.append(
            Collect(goal=run.goal, outcome=outcome, scene=self._round.scene, deadline_s=limit)
        )

    def _plan_follow_up(self, run: _Run, outcome: RunOutcome, message: str) -> None:
        agent = run.goal.agent
        if run.stop is None and outcome is RunOutcome.LOST:
            self._excluded[agent] = f"lost: {message}"
            self._again = self._round.scene
        elif run.stop is not None and run.stop.again and outcome in _STOPPABLE:
            self._excluded[agent] = f"stopped: {run.stop.reason}"
            self._follow_ups += 1
            # The live scene bears the id of its scene; each round is for a scene of its own.
            scene_id = f"{self.origin.scene_id}+{self._follow_ups}"
            self._again = (run.stop.scene or self._round.scene).with_id(scene_id)

    def _proceed(self, now: float) -> None:
        if self._again is None:
            self.over = self._last_words
        else:
            self._open(self._again, now, follows=self._floor.round)

    def _waiting(self, goal: Goal) -> _Run | None:
        run = self._round.run
        over = run is None or run.goal != goal or self.state is State.COLLECTING
        return None if over else run

    @staticmethod
    def _unfinished(run: _Run) -> str:
        return f"its run of round {run.goal.round} has not ended"

    def _announce(
        self,
        run: _Run,
        event: RunEventKind,
        message: str,
        outcome: RunOutcome = RunOutcome.NONE,
        end: RunEnd | None = None,
        duration_s: float = 0.0,
    ) -> None:
        self._floor.effects.append(
            AnnounceRun(
                event=event,
                outcome=outcome,
                goal=run.goal,
                scene=self._round.scene,
                message=message,
                orphans=end.orphans if end else (),
                ticks=end.ticks if end else 0,
                duration_s=duration_s,
            )
        )

    def _enter(self, state: State, deadline: float | None = None) -> None:
        self.state = state
        self._deadline = deadline


@dataclass(eq=False, kw_only=True)
class _Round:
    """A round: ``auction`` while it is open, ``decision`` afterwards, ``run`` once awarded."""

    scene: Scene
    auction: Auction | None = None
    opened: float | None = None
    decision: Decision | None = None
    next_rank: int = 0
    not_taken: list[str] = field(default_factory=list)
    run: _Run | None = None
