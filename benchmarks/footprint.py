# SPDX-License-Identifier: Apache-2.0
"""Measures the cost of an idle system: CPU, memory, and how fast a late process joins."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rclpy.node import Node

from bare import LATCHED
from bare_idle import qos
from bt_agents_interfaces.msg import HostCard
from bt_agents_ros.types import load_type
from bt_agents_tools.launcher import components as system
from bt_agents_tools.launcher.domain_lock import reserve_domain
from bt_agents_tools.launcher.supervisor import Component, set_discovery
from measuring import OURS, Effort, Row, Way, in_turn
from processes import HERE, Graph, Running, graphs, write_trees

AGENTS = 30
MANY = 1000

_IDLE_LIMIT = 2.2
"""CPU limit of all nodes in one process [% of a core]."""

_MEMORY_LIMIT_MIB = 90.0
"""Memory limit of the same process, including its share of shared memory [MiB]."""

_READY_LIMIT_S = 1.2
"""Longest time from the start of ``bt-agents up`` until the system is ready [s]."""

_WINDOW_S = 4.0
_LISTEN_S = 2.0
_MATCH_S = 0.5
_SETTLE_S = 1.0
_ECHO = [sys.executable, str(HERE / "bare_echo.py")]
_OWN = ("/rosout", "/parameter_events", "/clock")
BARE = "rclpy, same endpoints"
PLAIN = "Fast DDS as it is"
"""The settings of plain ROS."""

NODES_20 = """
  sequence:
""" + "".join(
    f"""\
    - name: step {step}
      timeout: 90 s
      selector:
        - sequence:
            - check: scene.age >= {step}
            - say: Step {step} of three.
        - say: Not with you.
