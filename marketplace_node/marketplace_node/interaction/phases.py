# SPDX-License-Identifier: Apache-2.0
"""Phases of an interaction: an open round takes bids, then an award follows the run to its end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene
from bt_agents_core.stop_cause import StopCause, StoppedBy
from marketplace_node.effects import AnnounceRun, OpenCall, RequestRanking
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.market_state import MarketState
from marketplace_node.outcomes import RunEventKind, RunOutcome
from marketplace_node.round.auction import Auction
from marketplace_node.round.decision import Bids, ClosedBy, Decision, External
from marketplace_node.settings import EXTERNAL

STOPPED = "STOPPED"
PREEMPTED = "PREEMPTED"

_LEAST_TO_RANK = 2  # a single bid wins without an external ranking


class OpenRound:
    """Round that takes bids; its owner closes it when :meth:`closing` says so.

    With the strategy ``external`` the round first stops taking bids and asks an external program
    to rank them; it closes with the answer, or without one after ``external.limit``.
    ``due`` is its deadline, steady time [s]; ``asked`` are its hosts, each with its instance.

    Args:
        market_state: Counts the round and says which hosts to ask.
        scene: Scene of the bids.
        now: Steady time [s].
        follows, excluded, preview, drawn: As in :meth:`MarketState.terms`.
        asks_external: False to skip the external ranking where the order decides nothing.
    """

    def __init__(
        self,
        market_state: MarketState,
        scene: Scene,
        now: float,
        *,
        follows: int = 0,
        excluded: Mapping[str, str] | None = None,
        preview: str | None = None,
        drawn: int = 0,
        asks_external: bool = True,
    ) -> None:
        excluded = excluded or {}
        terms = market_state.terms(
            scene, now, follows=follows, excluded=excluded, preview=preview, drawn=drawn
        )
        all_excluded = [*excluded, *(bid.agent for bid in terms.operator_exclusions)]
        asked = market_state.asked(all_excluded, now)
        self.asked = frozenset((entry.host, entry.instance) for entry in asked)
        self.number = terms.round
        self.scene = scene
        self._market_state = market_state
        self._terms = terms
        self._auction = Auction(market_state.space.profiles, terms, asked)
        self._limit_s = market_state.settings.bid_deadline_s
        self._opened: float | None = None
        self._bids_closed_by: ClosedBy | None = None
        self._external: External | None = None
        self._asks_external = asks_external
        # A round whose call is never published must end, too.
        self.due = now + 2 * self._limit_s
        if asked:
            market_state.effects.append(
                OpenCall(
                    round=self.number,
                    scene=scene,
                    deadline_s=self._limit_s,
                    excluded=tuple(dict.fromkeys(all_excluded)),
                    hosts=len(market_state.hosts.registry.live(now)),
                )
            )

    @property
    def takes_bids(self) -> bool:
        """False once the bids are closed and the round waits for their ranking."""
        return self._bids_closed_by is None

    def state_text(self) -> str:
        """Return in words what the round waits for."""
        return "asking for bids" if self.takes_bids else "asking outside for a ranking"

    def called(self, now: float) -> None:
        """Start the clock: the call for bids is published."""
        if self.takes_bids:
            self._opened = now
            self.due = now + self._limit_s

    def extend_after_stall(self, lasted_s: float) -> None:
        """Move the deadline by the duration of a stall [s]."""
        self.due += lasted_s

    def take(self, bids: Bids) -> None:
        """Take a host's unchecked answer; only while :attr:`takes_bids`."""
        self._auction.take(bids)

    def ranked(self, external: External) -> bool:
        """Take the external ranking; return False when the round does not wait for one."""
        waits = not self.takes_bids and self._external is None
        if waits:
            self._external = external
        return waits

    def closing(self, now: float) -> ClosedBy | None:
        """Return what closes the round now; None while it stays open."""
        if self.takes_bids:
            by = self._bids_closing(now)
            if by is None or not self._request_ranking(by, now):
                return by
        if self._external is None and now >= self.due:
            limit_s = self._terms.options["limit"]
            self._external = External(failure=f"the selector did not answer within {limit_s:g} s")
        return self._bids_closed_by if self._external is not None else None

    def close(self, by: ClosedBy, now: float, *, stopped: str = "") -> Decision:
        """Close the round and return its decision; ``stopped`` is why it is stopped, if it is."""
        opened = now if self._opened is None else self._opened
        return self._auction.close(by, now - opened, stopped=stopped, external=self._external)

    def _bids_closing(self, now: float) -> ClosedBy | None:
        if self._auction.complete:
            return ClosedBy.ALL_ANSWERED
        return ClosedBy.DEADLINE if now >= self.due else None

    def _request_ranking(self, by: ClosedBy, now: float) -> bool:
        """Ask for a ranking if the strategy wants one and there is something to rank."""
        if not self._asks_external or self._terms.strategy != EXTERNAL:
            return False
        bids = self._auction.accepted
        if len(bids) < _LEAST_TO_RANK:
            return False
        limit_s = self._terms.options["limit"]
        self._bids_closed_by = by
        self.due = now + limit_s
        self._market_state.effects.append(
            RequestRanking(
                round=self.number,
                scene=self.scene,
                agents=tuple(bid.agent for bid in bids),
                vectors=tuple(bid.vector for bid in bids),
                distances=tuple(bid.distance for bid in bids),
                limit_s=limit_s,
            )
        )
        return True


