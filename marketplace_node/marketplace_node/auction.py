# SPDX-License-Identifier: Apache-2.0
"""One round of the marketplace: bids from whoever was asked, then exactly one outcome."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from bt_agents.errors import Refused
from bt_agents.scene import Scene, SceneSpace, Vector
from marketplace_node.registry import HostEntry
from marketplace_node.strategies import STRATEGIES


class Outcome(IntEnum):
    """How a round ends; the numbers are those of ``Auction.msg``."""

    AWARDED = 1
    NO_BIDS = 2
    PREEMPTS = 3
    WAITS = 4


class ClosedBy(IntEnum):
    """What closes a round; the numbers are those of ``Auction.msg``."""

    ALL_ANSWERED = 1
    DEADLINE = 2
    STOPPED = 3


class Kind(IntEnum):
    """Who does not want a bid; the numbers are those of ``RefusedBid.msg``."""

    DECLINED = 0
    REFUSED = 1


@dataclass(frozen=True, kw_only=True)
class Bids:
    """One host's answer, as it came in and before any check; fields as in ``Bids.msg``."""

    epoch: str
    round: int
    host: str
    instance: str
    agents: tuple[str, ...]
    agent_ids: tuple[int, ...]
    vectors: Vector
    declined: tuple[str, ...] = ()
    decline_reasons: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RankedBid:
    """An accepted bid; ``last_run`` counts the runs of the market, 0 when the agent never ran."""

    agent: str
    agent_id: int
    host: str
    instance: str
    vector: Vector
    distance: float
    last_run: int


