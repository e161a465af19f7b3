# SPDX-License-Identifier: Apache-2.0
"""Effects of the market: plain data that the node executes in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Scene, Vector
from bt_agents_core.stop_cause import StopCause, StoppedBy
from marketplace_node.hosts.host_effects import Effect, RunGoal
from marketplace_node.outcomes import RunEventKind, RunOutcome
from marketplace_node.round.decision import Decision, UndecidedRule


class State(IntEnum):
    """State of the market; the numbers match ``MarketStatus.msg``."""

    IDLE = 0
    BIDDING = 1
    AWARDING = 2
    RUNNING = 3
    CANCELLING = 4
    COLLECTING = 5


Execute = Callable[[list[Effect]], None]
"""Executes the effects that the market returns for an event."""


@dataclass(frozen=True, kw_only=True)
class OpenCall(Effect):
    """Publish the call for bids once it reaches all hosts, then report ``called``."""

    round: int
    scene: Scene
    deadline_s: float
    excluded: tuple[str, ...]
    hosts: int


@dataclass(frozen=True, kw_only=True)
class RequestRanking(Effect):
    """Request an external ranking of bids; fields as in ``SelectAgent.srv``."""

    round: int
    scene: Scene
    agents: tuple[str, ...]
    vectors: tuple[Vector, ...]
    distances: tuple[float, ...]
    limit_s: float


@dataclass(frozen=True, kw_only=True)
class PublishAuction(Effect):
    """Publish the outcome of a round; counts of shadow rounds as in ``Auction.msg``."""

    decision: Decision
    reason_fn: Callable[[], str] = field(default=str, compare=False, repr=False)
    explanation_fn: Callable[[], str] = field(default=str, compare=False, repr=False)
    shadow_rounds: int = 0
    shadow_disagreements: int = 0

    @cached_property
    def reason(self) -> str:
        """The decision on one line; formatted on first access."""
        return self.reason_fn()

    @cached_property
    def explanation(self) -> str:
        """The decision in plain sentences, one per line; formatted on first access."""
        return self.explanation_fn()


@dataclass(frozen=True, kw_only=True)
class PreviewEnded(Effect):
    """Answer a preview request with its outcome, or with the reason why there is none."""

    number: int
    outcome: PublishAuction | Refused


@dataclass(frozen=True, kw_only=True)
class SendGoal(Effect):
    """Send the goal to the winner's host."""

    goal: RunGoal
    scene: Scene


@dataclass(frozen=True, kw_only=True)
class AnnounceRun(Effect):
    """Publish an event in the life of a run; fields as in ``Run.msg``."""

    event: RunEventKind
    outcome: RunOutcome
    goal: RunGoal
    scene: Scene
    message: str
    stop_cause: int = StopCause.NOT_STOPPED
    stopped_by: StoppedBy = StoppedBy.NOT_SAID
    stop_reason: str = ""
    orphans: tuple[str, ...] = ()
    ticks: int = 0
    overruns: int = 0
    duration_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class EarlierRun(AnnounceRun):
    """End of a run of an earlier market, as its host reports it.

    Attributes:
        epoch: The earlier market.
        age_s: Time since the run ended [s].
    """

    event: RunEventKind = RunEventKind.ENDED
    epoch: str
    age_s: float = 0.0

    @property
    def cut_off(self) -> bool:
        """True when the run ended because its market or its host was lost."""
        lost = self.outcome is RunOutcome.LOST
        cancelled = self.outcome is RunOutcome.CANCELLED
        return lost or (cancelled and self.stop_cause == StopCause.MARKET_LOST)


@dataclass(frozen=True, kw_only=True)
class AnnounceEarlierRun(Effect):
    """Publish the end of a run of an earlier market that was not announced yet."""

    run: EarlierRun


@dataclass(frozen=True, kw_only=True)
class Collect(Effect):
    """Ask the feedback service for feedback on a run, within ``deadline_s`` seconds."""

    goal: RunGoal
    outcome: RunOutcome
    scene: Scene
    deadline_s: float


@dataclass(frozen=True, kw_only=True)
class StatusChanged(Effect):
    """Publish the state of the market; fields as in ``MarketStatus.msg``."""

    state: State
    round: int
    scene_id: str
    scene_label: str
    agent: str
    host: str
    finished_scene_id: str
    queued: int
    waiting: tuple[str, ...]
    awaited_hosts: tuple[str, ...]
    refused_hosts: tuple[str, ...]
    hosts: int
    agents: int
    strategy: str
    shadow_strategy: str
    pinned: str
    vetoed: tuple[str, ...]
    starved: tuple[str, ...]
    problems: tuple[UndecidedRule, ...]
    message: str


@dataclass(frozen=True, kw_only=True)
class SceneEnded(Effect):
    """Publish the end of a scene, once per scene; fields as in ``SceneEnd.msg``.

    Attributes:
        epoch: The market that ended it; empty for this one.
    """

    scene_id: str
    code: str
    message: str
    round: int = 0
    agent: str = ""
    epoch: str = ""


@dataclass(frozen=True, kw_only=True)
class StoreOverrides(Effect):
    """Store pins, vetoes and counts for :meth:`Market.restore_overrides` of a later start.

    Attributes:
        at_once: Whether an operator is about to get the answer that the change is in force.
    """

    text: str
    at_once: bool = False


@dataclass(frozen=True, kw_only=True)
class Note(Effect):
    """Log a warning, rate limited."""

    message: str


@dataclass(frozen=True, kw_only=True)
class Alarm(Effect):
    """Log a one-time warning, without the rate limit of notes."""

    message: str