@dataclass(frozen=True, kw_only=True)
class StopRequest:
    """Order to stop a run.

    Attributes:
        reason: Reason, in words.
        by: Who requested the stop.
        again: Whether to ask the market again, without the stopped agent.
        scene: Scene to ask for then; None means the scene as awarded.
        code: Code for the end of the scene: ``STOPPED``, ``SHUTTING_DOWN``, ``PREEMPTED`` or
            ``VETOED``.
    """

    reason: str
    by: StoppedBy = StoppedBy.NOT_SAID
    again: bool = False
    scene: Scene | None = None
    code: str = STOPPED

    @property
    def hurries(self) -> bool:
        """True when the next step does not wait for the feedback on the stopped run."""
        return self.code in (PREEMPTED, RefusalCode.SHUTTING_DOWN)


@dataclass(frozen=True, kw_only=True)
class RunEnd:
    """Unchecked end of a run, as its host reports it; fields as in ``RunAgent.action``."""

    outcome: int
    message: str
    stop_cause: int = StopCause.NOT_STOPPED
    host_reason: bool = False
    orphans: tuple[str, ...] = ()
    ticks: int = 0
    overruns: int = 0


@dataclass(eq=False, kw_only=True)
class Award:
    """Goal for the winner of a round, and its state.

    Attributes:
        held: Why the goal is not sent yet; empty once it is sent.
        accepted: True once the host has accepted the goal.
        started: When it was accepted, steady time [s]; None if it was stopped before.
        stop: Why it must stop; None while it need not.
        silent_since: When the host's heartbeat began to name another run or none.
        beside: Goals that may still run during its run, in words; empty for none.
    """

    goal: RunGoal
    scene: Scene
    held: str = ""
    accepted: bool = False
    started: float | None = None
    stop: StopRequest | None = None
    silent_since: float | None = None
    beside: str = ""

    @property
    def unfinished(self) -> str:
        """Why its host is not free."""
        return f"its run of round {self.goal.round} has not ended"

    def end_code(self, outcome: RunOutcome) -> str:
        """Return the code for the end of the scene if this was its last run."""
        if self.stop is not None and self.started is None:
            return self.stop.code
        preempted = self.stop is not None and self.stop.code == PREEMPTED
        return PREEMPTED if preempted and outcome is RunOutcome.CANCELLED else outcome.name

    def event(self, kind: RunEventKind, message: str) -> AnnounceRun:
        """Return the announcement of an event before the end."""
        return AnnounceRun(
            event=kind,
            outcome=RunOutcome.NONE,
            goal=self.goal,
            scene=self.scene,
            message=message,
            stopped_by=StoppedBy.NOT_SAID if self.stop is None else self.stop.by,
            stop_reason="" if self.stop is None else self.stop.reason,
        )

    def end(self, outcome: RunOutcome, end: RunEnd, now: float) -> AnnounceRun:
        """Return the announcement of the end."""
        return replace(
            self.event(RunEventKind.ENDED, end.message),
            outcome=outcome,
            stop_cause=end.stop_cause,
            orphans=end.orphans,
            ticks=end.ticks,
            overruns=end.overruns,
            duration_s=0.0 if self.started is None else now - self.started,
        )