@dataclass(frozen=True, kw_only=True)
class RefusedBid:
    """A bid outside the ranking; ``agent`` is empty when a whole message is refused."""

    agent: str
    host: str
    kind: Kind
    code: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Terms:
    """What is fixed when a round opens.

    Attributes:
        epoch: The instance of the market.
        round: Number of the round, from 1.
        follows: The round this one continues, 0 for none.
        scene: What the bids are for.
        strategy: Name of the ranking function.
        tie_break: Which of equally distant bids wins.
        excluded: Agents that may not bid, with the reason.
        unasked: Registered hosts that are not asked, with the reason.
        last_run: Number of the last run of each agent that ever ran.
    """

    epoch: str
    round: int
    follows: int
    scene: Scene
    strategy: str
    tie_break: str
    excluded: Mapping[str, str] = field(default_factory=dict)
    unasked: Mapping[str, str] = field(default_factory=dict)
    last_run: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The outcome of a round.

    Attributes:
        terms: What was fixed at the opening.
        outcome: ``NO_BIDS`` also when the round was stopped; of a challenge ``PREEMPTS`` or
            ``WAITS``.
        closed_by: What closed it.
        duration_s: From the call to the close [s].
        ranking: Accepted bids, best first.
        refused: Declined and refused bids, in the order they came.
        silent_hosts: Hosts that were asked and did not answer.
        stopped: Why the round was stopped; empty when it was not.
    """

    terms: Terms
    outcome: Outcome
    closed_by: ClosedBy
    duration_s: float
    ranking: tuple[RankedBid, ...]
    refused: tuple[RefusedBid, ...]
    silent_hosts: tuple[str, ...]
    stopped: str = ""

    @property
    def winner(self) -> RankedBid | None:
        """The best bid; None without a bid and when the round was stopped."""
        stopped = self.closed_by is ClosedBy.STOPPED
        return self.ranking[0] if self.ranking and not stopped else None

    @property
    def margin(self) -> float:
        """Distance of the runner-up minus that of the winner; NaN without a runner-up."""
        if self.winner is None or len(self.ranking) < 2:
            return math.nan
        return self.ranking[1].distance - self.ranking[0].distance


class Auction:
    """An open round.

    Args:
        space: The scene parameters; the one validator of every vector.
        terms: What the round is about.
        asked: The hosts that are asked.
    """

    def __init__(self, space: SceneSpace, terms: Terms, asked: Iterable[HostEntry]) -> None:
        self.terms = terms
        self._space = space
        self._asked = {entry.host: entry for entry in asked}
        self._answered: set[str] = set()
        self._accepted: list[RankedBid] = []
        self._refused: list[RefusedBid] = []

    @property
    def complete(self) -> bool:
        """True when every host that was asked has answered."""
        return len(self._answered) == len(self._asked)

    def take(self, bids: Bids) -> None:
        """Take one message; whatever is wrong with it is recorded, never raised."""
        try:
            entry = self._sender(bids)
        except Refused as refused:
            self._refuse(bids, _only_agent(bids), refused)
            return
        self._answered.add(entry.host)
        try:
            self._check_lengths(bids)
        except Refused as refused:
            self._refuse(bids, _only_agent(bids), refused)
            return
        named: set[str] = set()
        for agent, agent_id, vector in _rows(bids, len(self._space)):
            try:
                self._check_agent(agent, entry, named)
                self._accept(agent, agent_id, vector, entry)
            except Refused as refused:
                self._refuse(bids, agent, refused)
            named.add(agent)
        for agent, reason in zip(bids.declined, bids.decline_reasons, strict=True):
            try:
                self._check_agent(agent, entry, named)
                self._record(bids, agent, Kind.DECLINED, "DECLINED", reason or "gives no reason")
            except Refused as refused:
                self._refuse(bids, agent, refused)
            named.add(agent)
        for agent in entry.agents:
            if agent not in named and agent not in self.terms.excluded:
                self._record(
                    bids, agent, Kind.REFUSED, "NO_ANSWER", f"{entry.host} says nothing about it"
                )

    def close(self, by: ClosedBy, duration_s: float, *, stopped: str = "") -> Decision:
        """Rank what was accepted and return the outcome.

        Args:
            by: What closes the round.
            duration_s: From the call to now [s].
            stopped: Why the round is stopped; only with ``ClosedBy.STOPPED``.
        """
        by_name = self.terms.tie_break == "name"
        ranking = sorted(
            self._accepted, key=lambda b: (b.distance, 0 if by_name else b.last_run, b.agent)
        )
        awarded = bool(ranking) and by is not ClosedBy.STOPPED
        return Decision(
            terms=self.terms,
            outcome=Outcome.AWARDED if awarded else Outcome.NO_BIDS,
            closed_by=by,
            duration_s=duration_s,
            ranking=tuple(ranking),
            refused=tuple(self._refused),
            silent_hosts=tuple(h for h in self._asked if h not in self._answered),
            stopped=stopped,
        )

    def _sender(self, bids: Bids) -> HostEntry:
        check_round(bids, self.terms.epoch, self.terms.round)
        entry = self._asked.get(bids.host)
        if entry is None:
            raise Refused(
                "UNREGISTERED",
                f"'{bids.host}' was not asked in round {self.terms.round}; a host registers first",
            )
        if bids.instance != entry.instance:
            raise Refused(
                "WRONG_INSTANCE",
                f"{bids.host} answers as instance '{bids.instance}', "
                f"'{entry.instance}' was asked; register after every start",
            )
        if bids.host in self._answered:
            raise Refused(
                "DUPLICATE", f"{bids.host} has answered already; the first answer counts"
            )
        return entry

    def _check_lengths(self, bids: Bids) -> None:
        agents, width = len(bids.agents), len(self._space)
        if len(bids.agent_ids) != agents or len(bids.vectors) != agents * width:
            raise Refused(
                "WRONG_LENGTH",
                f"{agents} agents with {len(bids.agent_ids)} ids and {len(bids.vectors)} values, "
                f"expected {agents} ids and {agents * width} values: "
                f"{', '.join(self._space.names)} of each agent",
            )
        if len(bids.declined) != len(bids.decline_reasons):
            raise Refused(
                "WRONG_LENGTH",
                f"{len(bids.declined)} agents decline with {len(bids.decline_reasons)} reasons, "
                "expected one reason each",
            )

    def _check_agent(self, agent: str, entry: HostEntry, named: set[str]) -> None:
        if agent not in entry.agents:
            raise Refused(
                "UNKNOWN_AGENT",
                f"{entry.host} has no registered agent '{agent}'; register after every change",
            )
        if agent in named:
            raise Refused("DUPLICATE", f"'{agent}' is named twice; the first one counts")

    def _accept(self, agent: str, agent_id: int, vector: Vector, entry: HostEntry) -> None:
        if agent in self.terms.excluded:
            raise Refused("EXCLUDED", f"'{agent}' may not bid: {self.terms.excluded[agent]}")
        if agent_id != entry.agents[agent]:
            raise Refused(
                "WRONG_ID", f"'{agent}' bids with id {agent_id}, expected {entry.agents[agent]}"
            )
        checked = self._space.vector(vector, what=f"bid of {agent}")
        self._accepted.append(
            RankedBid(
                agent=agent,
                agent_id=agent_id,
                host=entry.host,
                instance=entry.instance,
                vector=checked,
                distance=STRATEGIES[self.terms.strategy](checked, self.terms.scene.vector),
                last_run=self.terms.last_run.get(agent, 0),
            )
        )

    def _refuse(self, bids: Bids, agent: str, refused: Refused) -> None:
        self._record(bids, agent, Kind.REFUSED, refused.code, refused.reason)

    def _record(self, bids: Bids, agent: str, kind: Kind, code: str, reason: str) -> None:
        self._refused.append(
            RefusedBid(agent=agent, host=bids.host, kind=kind, code=code, reason=reason)
        )


def check_round(bids: Bids, epoch: str, current: int) -> None:
    """Check that bids belong to the current round of this market.

    Raises:
        Refused: ``FOREIGN_EPOCH`` or ``FOREIGN_ROUND``.
    """
    if bids.epoch != epoch:
        raise Refused(
            "FOREIGN_EPOCH", f"bids for the market '{bids.epoch}', this one is '{epoch}'"
        )
    if bids.round != current:
        raise Refused(
            "FOREIGN_ROUND", f"bids for round {bids.round}, the current one is {current}"
        )


def _only_agent(bids: Bids) -> str:
    return bids.agents[0] if len(bids.agents) == 1 else ""


def _rows(bids: Bids, width: int) -> Iterator[tuple[str, int, Vector]]:
    for index, (agent, agent_id) in enumerate(zip(bids.agents, bids.agent_ids, strict=True)):
        yield agent, agent_id, bids.vectors[index * width : (index + 1) * width]
