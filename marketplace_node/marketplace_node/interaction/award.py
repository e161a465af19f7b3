# SPDX-License-Identifier: Apache-2.0
"""Award of a run and its lifecycle: accepted or refused, running, stopping, ended."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene
from bt_agents_core.stop_cause import StopCause, StoppedBy
from marketplace_node.effects import AnnounceRun
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.outcomes import RunEventKind, RunOutcome

STOPPED = "STOPPED"
PREEMPTED = "PREEMPTED"


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
