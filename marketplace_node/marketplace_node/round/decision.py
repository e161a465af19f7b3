# SPDX-License-Identifier: Apache-2.0
"""Data of a round: terms, bids and decision."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

from bt_agents_core.scene import Scene, Vector
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.outcomes import AuctionOutcome


class ClosedBy(IntEnum):
    """Event that closes a round; the numbers match ``Auction.msg``."""

    ALL_ANSWERED = 1
    DEADLINE = 2
    STOPPED = 3


class RoundKind(IntEnum):
    """Side that rejects a bid; the numbers match ``RefusedBid.msg``."""

    DECLINED = 0
    REFUSED = 1


@dataclass(frozen=True, kw_only=True)
class Bids:
    """Unchecked answer of one host; fields as in ``Bids.msg``."""

    epoch: str
    round: int
    host: str
    instance: str
    agents: tuple[str, ...]
    agent_ids: tuple[int, ...]
    vectors: Sequence[float]
    weights: Sequence[float] = ()
    declined: tuple[str, ...] = ()
    decline_reasons: tuple[str, ...] = ()
    unmet: tuple[str, ...] = ()
    token: bytes = field(default=b"", repr=False)


@dataclass(frozen=True, kw_only=True)
class AcceptedBid:
    """Bid that passed every check; ``weights`` is empty if the agent states none."""

    agent: str
    agent_id: int
    host: str
    instance: str
    vector: Vector
    weights: Vector = ()


class RankedBid(NamedTuple):
    """Accepted bid with its rank; fields as in ``RankedBid.msg``.

    ``instance`` is the start of its host. Runs in earlier starts of the market count as well.
    """

    agent: str
    agent_id: int
    host: str
    instance: str
    vector: Vector
    distance: float
    contributions: Vector
    weights: Vector
    bonus: float
    score: float
    runs: int
    last_run: int


@dataclass(frozen=True, kw_only=True)
class RefusedBid:
    """Bid outside the ranking; fields as in ``RefusedBid.msg``.

    ``unmet`` is the part of the agent's requirement that the scene lacks; empty for other reasons.
    """

    agent: str
    host: str
    kind: RoundKind
    code: str
    reason: str
    unmet: str = ""


@dataclass(frozen=True, kw_only=True)
class External:
    """Ranking by an external program, or the reason why there is none.

    Attributes:
        ranking: Names of bidders, best first; bidders not named follow by distance.
        message: Reason for the ranking, in words.
        failure: Why there is no usable answer; the Manhattan distance ranks instead.
    """

    ranking: tuple[str, ...] = ()
    message: str = ""
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class Terms:
    """Terms of a round, fixed when it opens; most fields are as in ``Auction.msg``.

    Attributes:
        excluded: Agents that may not bid because they were stopped earlier in the interaction,
            with the reason.
        operator_exclusions: Agents that an operator excluded, each as the refusal to record.
        unasked: Registered hosts that are not asked, with the reason.
        last_run: Number of the last run of each agent that has run.
        runs: How often each agent has run.
        rounds_run: Total number of runs.
        options: Options of the strategy; missing ones have their default.
        shadow: Name of the shadow strategy, which only scores; empty for none.
        rules: Rules of ``trees/market.yaml``, for the strategy ``rules``.
    """

    epoch: str
    round: int
    follows: int
    scene: Scene
    strategy: str
    tie_break: str
    excluded: Mapping[str, str] = field(default_factory=dict)
    operator_exclusions: tuple[RefusedBid, ...] = ()
    unasked: Mapping[str, str] = field(default_factory=dict)
    last_run: Mapping[str, int] = field(default_factory=dict)
    runs: Mapping[str, int] = field(default_factory=dict)
    rounds_run: int = 0
    earlier_runs: int = 0
    options: Mapping[str, float] = field(default_factory=dict)
    seed: str = ""
    shadow: str = ""
    shadow_options: Mapping[str, float] = field(default_factory=dict)
    rules: tuple[MarketRule, ...] = ()
    intervention: str = ""
    preview: bool = False


@dataclass(frozen=True, kw_only=True)
class Counterfactual:
    """Smallest change of the scene that would have made the runner-up win.

    Attributes:
        names: The parameter that changes; empty when no change was found.
        values: Its changed value.
        obstacle: Why no change can be found; empty when one was found, and when the search shows
            that no change of a single parameter is enough.
    """

    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    obstacle: str = ""


@dataclass(frozen=True, kw_only=True)
class UndecidedRule:
    """Rule of ``market.yaml`` whose condition could not be decided.

    Attributes:
        message: The reason for people, with the place in the file.
    """

    file: str
    line: int
    message: str


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """Ranking of the accepted bids, and its reasons.

    Attributes:
        bids: The bids, best first.
        bidders: The names of all bidders, in alphabetical order.
        by: Name of the strategy that ranked; ``manhattan`` if the one in the terms failed.
        fallback: Why ``manhattan`` ranked instead of the strategy; empty if the strategy ranked.
        precedence: Why some bids come before nearer ones: the rule that holds, or the message of
            the external program; empty when distances alone decide.
        placed: Number of leading bids that are placed by ``precedence``.
        shadow_winner: Winner by the shadow strategy; empty without one.
        shadow_failure: Why the shadow strategy could not rank; empty if it could.
        undecided: Rules that were evaluated and could not be decided.
        find_change: Searches for ``change``.
    """

    bids: tuple[RankedBid, ...] = ()
    bidders: Sequence[str] = ()
    by: str = ""
    fallback: str = ""
    precedence: str = ""
    placed: int = 0
    shadow_winner: str = ""
    shadow_failure: str = ""
    undecided: tuple[UndecidedRule, ...] = ()
    find_change: Callable[[], Counterfactual | None] | None = field(
        default=None, compare=False, repr=False
    )

    @cached_property
    def change(self) -> Counterfactual | None:
        """Smallest change that would have made the runner-up win; None where none is searched for.

        The search runs on first access, so that no award waits for it. A failed search becomes an
        obstacle, and the decision is announced without a change.
        """
        try:
            return self.find_change() if self.find_change is not None else None
        except Exception as error:
            # Unusual numbers may break arithmetic or a third-party strategy.
            return Counterfactual(obstacle=f"the search for it failed ({type(error).__name__})")


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision of a round; its ranking is best first, its refusals in order of arrival.

    Attributes:
        outcome: ``NO_BIDS`` also for a stopped round; ``PREEMPTS`` or ``WAITS`` for a challenge.
        duration_s: From the call to the close [s].
        silent_hosts: Asked hosts that did not answer.
        stopped: Why the round was stopped; empty if it was not.
    """

    terms: Terms
    outcome: AuctionOutcome
    closed_by: ClosedBy
    duration_s: float
    ranked: Ranked
    refused: tuple[RefusedBid, ...]
    silent_hosts: tuple[str, ...]
    stopped: str = ""

    @property
    def ranking(self) -> tuple[RankedBid, ...]:
        """Accepted bids, best first."""
        return self.ranked.bids

    @property
    def winner(self) -> RankedBid | None:
        """The best bid; None without a bid or when the round was stopped."""
        stopped = self.closed_by is ClosedBy.STOPPED
        return self.ranking[0] if self.ranking and not stopped else None

    @property
    def passed_over(self) -> RankedBid | None:
        """The nearest bid if exploration placed a farther one before it; else None."""
        if self.winner is None or self.ranked.placed or not self.winner.bonus:
            return None
        nearest = min(self.ranking, key=lambda bid: bid.distance)
        return nearest if nearest.distance < self.winner.distance else None

    @property
    def margin(self) -> float:
        """Score of the runner-up minus the winner's score; NaN without a runner-up."""
        if self.winner is None or len(self.ranking) < 2:
            return math.nan
        return self.ranking[1].score - self.ranking[0].score
