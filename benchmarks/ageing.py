# SPDX-License-Identifier: Apache-2.0
"""Measures whether late goals and late rounds are as fast as the first."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from bare import EVENTS, LATCHED
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import MarketStatus, SceneEnd
from bt_agents_interfaces.srv import Analyze
from bt_agents_tools.launcher import components
from measuring import COLD, HOT, PAUSE_S, Effort, Row
from processes import Graph, Running, graphs, write_trees
from rounds import ANALYZE, TREE
from run_probes import Market

GOALS = 900
ROUNDS = 10_000
EARLY = 100
"""Number of rounds and goals that count as the first ones."""

AGENTS = ("first", "second", "third")
FEEDBACK = """\
format: 1
rounds: 1
seed: 1
scenes: [{age: 3, familiarity: 3, mood: 3}]
feedback:
  sequence: [{age: 4.5, familiarity: 3, mood: 3}, {age: 1.5, familiarity: 3, mood: 3}]
  repeat: true
"""
"""Each round moves a profile."""

LEASE_S = 5.0
"""Longest delay of a host by other work of this machine [s]."""

_REST_S = 0.5
_PARTS = 7
"""The first and the last ones are split into this many parts."""


def measure(effort: Effort) -> Iterator[Row]:
    """Yield comparisons of late and early times and memory."""
    yield from _goals(effort)
    yield from _rounds(effort)


# Goals


class Client:
    """Sends goals to a host as the market does: with the services of the host's action.

    Args:
        graph: Graph of the host.
        market: Market at which the host is registered.
        host: Name of the host's node.
    """

    def __init__(self, graph: Graph, market: Market, host: str) -> None:
        self._graph = graph
        self._market = market
        self._host = f"/{host}"
        action = f"{host}/run/_action"
        self._goals = graph.probe.create_client(
            RunAgent.Impl.SendGoalService, f"{action}/send_goal", qos_profile=EVENTS
        )
        self._results = graph.probe.create_client(
            RunAgent.Impl.GetResultService, f"{action}/get_result", qos_profile=EVENTS
        )
        self._sent = 0
        graph.until(lambda: self._host in market.hosts, "the host is registered")
        graph.until_matched(self._goals, self._results)

    def run(self) -> float:
        """Run a tree to its end; return how long the host took to accept the goal [s]."""
        self._sent += 1
        request = RunAgent.Impl.SendGoalService.Request(
            goal=self._market.goal(self._host, AGENTS[0])
        )
        request.goal_id.uuid = list(self._sent.to_bytes(16, "big"))
        began = time.perf_counter()
        answer = self._goals.call_async(request)
        self._graph.until(answer.done, "the answer to a goal")
        took = time.perf_counter() - began
        assert answer.result().accepted
        result = self._results.call_async(
            RunAgent.Impl.GetResultService.Request(goal_id=request.goal_id)
        )
        self._graph.until(result.done, "the result of a goal")
        outcome = result.result().result.outcome
        assert outcome == RunAgent.Result.SUCCEEDED, result.result().result.message
        return took


def _goals(effort: Effort) -> Iterator[Row]:
    few, goals = effort.times(EARLY), effort.times(GOALS)
    with graphs() as make:
        graph = make("ageing-goals")
        trees = write_trees(graph.folder / "trees", dict.fromkeys(AGENTS, TREE))
        market = Market(graph)
        graph.start(components.host(trees))
        client = Client(graph, market, "agents")

        def some(pace: str, number: int) -> list[float]:
            took = []
            for _ in range(number):
                if pace == COLD:
                    graph.rest(PAUSE_S)
                took.append(client.run())
            return took

        some(HOT, few)  # the first goals load modules
        early = {pace: some(pace, few) for pace in (COLD, HOT)}
        some(HOT, goals - 3 * few)
        late = {pace: some(pace, few) for pace in (HOT, COLD)}
    for pace in (HOT, COLD):
        yield Row(
            case=f"acceptance after {goals} goals",
            side="after these",
            values=_parts(late[pace]),
            floor=f"after {few} goals",
            floor_values=_parts(early[pace]),
            goal=1.1,
            pace=pace,
            note=f"medians of each seventh of {few} goals; those before were all hot",
        )


def _parts(took: list[float]) -> list[float]:
    """Return the median of each of some equal parts [s]."""
    size = max(1, len(took) // _PARTS)
    parts = [took[start : start + size] for start in range(0, len(took) - size + 1, size)]
    return [statistics.median(part) for part in parts[:_PARTS]]


# Rounds


class Cycle:
    """A whole system without a robot that runs round after round.

    Args:
        graph: Graph in which to start it.
    """

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._ends: list[Any] = []
        self._market: list[Any] = []
        trees = write_trees(graph.folder / "trees", dict.fromkeys(AGENTS, TREE))
        market = components.market(trees)
        told = graph.folder / "feedback.yaml"
        told.write_text(FEEDBACK, encoding="utf-8")
        self.processes: dict[str, Running] = {
            component.name: graph.start(component)
            for component in (
                replace(market, parameters={**market.parameters, "host_lease": LEASE_S}),
                components.scene_layer(trees),
                components.feedback(trees, str(graph.folder / "ledger.db"), told),
                components.host(trees),
            )
        }
        probe = graph.probe
        probe.create_subscription(SceneEnd, "bt_agents/scene_ends", self._ends.append, LATCHED)
        probe.create_subscription(MarketStatus, "bt_agents/market", self._take_status, LATCHED)
        self._analyze = probe.create_client(Analyze, "scene_layer/analyze", qos_profile=EVENTS)
        graph.until_up()
        graph.until(
            lambda: self._market and self._market[-1].agents == len(AGENTS),
            "all agents are registered",
        )
        graph.until_matched(self._analyze)
        graph.rest(_REST_S)

    def _take_status(self, status: MarketStatus) -> None:
        self._market[:] = [status]

    def round(self) -> float:
        """Request a scene; return the time until everything that follows from it has ended [s]."""
        self._ends.clear()
        began = time.perf_counter()
        answer = self._analyze.call_async(ANALYZE)
        self._graph.until(lambda: answer.done() and self._ends, "the end of a scene")
        took = time.perf_counter() - began
        assert self._ends[0].code == "SUCCEEDED", self._ends
        return took

    def memory_mb(self) -> dict[str, float]:
        """Return the memory of each process [MB]."""
        return {name: one.resident_mb for name, one in self.processes.items()}


def _rounds(effort: Effort) -> Iterator[Row]:
    rounds, early = effort.times(ROUNDS), effort.times(EARLY)
    with graphs() as make:
        cycle = Cycle(make("ageing-rounds"))
        for _ in range(early):
            cycle.round()
        before = cycle.memory_mb()
        first = [cycle.round() for _ in range(early)]
        for _ in range(rounds - 3 * early):
            cycle.round()
        last = [cycle.round() for _ in range(early)]
        after = cycle.memory_mb()
    yield Row(
        case=f"round after {rounds:,} rounds",
        side="after these",
        values=_parts(last),
        floor=f"after {early} rounds",
        floor_values=_parts(first),
        goal=1.05,
        pace=HOT,
        note="from the scene until feedback has been kept and the scene is over",
    )
    for name in before:
        yield Row(
            case=f"memory after {rounds:,} rounds, {name}",
            side="after these",
            values=[after[name]],
            floor=f"after {early} rounds",
            floor_values=[before[name]],
            unit="MB",
            goal=1.05,
        )
