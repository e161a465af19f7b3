# SPDX-License-Identifier: Apache-2.0
"""Data of a round: its terms, its bids and its decision."""

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
    """Event that closes a round; the numbers are those of ``Auction.msg``."""

    ALL_ANSWERED = 1
    DEADLINE = 2
    STOPPED = 3


class RoundKind(IntEnum):
    """Side that does not want a bid; the numbers are those of ``RefusedBid.msg``."""

    DECLINED = 0
    REFUSED = 1


@dataclass(frozen=True, kw_only=True)
class Bids:
    """Answer of one host before any check; fields as in ``Bids.msg``.

    Attributes:
        participant: The process it is from, as the middleware says; empty where it does not.
    """

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
    participant: str = ""


@dataclass(frozen=True, kw_only=True)
class AcceptedBid:
    """Bid that passed every check; ``weights`` is empty when the agent states none."""

    agent: str
    agent_id: int
    host: str
    instance: str
    vector: Vector
    weights: Vector = ()


class RankedBid(NamedTuple):
    """Accepted bid as the strategy ranked it; fields as in ``RankedBid.msg``.

    ``instance`` is the start of its host. Runs in earlier starts of the market count, too.
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

    ``unmet`` is what the scene lacks of what the agent requires, empty for any other reason.
    """

    agent: str
    host: str
    kind: RoundKind
    code: str
    reason: str
    unmet: str = ""


@dataclass(frozen=True, kw_only=True)
class External:
    """Ranking by an external program, or why there is none.

    Attributes:
        ranking: Names of bidders, best first; those not named come after these by distance.
        message: How it came to that, in words.
        failure: Why there is no usable answer; then it is ranked by Manhattan distance.
    """

    ranking: tuple[str, ...] = ()
    message: str = ""
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class Terms:
    """Terms of a round, fixed when it opens; fields as in ``Auction.msg``, and some more.

    Attributes:
        excluded: Agents that may not bid, as they were stopped earlier in the interaction, with
            the reason.
        operator_exclusions: Agents that may not bid by order of an operator, each as the refusal
            that is recorded.
        unasked: Registered hosts that are not asked, with the reason.
        last_run: Number of the last run of each agent that ever ran.
        runs: How often each agent has run.
        rounds_run: How many runs there were in all.
        options: What is set about the strategy; what is not, has its default.
        shadow: Name of a strategy that only scores; empty for none.
        rules: Of ``trees/market.yaml``, for the strategy ``rules``.
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
    """Smallest change of the scene by which the runner-up would have won.

    Attributes:
        names: The parameter that changes; empty when no change was found.
        values: Its value then.
        obstacle: Why none can be found; empty when one was, and when the search shows that no
            value of a single parameter is enough.
    """

    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    obstacle: str = ""


@dataclass(frozen=True, kw_only=True)
class UndecidedRule:
    """Rule of ``market.yaml`` whose condition was neither true nor false.

    Attributes:
        message: Why, for people, with the place.
    """

    file: str
    line: int
    message: str


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """Ranking of the accepted bids, and its reasons.

    Attributes:
        bids: Best first.
        bidders: The names of all, in alphabetical order.
        by: Name of the strategy that ranked; ``manhattan`` where that of the terms could not.
        fallback: Why the strategy could not rank and ``manhattan`` did; empty when it could.
        precedence: Why some bids come before nearer ones: the rule that holds, or what the
            program outside said; empty when distances alone decide.
        placed: How many bids, from the first, are there by ``precedence``.
        shadow_winner: Who would have won by the shadow strategy; empty without one.
        shadow_failure: Why the shadow strategy could not rank; empty when it could.
        undecided: Rules that were looked at and could not be decided.
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
        """Smallest change by which the runner-up would have won; None where none is searched for.

        It is searched for when it is first asked for, so that no award waits for it. A search
        that fails is an obstacle: the decision is announced without it.
        """
        try:
            return self.find_change() if self.find_change is not None else None
        except Exception as error:
            # Whatever arithmetic, or a strategy of another package, makes of unusual numbers.
            return Counterfactual(obstacle=f"the search for it failed ({type(error).__name__})")


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision of a round; its ranking is best first, its refusals are in the order they came.

    Attributes:
        outcome: ``NO_BIDS`` also when the round was stopped; of a challenge ``PREEMPTS`` or
            ``WAITS``.
        duration_s: From the call to the close [s].
        silent_hosts: Hosts that were asked and did not answer.
        stopped: Why the round was stopped; empty when it was not.
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
        """Accepted bids; the best first."""
        return self.ranked.bids

    @property
    def winner(self) -> RankedBid | None:
        """The best bid; None without a bid and when the round was stopped."""
        stopped = self.closed_by is ClosedBy.STOPPED
        return self.ranking[0] if self.ranking and not stopped else None

    @property
    def passed_over(self) -> RankedBid | None:
        """The nearest bid, where exploration put one that is further before it; else None."""
        if self.winner is None or self.ranked.placed or not self.winner.bonus:
            return None
        nearest = min(self.ranking, key=lambda bid: bid.distance)
        return nearest if nearest.distance < self.winner.distance else None

    @property
    def margin(self) -> float:
        """Score of the runner-up minus that of the winner; NaN without a runner-up."""
        if self.winner is None or len(self.ranking) < 2:
            return math.nan
        return self.ranking[1].score - self.ranking[0].score
