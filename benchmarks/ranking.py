# SPDX-License-Identifier: Apache-2.0
"""How long it takes to rank many bids, beside plain Python in the same run; prints a table."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from bt_agents.scene import Origin, Scene, SceneParameter, SceneSpace, SceneValue
from marketplace_node.auction import Auction
from marketplace_node.bid_table import BidColumns, BidTable
from marketplace_node.contest import Contest
from marketplace_node.decision import Bids, ClosedBy, Decision, Terms
from marketplace_node.registry import HostEntry
from marketplace_node.strategies import STRATEGIES, chance
from marketplace_node.strategies.field import Floats, Integers

SIZES = ((10, 3), (100, 8), (1_000, 16), (10_000, 64))
REPEAT = 15
HIGHEST = 10.0
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene and bids of chance.

    Attributes:
        space: Its parameters.
        terms: Of the round.
        table: The bids.
    """

    space: SceneSpace
    terms: Terms
    table: BidTable


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Times [s], the fastest of several.

    Attributes:
        ranking: From the bids to their order, vectorised.
        plain: The same in plain Python.
        taking: Checking one host's answer with all bids.
        closing: The whole decision with its records and the smallest change of the scene.
        equal: Whether both have the same distances, bit for bit, and the same order.
    """

    ranking: float
    plain: float
    taking: float
    closing: float
    equal: bool


def case(agents: int, parameters: int) -> Case:
    """Return so many agents with so many parameters; every tenth bid is like the one before."""
    random = chance(f"{agents} agents, {parameters} parameters")
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
    names = [f"agent_{index:05d}" for index in range(agents)]
    columns = BidColumns(space)
    columns.add(names, range(1, agents + 1), "/agents", "first", vectors, None)
    return Case(
        space=space,
        terms=Terms(
            epoch="epoch", round=1, follows=0, scene=scene, strategy="manhattan",
            tie_break="least_recently_run",
            last_run={name: index % 7 for index, name in enumerate(names)}, rounds_run=7,
        ),
        table=columns.table(),
    )  # fmt: skip


def ranked(of: Case) -> tuple[Floats, Integers]:
    """Return distances and order, as the market finds them."""
    contest = Contest(
        terms=of.terms,
        table=of.table,
        field=of.table.field(of.space, of.terms),
        spec=STRATEGIES["manhattan"],
        options={},
        seed="",
    )
    scores = contest.measure().scores
    return scores.distance, contest.order(scores.score)


def ranked_plainly(vectors: Sequence[Sequence[float]], of: Case) -> tuple[list[float], list[int]]:
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


def measured(of: Case, repeat: int = REPEAT) -> Measured:
    """Return how long each way takes."""
    agents, vectors = of.table.agents, of.table.vectors.tolist()
    answer = Bids(
        epoch="epoch", round=1, host="/agents", instance="first", agents=agents,
        agent_ids=of.table.agent_ids, vectors=of.table.vectors.ravel(order="C"),
    )  # fmt: skip
    entry = HostEntry(
        host="/agents", instance="first", run_action="/agents/run", heartbeat="/agents/heartbeat",
        agents=dict(zip(agents, of.table.agent_ids, strict=True)),
    )  # fmt: skip

    def take() -> Auction:
        auction = Auction(of.space, of.terms, [entry])
        auction.take(answer)
        return auction

    taking, auction = fastest(take, repeat)
    ranking, (distances, order) = fastest(lambda: ranked(of), repeat)
    plain, expected = fastest(lambda: ranked_plainly(vectors, of), max(1, repeat // 5))

    def close() -> Decision:
        decision = auction.close(ClosedBy.ALL_ANSWERED, 0.1)
        assert decision.change is not None  # what is looked for when it is asked for
        return decision

    closing, decision = fastest(close, repeat // 5)
    same = [bid.agent for bid in decision.ranking] == [agents[index] for index in expected[1]]
    return Measured(
        ranking=ranking, plain=plain, taking=taking, closing=closing,
        equal=(distances.tolist(), order.tolist()) == expected and same,
    )  # fmt: skip


def fastest(call: Callable[[], T], repeat: int) -> tuple[float, T]:
    """Return the shortest time of a call [s], and what it gives."""
    times = []
    for _ in range(max(1, repeat)):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
    return min(times), result


def main() -> None:
    """Measure and print every size."""
    print(f"numpy {np.__version__}; milliseconds, the fastest of {REPEAT}")
    print(f"{'agents x parameters':22}{'rank':>9}{'plain':>9}{'ratio':>8}{'take':>9}{'close':>9}")
    for agents, parameters in SIZES:
        times = measured(case(agents, parameters))
        if not times.equal:
            raise SystemExit(f"{agents} x {parameters}: not the order of the plain sum")
        print(
            f"{f'{agents:,} x {parameters}':22}{times.ranking * 1e3:9.2f}{times.plain * 1e3:9.2f}"
            f"{times.plain / times.ranking:8.1f}{times.taking * 1e3:9.2f}"
            f"{times.closing * 1e3:9.2f}"
        )


if __name__ == "__main__":
    main()
