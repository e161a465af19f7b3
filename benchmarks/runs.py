# SPDX-License-Identifier: Apache-2.0
"""Measures delays of runs: a cancel, the results of leaves, feedback, the full cycle."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial

from std_msgs.msg import String

from bare import EVENTS
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.supervisor import Component
from measuring import COLD, HOT, OURS, PAUSE_S, Effort, Row, Way, in_turn, median_of
from processes import Graph, graphs, write_trees
from run_probes import SETTLE_S, Cycle, Market, Moods, Results, Runs

REST_S = 0.005
"""Pause after the start of a run, even at a hot pace [s]."""

CROWD = "\n  parallel:\n" + 31 * ("    - parallel:\n" + 31 * "      - wait: 1 h\n")
"""993 nodes, all of which run."""

TREES = {
    "lone": "\n  wait: 1 h",
    "crowd": CROWD,
    "speaker": "\n  say: hello",
    "listener": "{wait_for: {topic: /heard, type: std_msgs/msg/String}}",
}
FEEDBACK = """\
format: 1
rounds: 1
seed: 1
scenes: [{age: 3, familiarity: 3, mood: 3}]
feedback: {sequence: [{age: 3.5, familiarity: 3, mood: 3}], repeat: true}
"""
RATES = (1, 100)
"""Ticks a second of the hosts."""

AGENTS = 3
ROLES = ("scene", "market", "agents", "feedback")
TOGETHER, APART = "bt-agents, one process", "bt-agents, 4 processes"
PLAIN = "paper's flow, rclpy.spin"
"""Systems that go through full cycles."""

GOALS = {(APART, PLAIN): 1.5, (TOGETHER, APART): 0.45, (TOGETHER, PLAIN): 0.7}
"""Largest ratios of cycle times wanted."""


def cancels(runs: Runs, agent: str, number: int, pause_s: float) -> Way:
    """Return a way that cancels a number of runs, each some time after its start [s]."""

    def cancel() -> float:
        handle = runs.start(agent)
        runs.graph.rest(pause_s)
        return runs.cancel(handle)

    return median_of(cancel, number)


def paces(effort: Effort, hot_s: float) -> tuple[tuple[str, float], ...]:
    """Return the pause before each request [s] by pace; only one pace for a short effort."""
    cold = (COLD, PAUSE_S)
    return (cold,) if effort.is_short else ((HOT, hot_s), cold)


def measure(effort: Effort) -> Iterable[Row]:
    """Yield each cost."""
    with graphs() as make:
        yield from _host(effort, make("runs-floor"), make("runs"))
    with graphs() as make:
        yield from _mood(effort, make("mood-floor"), make("mood"))
    with graphs() as make:
        yield from _cycle(effort, make)


def _host(effort: Effort, floor: Graph, ours: Graph) -> Iterator[Row]:
    trees = write_trees(ours.folder / "trees", TREES)
    for program in ("cancelled", "waiting"):
        floor.bare("bare_runs.py", program)
    market = Market(ours)
    rates = RATES[:1] if effort.is_short else RATES
    for rate in rates:
        host = components.host(trees)
        parameters = {**host.parameters, "tick_rate": float(rate)}
        ours.start(replace(host, parameters=parameters), f"agents_{rate}")
    floor.until_up()
    ours.until_up()
    hosts = {rate: Runs(ours, market, f"agents_{rate}") for rate in rates}
    yield from _cancelling(effort, Runs(floor, None, "bare_host"), hosts)
    yield from _results(effort, floor, hosts[RATES[0]])


def _cancelling(effort: Effort, bare: Runs, hosts: Mapping[int, Runs]) -> Iterator[Row]:
    for runs in (bare, *hosts.values()):
        runs.graph.rest(SETTLE_S)
    cases = {
        (agent, rate): f"cancel of {words} at {rate} Hz"
        for agent, words in (("lone", "one leaf"), ("crowd", "961 leaves"))
        for rate in hosts
    }
    for pace, pause in paces(effort, 0.0):
        number = effort.times(12)
        ways = {"": cancels(bare, "bare", number, pause)}
        for agent, rate in cases:
            ways[cases[agent, rate]] = cancels(hosts[rate], agent, number, pause)
        found = in_turn(ways, effort)
        for case in cases.values():
            yield Row(
                case=case,
                values=found[case],
                floor="rclpy",
                floor_values=found[""],
                goal=1.3,
                pace=pace,
            )


def _results(effort: Effort, floor: Graph, runs: Runs) -> Iterator[Row]:
    def begin(agent: str) -> Callable[[], None]:
        result = runs.start(agent).get_result_async()
        return lambda: runs.graph.until(result.done, "the result")

    start = floor.probe.create_publisher(String, "begin", EVENTS)

    def begin_bare(agent: str) -> Callable[[], None]:
        if agent == "speaker":
            start.publish(String(data="hello"))
        return lambda: None

    ours = Results(runs.graph, "agents_1", begin)
    bare = Results(floor, "bare_host", begin_bare)
    floor.until_matched(start)
    for graph in (floor, runs.graph):
        graph.rest(SETTLE_S)
    for pace, pause in paces(effort, REST_S):
        number = effort.times(16)
        found = in_turn(
            {
                f"{what} {side}": median_of(partial(getattr(one, what), pause), number)
                for what in ("topic", "action")
                for side, one in (("ours", ours), ("bare", bare))
            },
            effort,
        )
        for what, words in (("topic", "a message"), ("action", "the result of a goal")):
            yield Row(
                case=f"{words} to the tick that sees it",
                values=found[f"{what} ours"],
                floor="rclpy",
                floor_values=found[f"{what} bare"],
                goal=1.5,
                pace=pace,
            )


def _mood(effort: Effort, floor: Graph, ours: Graph) -> Iterator[Row]:
    trees = write_trees(ours.folder / "trees", {"a": "{wait: 1 h}"})
    floor.bare("bare_runs.py", "mood")
    floor.bare("bare_runs.py", "learning", floor.folder / "ledger.sqlite")
    ours.start(components.scene_layer(trees))
    ours.start(components.feedback(trees, str(ours.folder / "ledger.sqlite")))
    floor.until_up()
    ours.until_up()
    bare = "rclpy, SQLite commit"
    sides = {OURS: Moods(ours, bare=False), bare: Moods(floor, bare=True)}
    number = effort.times(16)
    found = in_turn(
        {side: median_of(partial(one.see, PAUSE_S), number) for side, one in sides.items()}, effort
    )
    yield Row.beside(found, OURS, bare, case="mood message to its feedback", goal=1.5, pace=COLD)


def _cycle(effort: Effort, make: Callable[[str], Graph]) -> Iterator[Row]:
    together, apart, plain = make("cycle-together"), make("cycle-ours"), make("cycle-plain")
    for component in _system(apart):
        apart.start(component)
    together.start(components.one_process(_system(together)))
    for role in ROLES:
        plain.bare("replica_paper.py", role)
    graphs_of = {TOGETHER: together, APART: apart, PLAIN: plain}
    sides = {side: Cycle(graph, AGENTS) for side, graph in graphs_of.items()}
    for pace, pause in paces(effort, 0.0):
        number = effort.times(16)
        found = in_turn(
            {side: median_of(partial(c.once, pause), number) for side, c in sides.items()}, effort
        )
        for (side, floor), goal in GOALS.items():
            case = "trigger to the winner's new profile"
            yield Row.beside(found, side, floor, case=case, goal=goal, pace=pace)


def _system(graph: Graph) -> tuple[Component, ...]:
    names = [f"agent_{number}" for number in range(AGENTS)]
    trees = write_trees(graph.folder / "trees", dict.fromkeys(names, "{check: 2 > 1}"))
    told = graph.folder / "feedback.yaml"
    told.write_text(FEEDBACK, encoding="utf-8")
    return (
        components.scene_layer(trees),
        components.market(trees),
        components.host(trees),
        components.feedback(trees, str(graph.folder / "ledger.sqlite"), told),
    )
