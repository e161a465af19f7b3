# SPDX-License-Identifier: Apache-2.0
"""Measures how long the market takes to rank bids."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.round.auction import Auction
from marketplace_node.round.decision import AcceptedBid, Bids, ClosedBy, Terms
from marketplace_node.strategies import round_rng
from measuring import ROUND_LIMIT_S, Effort, Row, in_turn, timed

HIGHEST = 10.0
PARAMETERS = 3
CLOSED = (3, 1_000)
DECISIONS_A_TURN = 2_000
"""Approximate number of bids in each measurement."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A random scene and random bids.

    Attributes:
        space: Scene parameters.
        terms: Terms of the round.
        bids: Bids in the order of the agents' names.
    """

    space: SceneSpace
    terms: Terms
    bids: tuple[AcceptedBid, ...]


def measure(effort: Effort) -> Iterator[Row]:
    """Compare whole decisions with the limit."""
    for agents in CLOSED:
        yield _decision(agents, effort)


def case(agents: int, parameters: int) -> Case:
    """Return a case with agents and parameters; every tenth bid equals the one before."""
    random = round_rng(f"{agents} agents, {parameters} parameters")
    vectors = HIGHEST * random.random((agents, parameters))
    vectors[10::10] = vectors[9:-1:10]
    space = SceneSpace(
        parameters=tuple(
            SceneParameter(name=f"p{index}", minimum=0.0, maximum=HIGHEST, default=5.0)
            for index in range(parameters)
        )
    )
    scene = Scene(
        scene_id="scene",
        label="",
        person=True,
        values=tuple(
            SceneValue(name=name, value=float(value), origin=Origin.GIVEN)
            for name, value in zip(
                space.names, HIGHEST * random.random((parameters,)), strict=True
            )
        ),
    )
    names = [f"agent_{index:06d}" for index in range(agents)]
    return Case(
        space=space,
        terms=Terms(
            epoch="epoch", round=1, follows=0, scene=scene, strategy="manhattan",
            tie_break="least_recently_run",
            last_run={name: index % 7 for index, name in enumerate(names)}, rounds_run=7,
        ),
        bids=tuple(
            AcceptedBid(
                agent=name, agent_id=number, host="/agents", instance="first", vector=tuple(vector)
            )
            for number, (name, vector) in enumerate(zip(names, vectors.tolist(), strict=True), 1)
        ),
    )  # fmt: skip


def _decision(agents: int, effort: Effort) -> Row:
    """Compare a round, from a host's answer to the decision, with the limit."""
    of = case(agents, PARAMETERS)
    names, ids = tuple(bid.agent for bid in of.bids), tuple(bid.agent_id for bid in of.bids)
    answer = Bids(
        epoch="epoch", round=1, host="/agents", instance="first", agents=names, agent_ids=ids,
        vectors=[value for bid in of.bids for value in bid.vector],
    )  # fmt: skip
    entry = HostEntry(
        host="/agents", instance="first", run_action="/agents/run", heartbeat="/agents/heartbeat",
        agents=dict(zip(names, ids, strict=True)),
    )  # fmt: skip

    def round_of() -> None:
        auction = Auction(of.space, of.terms, [entry])
        auction.take(answer)
        decision = auction.close(ClosedBy.ALL_ANSWERED, 0.1)
        if decision.winner is None or len(decision.ranking) != agents:
            raise RuntimeError("a round without a winner, or with bids that were lost")

    number = effort.times(max(1, DECISIONS_A_TURN // agents))
    found = in_turn({"": timed(round_of, number)}, effort)[""]
    return Row.within(ROUND_LIMIT_S, case=f"bids to decision, {agents:,} agents", values=found)
