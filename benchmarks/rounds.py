# SPDX-License-Identifier: Apache-2.0
"""Measures the time from scene to first tick, and bidding of many or silent agents and hosts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from rclpy.action import ActionClient

from bare import EVENTS, LATCHED, SERVICES
from bare_round import NAMES, WANTED, call_for_bids, scene
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import (
    Bids,
    CallForBids,
    Heartbeat,
    MarketStatus,
    SceneEnd,
    TreeStatus,
)
from bt_agents_interfaces.srv import Analyze, CollectFeedback, PreviewAuction, RegisterHost
from bt_agents_ros.messages import seconds
from bt_agents_tools.launcher import components
from measuring import COLD, HOT, PAUSE_S, ROUND_LIMIT_S, Effort, Row, Way, in_turn, median_of
from processes import Graph, graphs, write_trees

TREE = "{check: scene.age >= 1}"
"""It ends with its first tick."""

SETTLE_S = 0.5
"""Time after which all earlier messages have arrived [s]."""

DEADLINE_S = 0.5
"""Time from a call for bids to the end of the round, even if a host is silent [s]."""

ANALYZE = Analyze.Request(
    names=list(NAMES), values=list(WANTED), person=Analyze.Request.PRESENT, announce=True
)

NUMBER = {HOT: 110, COLD: 40}
"""Measurements per repetition; in total more than 1,000 rounds without a lost bid."""

HOPS = (
    "five hops (request, scene, call, bids, goal) and a start beside four; bare nodes that do the "
    "same have the same five"
)

Once = Callable[[], float]
"""Does something once; returns how long it took [s]."""


class System:
    """A market and hosts, as started by ``bt-agents up``.

    Args:
        graph: Graph in which to start them.
        hosts: Number of agents of each host.
        layer: Whether to start a scene layer, too.
        deadline_s: Deadline of a round [s]; long, so that no round reaches it.
    """

    def __init__(
        self, graph: Graph, hosts: Sequence[int], *, layer: bool = False, deadline_s: float = 10.0
    ) -> None:
        self.graph = graph
        self.agents = sum(hosts)
        self._calls: list[Any] = []
        self._ticks: list[Any] = []
        self._ends: list[Any] = []
        self._market: list[Any] = []
        self._previews = 0
        trees = []
        for index, count in enumerate(hosts):
            names = (f"agent_{index}_{number:05d}" for number in range(count))
            trees.append(write_trees(graph.folder / str(index), dict.fromkeys(names, TREE)))
        market = components.market(trees[0])
        parameters = {**market.parameters, "bid_deadline": deadline_s, "host_lease": 5.0}
        graph.start(replace(market, parameters=parameters))
        if layer:
            graph.start(components.scene_layer(trees[0]))
        for index, folder in enumerate(trees):
            graph.start(components.host(folder), f"agents{index}")
        probe = graph.probe
        probe.create_service(
            CollectFeedback,
            "feedback/collect",
            lambda _request, response: response,
            qos_profile=EVENTS,
        )
        self._heard = [
            probe.create_subscription(kind, topic, take, quality)
            for kind, topic, take, quality in (
                (CallForBids, "bt_agents/calls", self._calls.append, EVENTS),
                (TreeStatus, "agents0/status", self._ticks.append, EVENTS),
                (MarketStatus, "bt_agents/market", self._market.append, LATCHED),
                (SceneEnd, "bt_agents/scene_ends", self._take_end, LATCHED),
            )
        ]
        self._analyze = probe.create_client(Analyze, "scene_layer/analyze", qos_profile=EVENTS)
        self._preview = probe.create_client(
            PreviewAuction, "marketplace/preview", qos_profile=EVENTS
        )

    def _take_end(self, end: Any) -> None:
        # The first scene may be sent twice, if the market is still starting.
        if end.code != "DUPLICATE":
            self._ends.append(end)

    def until_ready(self) -> None:
        """Wait until all agents are registered."""
        self.graph.until_up()
        self.graph.until(
            lambda: self._market and self._market[-1].agents == self.agents,
            f"{self.agents} agents are registered",
        )
        self.graph.until_matched(self._preview, *self._heard)
        # A newly registered host is still busy introducing its agents.
        self.graph.until(
            lambda: len(self.auction().ranking) == self.agents, "all agents bid in time"
        )

    def first_tick(self) -> float:
        """Request a scene; return the time to the first tick [s], once the scene has ended."""
        for seen in (self._ticks, self._ends):
            seen.clear()
        self.graph.until_matched(self._analyze)
        began = time.time()
        answer = self._analyze.call_async(ANALYZE)
        self.graph.until(
            lambda: answer.done() and self._ends and self._ticks, "a tree runs for the scene"
        )
        assert self._ends[0].code == "SUCCEEDED", self._ends
        return seconds(self._ticks[0].header.stamp) - began

    def auction(self) -> Any:
        """Hold a round without a run; return its outcome, which includes all bids."""
        self._calls.clear()
        self._previews += 1
        request = PreviewAuction.Request(scene=scene(str(self._previews)))
        answer = self._preview.call_async(request)
        self.graph.until(lambda: answer.done() and self._calls, "an answer to a preview")
        assert answer.result().accepted, answer.result().message
        return answer.result().auction

    def bidding(self) -> float:
        """Hold a round; return the time from the call for bids to the outcome [s]."""
        auction = self.auction()
        assert len(auction.ranking) == self.agents, (len(auction.ranking), auction.reason)
        return seconds(auction.header.stamp) - seconds(self._calls[0].header.stamp)


class Bare:
    """Bare programs, each of which does a part of a round.

    Args:
        graph: Graph in which to start them.
        parts: Names of the parts.
    """

    def __init__(self, graph: Graph, *parts: str) -> None:
        self.graph = graph
        self._ticks: list[Any] = []
        self._bids: list[Any] = []
        self._scenes = 0
        for part in parts:
            graph.bare("bare_round.py", part)
        probe = graph.probe
        self._calls = probe.create_publisher(CallForBids, "bt_agents/calls", EVENTS)
        probe.create_subscription(TreeStatus, "agents/status", self._ticks.append, EVENTS)
        self._hears_bids = probe.create_subscription(
            Bids, "bt_agents/bids", self._bids.append, EVENTS
        )
        self._analyze = probe.create_client(Analyze, "scene_layer/analyze", qos_profile=EVENTS)
        self._runs = ActionClient(
            probe, RunAgent, "agents/run", feedback_sub_qos_profile=EVENTS, **SERVICES
        )

    def until_ready(self) -> None:
        """Wait for a complete round; at first, messages are lost."""
        asked = 0.0

        def has_ticked() -> bool:
            nonlocal asked
            if time.monotonic() - asked > SETTLE_S and self._analyze.service_is_ready():
                asked = time.monotonic()
                self._analyze.call_async(ANALYZE)
            return bool(self._ticks)

        self.graph.until(has_ticked, "a first bare round")
        self.graph.rest(SETTLE_S)

    def request_and_goal(self) -> float:
        """Return the time of a service call, and of the acceptance of a goal [s]."""
        self.graph.until_matched(self._analyze, self._runs)
        began = time.perf_counter()
        answer = self._analyze.call_async(ANALYZE)
        self.graph.until(answer.done, "an answer of a bare service")
        accepted = self._runs.send_goal_async(
            RunAgent.Goal(round=1, agent="agent", agent_id=1, scene=answer.result().scene)
        )
        self.graph.until(accepted.done, "a bare goal is accepted")
        took = time.perf_counter() - began
        result = accepted.result().get_result_async()
        self.graph.until(result.done, "a bare goal is over")
        return took

    def first_tick(self) -> float:
        """Return the time from a request for a scene to the first status of a run [s]."""
        self._ticks.clear()
        self.graph.until_matched(self._analyze)
        began = time.time()
        answer = self._analyze.call_async(ANALYZE)
        self.graph.until(lambda: answer.done() and self._ticks, "a bare round")
        return seconds(self._ticks[0].header.stamp) - began

    def round_trip(self) -> float:
        """Return the time from a call for bids to the bids of a host, both sent by topics [s]."""
        self._bids.clear()
        self._scenes += 1
        self.graph.until_matched(self._calls, count=2)
        self.graph.until_matched(self._hears_bids)
        began = time.perf_counter()
        self._calls.publish(call_for_bids(self._scenes, scene("scene")))
        self.graph.until(lambda: self._bids, "bids of a bare host")
        return time.perf_counter() - began


class SilentHost:
    """A host of one agent in this process, alive but silent.

    Args:
        graph: Graph of a ready system.
    """

    def __init__(self, graph: Graph) -> None:
        self._heartbeat = Heartbeat(host="/silent", host_instance="first")
        self._beats = graph.probe.create_publisher(Heartbeat, "/silent/heartbeat", EVENTS)
        graph.probe.create_publisher(Bids, "bt_agents/bids", EVENTS)
        graph.probe.create_timer(0.1, self._beat)
        register = graph.probe.create_client(
            RegisterHost, "marketplace/register", qos_profile=EVENTS
        )
        graph.until_matched(register)
        answer = register.call_async(
            RegisterHost.Request(
                host="/silent",
                host_instance="first",
                run_action="/silent/run",
                heartbeat="/silent/heartbeat",
                parameters=["age", "familiarity", "mood"],
                agents=["silent"],
            )
        )
        graph.until(answer.done, "the silent host is registered")
        assert answer.result().accepted, answer.result().message
        self._heartbeat.token = answer.result().token

    def _beat(self) -> None:
        self._beats.publish(self._heartbeat)


def measure(effort: Effort) -> Iterator[Row]:
    """Yield the figures of all parts."""
    yield from first_ticks(effort)
    yield from many_agents(effort)
    yield from many_hosts(effort)
    yield from dead_agent(effort)


def first_ticks(effort: Effort) -> Iterator[Row]:
    """Compare scene to first tick with a bare request and goal, and with a bare round."""
    sizes = (3,) if effort.is_short else (3, 10, 100)
    with graphs() as make:
        systems = {size: System(make("system"), [size], layer=True) for size in sizes}
        bare = Bare(make("bare"), "service", "host")
        chain = Bare(make("chain"), "service", "market", "host")
        for one in (*systems.values(), chain):
            one.until_ready()
        for pace in NUMBER:
            ways = {
                f"{size} agents": _paced(one.first_tick, one.graph, pace, effort, 0.5)
                for size, one in systems.items()
            }
            ways["floor"] = _paced(bare.request_and_goal, bare.graph, pace, effort, 0.5)
            ways["chain"] = _paced(chain.first_tick, chain.graph, pace, effort, 0.5)
            found = in_turn(ways, effort)
            for size in sizes:
                yield Row(
                    case=f"request → first tick, {size} agents in a host",
                    values=found[f"{size} agents"],
                    floor="request + goal accepted",
                    floor_values=found["floor"],
                    goal=1.3,
                    pace=pace,
                    note=HOPS,
                )
            yield Row(
                case=f"request → first tick, {sizes[0]} agents in a host",
                values=found[f"{sizes[0]} agents"],
                floor="bare nodes, same job",
                floor_values=found["chain"],
                pace=pace,
            )


def many_agents(effort: Effort) -> Iterator[Row]:
    """Compare a round with many agents in a host with the limit."""
    agents = 100 if effort.is_short else 1_000
    with graphs() as make:
        one = System(make(f"agents-{agents}"), [agents])
        one.until_ready()
        for pace in NUMBER:
            found = in_turn({"": _paced(one.bidding, one.graph, pace, effort)}, effort)[""]
            yield Row.within(
                ROUND_LIMIT_S,
                case=f"call → outcome, {agents:,} agents in a host",
                values=found,
                pace=pace,
            )


def many_hosts(effort: Effort) -> Iterator[Row]:
    """Compare rounds of several hosts, one process each, with one message there and back."""
    counts = (2,) if effort.is_short else (1, 3, 10)
    goals = {3: 2.5, 10: 7.0}
    with graphs() as make:
        systems = {count: System(make(f"hosts-{count}"), [3] * count) for count in counts}
        bare = Bare(make("bare"), "host", "listener")
        for one in systems.values():
            one.until_ready()
        for pace in NUMBER:
            ways = {
                str(count): _paced(one.bidding, one.graph, pace, effort)
                for count, one in systems.items()
            }
            ways["floor"] = _paced(bare.round_trip, bare.graph, pace, effort)
            found = in_turn(ways, effort)
            for count in counts:
                yield Row(
                    case=f"call → outcome, {count} hosts in {count} processes",
                    values=found[str(count)],
                    floor="topic there and back",
                    floor_values=found["floor"],
                    goal=goals.get(count),
                    pace=pace,
                )


def dead_agent(effort: Effort) -> Iterator[Row]:
    """Compare the length of rounds with one silent agent among many with their deadline."""
    agents = 10 if effort.is_short else 999
    with graphs() as make:
        one = System(make("deadline"), [agents], deadline_s=DEADLINE_S)
        one.until_ready()
        SilentHost(one.graph)
        lengths = []

        def worst() -> float:
            rounds = []
            for _ in range(effort.times(8)):
                auction = one.auction()
                assert len(auction.ranking) == agents, auction.reason
                assert list(auction.silent_hosts) == ["/silent"], auction.silent_hosts
                rounds.append(auction.duration_s)
            lengths.extend(rounds)
            return max(rounds)

        found = in_turn({"worst": worst}, effort)["worst"]
        assert min(lengths) >= DEADLINE_S, min(lengths)
        yield Row.within(
            DEADLINE_S,
            case=f"deadline with 1 silent agent of {agents + 1:,}",
            side="worst of 8",
            values=found,
            floor="bid_deadline",
            goal=1.004,
        )


def _paced(once: Once, graph: Graph, pace: str, effort: Effort, share: float = 1.0) -> Way:
    """Return a way that takes the median of many calls, back to back or with rests between.

    Args:
        once: Call to measure.
        graph: Graph that is spun during the rests.
        pace: Back to back or not.
        effort: How much to measure.
        share: Fraction of the usual number.
    """

    def paced() -> float:
        if pace == COLD:
            graph.rest(PAUSE_S)
        return once()

    return median_of(paced, effort.times(round(NUMBER[pace] * share)))
