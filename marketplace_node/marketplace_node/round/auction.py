# SPDX-License-Identifier: Apache-2.0
"""Auction of one round: checks the bids of the asked hosts and decides exactly one outcome."""

from __future__ import annotations

import math
from collections.abc import Iterable

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import MAX_WEIGHT, SceneSpace
from marketplace_node.formatting import shown
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import (
    AcceptedBid,
    Bids,
    ClosedBy,
    Decision,
    External,
    Ranked,
    RankedBid,
    RefusedBid,
    RoundKind,
    Terms,
)
from marketplace_node.round.ranking import decide, nearest


class Auction:
    """Bids of one open round, checked on arrival; ``asked`` are the hosts that may answer."""

    def __init__(self, space: SceneSpace, terms: Terms, asked: Iterable[HostEntry]) -> None:
        self.terms = terms
        self._space = space
        self._asked = {entry.host: entry for entry in asked}
        self._answered: set[str] = set()
        self._accepted: list[AcceptedBid] = []
        self._excluded_by_operators = frozenset(
            refused.agent for refused in terms.operator_exclusions
        )
        self._may_be_silent = self._excluded_by_operators | terms.excluded.keys()
        self._refused = list(terms.operator_exclusions)

    @property
    def complete(self) -> bool:
        """True when every asked host has answered."""
        return len(self._answered) == len(self._asked)

    @property
    def accepted(self) -> tuple[RankedBid, ...]:
        """The bids accepted so far, by Manhattan distance."""
        return nearest(self._space, self.terms, self._accepted)

    def take(self, bids: Bids) -> None:
        """Take one message; errors in it are recorded, never raised."""
        try:
            entry = self._sender(bids)
            self._answered.add(entry.host)
            self._check_lengths(bids)
        except Refused as refused:
            self._refuse(bids, bids.agents[0] if len(bids.agents) == 1 else "", refused)
            return
        named: set[str] = set()
        for row, agent in enumerate(bids.agents):
            if agent in self._excluded_by_operators:
                continue
            try:
                self._check_agent(agent, entry, named)
                self._accepted.append(self._checked(bids, row, entry))
            except Refused as refused:
                self._refuse(bids, agent, refused)
            named.add(agent)
        unmet_of = bids.unmet or ("",) * len(bids.declined)
        declined = zip(bids.declined, bids.decline_reasons, unmet_of, strict=True)
        for agent, reason, unmet in declined:
            if agent in self._excluded_by_operators:
                continue
            try:
                self._check_agent(agent, entry, named)
                reason = reason or "gives no reason"
                self._record(bids, agent, RoundKind.DECLINED, RefusalCode.DECLINED, reason, unmet)
            except Refused as refused:
                self._refuse(bids, agent, refused)
            named.add(agent)
        if not entry.agents.keys() <= named:
            reason = f"{entry.host} says nothing about it"
            for agent in entry.agents:
                if agent not in named and agent not in self._may_be_silent:
                    self._record(bids, agent, RoundKind.REFUSED, RefusalCode.NO_ANSWER, reason)

    def close(
        self,
        by: ClosedBy,
        duration_s: float,
        *,
        stopped: str = "",
        external: External | None = None,
    ) -> Decision:
        """Rank the accepted bids and return the decision.

        Args:
            by: What closes the round.
            duration_s: From the call to now [s].
            stopped: Why the round is stopped; only with ``ClosedBy.STOPPED``.
            external: As in :func:`decide`.
        """
        try:
            ranked = decide(self._space, self.terms, self._accepted, external=external)
        except Exception as error:
            # A round must close even if a third-party strategy fails.
            reason = shown(str(error))
            stopped = f"the bids could not be ranked: {type(error).__name__}: {reason}"
            ranked, by = Ranked(), ClosedBy.STOPPED
        awarded = bool(ranked.bids) and by is not ClosedBy.STOPPED
        return Decision(
            terms=self.terms,
            outcome=AuctionOutcome.AWARDED if awarded else AuctionOutcome.NO_BIDS,
            closed_by=by,
            duration_s=duration_s,
            ranked=ranked,
            refused=tuple(self._refused),
            silent_hosts=tuple(h for h in self._asked if h not in self._answered),
            stopped=stopped,
        )

    def _sender(self, bids: Bids) -> HostEntry:
        check_round(bids, self.terms.epoch, self.terms.round)
        entry = self._asked.get(bids.host)
        if entry is None:
            raise Refused(
                RefusalCode.UNREGISTERED,
                f"'{bids.host}' was not asked in round {self.terms.round}; a host registers first",
            )
        if bids.instance != entry.instance:
            raise Refused(
                RefusalCode.WRONG_INSTANCE,
                f"{bids.host} answers as instance '{bids.instance}', "
                f"'{entry.instance}' was asked; register after every start",
            )
        entry.check_token(bids.token)
        if bids.host in self._answered:
            raise Refused(
                RefusalCode.DUPLICATE, f"{bids.host} has answered already; the first answer counts"
            )
        return entry

    def _check_lengths(self, bids: Bids) -> None:
        agents, width = len(bids.agents), len(self._space)
        if len(bids.agent_ids) != agents or len(bids.vectors) != agents * width:
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{agents} agents with {len(bids.agent_ids)} ids and {len(bids.vectors)} values, "
                f"expected {agents} ids and {agents * width} values: "
                f"{', '.join(self._space.names)} of each agent",
            )
        if len(bids.weights) not in (0, agents * width):
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{agents} agents with {len(bids.weights)} weights, expected none or "
                f"{agents * width}: one of each parameter for each agent",
            )
        if len(bids.declined) != len(bids.decline_reasons):
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{len(bids.declined)} agents decline with {len(bids.decline_reasons)} reasons, "
                "expected one reason each",
            )
        if len(bids.unmet) not in (0, len(bids.declined)):
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{len(bids.declined)} agents decline with {len(bids.unmet)} requirements that "
                "are not met, expected none or one each",
            )

    def _check_agent(self, agent: str, entry: HostEntry, named: set[str]) -> None:
        if agent not in entry.agents:
            raise Refused(
                RefusalCode.UNKNOWN_AGENT,
                f"{entry.host} has no registered agent '{agent}'; register after every change",
            )
        if agent in named:
            raise Refused(RefusalCode.DUPLICATE, f"'{agent}' is named twice; the first one counts")

    def _checked(self, bids: Bids, row: int, entry: HostEntry) -> AcceptedBid:
        """Return the bid in one row of an answer of the right lengths.

        Raises:
            Refused: ``EXCLUDED``, ``WRONG_ID``, ``OUT_OF_RANGE``, or as in
                :meth:`SceneSpace.vector`.
        """
        agent, agent_id, width = bids.agents[row], bids.agent_ids[row], len(self._space)
        if agent in self.terms.excluded:
            raise Refused(
                RefusalCode.EXCLUDED, f"'{agent}' may not bid: {self.terms.excluded[agent]}"
            )
        if agent_id != entry.agents[agent]:
            raise Refused(
                RefusalCode.WRONG_ID,
                f"'{agent}' bids with id {agent_id}, expected {entry.agents[agent]}",
            )
        cells = slice(row * width, (row + 1) * width)
        vector = self._space.vector(bids.vectors[cells], what=f"bid of {agent}")
        weights = tuple(map(float, bids.weights[cells]))
        for name, weight in zip(self._space.names, weights, strict=False):
            if not (math.isfinite(weight) and 0.0 <= weight <= MAX_WEIGHT):
                raise Refused(
                    RefusalCode.OUT_OF_RANGE,
                    f"bid of {agent}: the weight of {name} is {weight:g}, expected 0 to "
                    f"{MAX_WEIGHT:g}",
                )
        return AcceptedBid(
            agent=agent,
            agent_id=agent_id,
            host=entry.host,
            instance=entry.instance,
            vector=vector,
            weights=weights,
        )

    def _refuse(self, bids: Bids, agent: str, refused: Refused) -> None:
        self._record(bids, agent, RoundKind.REFUSED, refused.code, refused.reason)

    def _record(
        self, bids: Bids, agent: str, kind: RoundKind, code: str, reason: str, unmet: str = ""
    ) -> None:
        self._refused.append(
            RefusedBid(
                agent=agent, host=bids.host, kind=kind, code=code, reason=reason, unmet=unmet
            )
        )


def check_round(bids: Bids, epoch: str, current: int) -> None:
    """Check that bids belong to the current round of this market.

    Raises:
        Refused: ``FOREIGN_EPOCH`` or ``FOREIGN_ROUND``.
    """
    if bids.epoch != epoch:
        raise Refused(
            RefusalCode.FOREIGN_EPOCH, f"bids for the market '{bids.epoch}', this one is '{epoch}'"
        )
    if bids.round != current:
        raise Refused(
            RefusalCode.FOREIGN_ROUND, f"bids for round {bids.round}, the current one is {current}"
        )
