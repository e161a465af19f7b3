# SPDX-License-Identifier: Apache-2.0
"""How long it takes to rank bids, beside plain Python."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from bt_agents_core.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.round.auction import Auction
from marketplace_node.round.bid_table import BidTable
from marketplace_node.round.decision import AcceptedBid, Bids, ClosedBy, Terms
from marketplace_node.round.ranking import decide
from marketplace_node.round.round_model import RoundModel
from marketplace_node.strategies import STRATEGIES, round_rng
from marketplace_node.strategies.arrays import Floats, Integers
from measuring import ROUND_LIMIT_S, Effort, Row, in_turn, timed

HIGHEST = 10.0
PARAMETERS = 3
SORTED = ((10, 3), (100, 8), (1_000, 16), (10_000, 64))
CLOSED = (3, 1_000)
NUMBERS_A_TURN = 600_000
"""About so many numbers are compared in each measurement."""

OURS = "bt-agents"
PLAIN = "plain Python"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene and bids of chance.

    Attributes:
        space: Its parameters.
        terms: Of the round.
        bids: In the order of their agents' names.
    """

    space: SceneSpace
    terms: Terms
    bids: tuple[AcceptedBid, ...]

    @cached_property
    def table(self) -> BidTable:
        """The bids as arrays."""
        return BidTable.of(self.bids, self.space)


def measure(effort: Effort) -> Iterator[Row]:
    """Compare the whole order, then a whole decision.

    Raises:
        RuntimeError: Somebody else wins than in plain Python, or distances differ in a digit.
    """
    for agents, parameters in SORTED[:-1] if effort.is_short else SORTED:
        if not equals_plain(case(agents, parameters)):
            raise RuntimeError(f"{agents} x {parameters}: not the order of the plain sum")
    for agents, parameters in SORTED[1:]:
        yield _order(agents, parameters, effort)
    for agents in CLOSED:
        yield _decision(agents, effort)


def case(agents: int, parameters: int) -> Case:
    """Return so many agents with so many parameters; every tenth bid is like the one before."""
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


def equals_plain(of: Case) -> bool:
    """Return whether distances are those of plain Python, bit for bit, and the order too."""
    distances, order = _ranked(of)
    expected = _ranked_plainly(of.table.vectors.tolist(), of)
    agents = [of.table.agents[index] for index in expected[1]]
    ranked = decide(of.space, of.terms, of.bids).bids
    return (
        (distances.tolist(), order.tolist()) == expected
        and [bid.agent for bid in ranked] == agents
        and [bid.distance for bid in ranked] == [expected[0][index] for index in expected[1]]
    )


def _order(agents: int, parameters: int, effort: Effort) -> Row:
    of = case(agents, parameters)
    rows = of.table.vectors.tolist()
    number = _number(agents * parameters * 20, effort)
    found = in_turn(
        {
            OURS: timed(lambda: _ranked(of), number),
            PLAIN: timed(lambda: _ranked_plainly(rows, of), max(1, number // 5)),
        },
        effort,
    )
    return Row(
        case=f"order of {agents:,} agents, {parameters} parameters",
        side=OURS,
        values=found[OURS],
        floor=PLAIN,
        floor_values=found[PLAIN],
    )


def _decision(agents: int, effort: Effort) -> Row:
    """Compare a round, from the answer of its host to its decision, with the limit."""
    of = case(agents, PARAMETERS)
    names, ids = of.table.agents, of.table.agent_ids
    answer = Bids(
        epoch="epoch", round=1, host="/agents", instance="first", agents=names, agent_ids=ids,
        vectors=of.table.vectors.ravel(order="C"),
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

    number = max(1, _number(agents * PARAMETERS * 100, effort))
    found = in_turn({OURS: timed(round_of, number)}, effort)[OURS]
    return Row.within(
        ROUND_LIMIT_S, case=f"bids to decision, {agents:,} agents", side=OURS, values=found
    )


def _number(numbers: int, effort: Effort) -> int:
    return effort.times(max(5, NUMBERS_A_TURN // numbers))


def _ranked(of: Case) -> tuple[Floats, Integers]:
    """Return distances and order, as the market finds them for its record."""
    model = RoundModel(
        terms=of.terms,
        table=of.table,
        field=of.table.field(of.space, of.terms),
        spec=STRATEGIES["manhattan"],
        options={},
        seed="",
    )
    scores = model.score().scores
    return scores.distance, model.order(scores.score)


def _ranked_plainly(vectors: Sequence[Sequence[float]], of: Case) -> tuple[list[float], list[int]]:
    """Return the same from loops over numbers."""
    scene, names, last_run = of.terms.scene.vector, of.table.agents, of.terms.last_run
    distances = []
    for vector in vectors:
        distance = 0.0
        for offered, wanted in zip(vector, scene, strict=True):
            distance += abs(offered - wanted)
        distances.append(distance)
    order = sorted(range(len(names)), key=lambda i: (distances[i], last_run[names[i]], names[i]))
    return distances, order