"""
    for step in (1, 2, 3)
)
"""A sequence of three steps of six nodes each, and a last leaf."""
NODES_20 += "    - say: That is all."


def measure(effort: Effort) -> Iterator[Row]:
    """Yield each cost."""
    yield _idle(effort)
    yield from _one_process(effort)
    yield from _memory(effort)
    yield from _joining(effort)
    yield from _starting(effort)


def _system(graph: Graph) -> tuple[Path, tuple[Component, ...]]:
    """Return the trees folder and the nodes of a system without a robot."""
    trees = write_trees(
        graph.folder / "trees", {f"agent_{i:02d}": NODES_20 for i in range(AGENTS)}
    )
    parts = (
        system.market(trees),
        system.scene_layer(trees),
        system.feedback(trees, str(graph.folder / "ledger.db")),
        system.host(trees),
    )
    return trees, parts


def _start(graph: Graph, trees: Path, *components: Component) -> list[Running]:
    """Start processes, the last of them a host; return once all its agents are registered."""
    cards: list[Any] = []
    listening = graph.probe.create_subscription(HostCard, "bt_agents/cards", cards.append, LATCHED)
    running = [graph.start(component) for component in components]
    agents = len(list((trees / "agents").iterdir()))
    graph.until_up()
    graph.until(lambda: cards and len(cards[-1].agents) == agents, f"{agents} agents are in")
    graph.probe.destroy_subscription(listening)
    return running


# Idle


def layout_of(
    node: Node, names: Iterable[str], rest: Callable[[float], None], listen_s: float
) -> dict[str, Any]:
    """Return the endpoints and publishing rates of nodes for :mod:`bare_idle`.

    Args:
        node: Node in the same graph; subscribes to all their topics for a while.
        names: Names of the nodes.
        rest: Spins the node for a time [s].
        listen_s: How long to count messages [s].
    """
    layouts = {name: _endpoints(node, name) for name in names}
    publishers = [one for layout in layouts.values() for one in layout["publishers"]]
    sharing = Counter(topic for topic, _, _ in publishers)
    heard: Counter[str] = Counter()
    listening = [
        node.create_subscription(
            load_type(type_name),
            topic,
            lambda _, topic=topic: heard.update([topic]),
            qos(policies),
        )
        for topic, type_name, policies in {one[0]: one for one in publishers}.values()
    ]
    rest(_MATCH_S)  # latched messages come first
    heard.clear()
    rest(listen_s)
    for one in listening:
        node.destroy_subscription(one)
    for layout in layouts.values():
        layout["publishers"] = [
            [topic, type_name, policies, round(heard[topic] / sharing[topic] / listen_s)]
            for topic, type_name, policies in layout["publishers"]
        ]
    return layouts


def _endpoints(node: Node, name: str) -> dict[str, list[Any]]:
    publishers = node.get_publisher_names_and_types_by_node(name, "/")
    services = node.get_service_names_and_types_by_node(name, "/")
    clients = node.get_client_names_and_types_by_node(name, "/")
    subscriptions = node.get_subscriber_names_and_types_by_node(name, "/")

    def topics(found: Any, infos_of: Callable[[str], Any]) -> list[Any]:
        return [
            [topic, types[0], _policies(infos_of(topic), name)]
            for topic, types in found
            if topic not in _OWN and "/_action/" not in topic
        ]

    def actions(found: Any) -> list[Any]:
        return [
            [service.removesuffix("/_action/send_goal"), types[0].removesuffix("_SendGoal")]
            for service, types in found
            if service.endswith("/_action/send_goal")
        ]

    return {
        "publishers": topics(publishers, node.get_publishers_info_by_topic),
        "subscriptions": topics(subscriptions, node.get_subscriptions_info_by_topic),
        "services": [[s, t[0]] for s, t in services if not _is_common(s, t[0])],
        "clients": [[s, t[0]] for s, t in clients if "/_action/" not in s],
        "action_servers": actions(services),
        "action_clients": actions(clients),
    }


def _policies(infos: Any, name: str) -> list[int]:
    profile = next(info.qos_profile for info in infos if info.node_name == name)
    return [int(profile.reliability), int(profile.durability)]


def _is_common(service: str, type_name: str) -> bool:
    """Return whether a service belongs to an action, or to every rclpy node."""
    return "/_action/" in service or type_name.startswith("rcl_interfaces/srv/")


def _idle(effort: Effort) -> Row:
    with graphs() as make:
        ours, floor = make("idle"), make("idle-floor")
        trees, parts = _system(ours)
        running = _start(ours, trees, *parts)
        names = ["marketplace", "scene_layer", "feedback", "agents"]
        known = ours.probe.get_node_names
        ours.until(lambda: {*names} <= {*known()}, "all nodes are in the graph")
        ours.rest(_MATCH_S)  # the graph learns of their endpoints after the nodes
        layout = layout_of(ours.probe, names, ours.rest, 0.5 if effort.is_short else _LISTEN_S)
        beating = {name for name, one in layout.items() if any(p[3] for p in one["publishers"])}
        assert {"marketplace", "agents"} <= beating, layout
        file = floor.folder / "layout.json"
        file.write_text(json.dumps(layout), encoding="utf-8")
        bare = [floor.bare("bare_idle.py", file, name) for name in names]
        floor.until_up()
        window_s = 0.3 if effort.is_short else _WINDOW_S
        time.sleep(0.0 if effort.is_short else _SETTLE_S)
        sides = {OURS: running, BARE: bare}
        found: dict[str, list[float]] = {side: [] for side in sides}
        for _ in range(effort.repetitions):
            before = {side: _cpu_s(processes) for side, processes in sides.items()}
            time.sleep(window_s)
            for side, processes in sides.items():
                found[side].append(100 * ((_cpu_s(processes) - before[side]) / window_s))
        endpoints = sum(len(of) for one in layout.values() for of in one.values())
        rates = sum(publisher[3] for one in layout.values() for publisher in one["publishers"])
        case = f"idle, {AGENTS} agents, 4 processes"
        note = (
            f"both at the same time; the floor has the same nodes with the same {endpoints} "
            f"topics, services and actions, and publishes the same {rates} messages a second"
        )
        return Row.beside(found, OURS, BARE, case=case, unit="% of a core", goal=1.2, note=note)


def _one_process(effort: Effort) -> Iterator[Row]:
    """Yield the cost of all nodes in one process, and the limits for a small robot."""
    with graphs() as make:
        graph = make("together")
        trees, parts = _system(graph)
        (running,) = _start(graph, trees, system.one_process(parts))
        window_s = 0.3 if effort.is_short else _WINDOW_S
        time.sleep(0.0 if effort.is_short else _SETTLE_S)
        computed, memory = [], []
        for _ in range(effort.repetitions):
            before = running.cpu_s
            time.sleep(window_s)
            computed.append(100 * (running.cpu_s - before) / window_s)
            memory.append(running.proportional_mib)
        for what, values, unit, limit in (
            ("idle", computed, "% of a core", _IDLE_LIMIT),
            ("memory", memory, "MiB", _MEMORY_LIMIT_MIB),
        ):
            case = f"{what}, {AGENTS} agents, one process"
            yield Row.within(limit, case=case, values=values, unit=unit)


def _cpu_s(running: Iterable[Running]) -> float:
    """Return the CPU time of processes [s]."""
    return sum(one.cpu_s for one in running)


# Memory


def _memory(effort: Effort) -> Iterator[Row]:
    sizes = (AGENTS,) if effort.is_short else (1, MANY)
    ways: dict[str, Way] = {"bare": _bare_memory}
    ways |= {str(agents): partial(_host_memory, agents) for agents in sizes}
    repetitions = 1 if effort.is_short else 3
    found = in_turn(ways, replace(effort, repetitions=repetitions))
    for agents in sizes:
        yield Row(
            case=f"memory of a host, {agents:,} x 20 nodes",
            values=found[str(agents)],
            floor="rclpy, one action server",
            floor_values=found["bare"],
            unit="MB",
            goal=1.3 if agents > 1 else None,
            note="resident, without any run yet",
        )


def _bare_memory() -> float:
    with graphs() as make:
        graph = make("memory-floor")
        running = graph.bare("bare_action.py")
        graph.until_up()
        graph.rest(_MATCH_S)
        return running.resident_mb


def _host_memory(agents: int) -> float:
    with graphs() as make:
        graph = make("memory")
        trees = write_trees(
            graph.folder / "trees", {f"agent_{i:04d}": NODES_20 for i in range(agents)}
        )
        host = _start(graph, trees, system.market(trees), system.host(trees))[-1]
        graph.rest(_MATCH_S)
        return host.resident_mb


# Discovery


def _joining(effort: Effort) -> Iterator[Row]:
    """Yield how soon a late process has its first answer."""
    number = 1 if effort.is_short else 3
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        ways = {}
        for name, environment in _environments().items():
            there = Running(name, _ECHO, environment, folder / f"{name}.log")
            stack.callback(there.kill)
            while not there.is_up:
                time.sleep(0.01)
            ways[name] = partial(_join, environment)
        each: dict[str, list[list[float]]] = {name: [] for name in ways}

        def way(name: str) -> float:
            each[name].append([ways[name]() for _ in range(number)])
            return statistics.mean(each[name][-1])

        repetitions = 1 if effort.is_short else effort.repetitions
        found = in_turn(
            {name: partial(way, name) for name in ways}, replace(effort, repetitions=repetitions)
        )
    slowest = {name: [max(few) for few in each[name]] for name in each}
    for case, values, goal in (
        ("joining late until the first answer", found, None),
        (f"the slowest of {number} such", slowest, 0.05),
    ):
        note = "from the start of rclpy on, its node included"
        yield Row.beside(values, OURS, PLAIN, case=case, goal=goal, note=note)


def _environments() -> dict[str, dict[str, str]]:
    """Return the settings of our processes and of plain ROS, each on its own domain."""
    found = {}
    for name in (OURS, PLAIN):
        environment = {key: v for key, v in os.environ.items() if "PROFILES_FILE" not in key}
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        environment["ROS_DOMAIN_ID"] = str(reserve_domain())
        if name == OURS:
            set_discovery(environment)
        found[name] = environment
    return found


def _join(environment: dict[str, str]) -> float:
    late = subprocess.run(
        [*_ECHO, "late"], env=environment, capture_output=True, check=True, timeout=60.0
    )
    return float(late.stdout)


# Starting


def _starting(effort: Effort) -> Iterator[Row]:
    """Yield how long ``bt-agents up`` takes until the system is ready, in both layouts."""
    layouts = {"a process each": (), "one process": ("--one-process",)}
    ways = {name: partial(_up, options) for name, options in layouts.items()}
    for name, values in in_turn(ways, effort).items():
        yield Row.within(_READY_LIMIT_S, case=f"up until ready, {name}", values=values)


def _up(options: Sequence[str]) -> float:
    with graphs() as make:
        graph = make("up")
        trees = write_trees(graph.folder / "trees", {"agent": NODES_20})
        began = time.perf_counter()
        state = ("--state", graph.folder / "state")
        up = graph.command("bt-agents", "up", trees, "--no-studio", "--no-voice", *state, *options)
        graph.until(lambda: "ready after" in up.said, "up is ready")
        return time.perf_counter() - began
