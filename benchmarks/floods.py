# SPDX-License-Identifier: Apache-2.0
"""Measures how long a flood silences a node, and how much memory the node keeps."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from lifecycle_msgs.srv import GetState
from std_msgs.msg import Empty

from bare import EVENTS
from bt_agents_interfaces.msg import Heartbeat, MarketHeartbeat
from bt_agents_ros.qos import SENSOR
from bt_agents_tools.launcher import components
from flooder import FLOODS, ROUNDS, pairs
from measuring import Effort, Row
from processes import Graph, Running, graphs, write_trees

PERIOD_S = 0.1
"""Time between two heartbeats of a node, or two requests to a node without heartbeats [s]."""

FLOOD_S = 2.0
"""Length of a flood [s]."""

ALIVE = 2
"""Signs of life after a flood that show that a node lives."""

HEARTBEATS: Mapping[str, tuple[Any, str]] = {
    "marketplace": (MarketHeartbeat, "marketplace/heartbeat"),
    "agents": (Heartbeat, "agents/heartbeat"),
    "robot": (Empty, "robot/heartbeat"),
}
"""Nodes with heartbeats; other nodes are polled."""

REST_S = 1.0
"""Time for which a node is watched before and after a flood [s]."""

_CODES = ("TOO_LARGE", "MALFORMED")
_LIFE_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Effect of a flood on a node.

    Attributes:
        silence_s: Longest time between two signs of life, from the flood to some time after [s].
        before_s: The same without a flood [s].
        growth_mb: Memory that the node has gained [MB].
        refusals: Lines in the node's log about refusals.
        codes: Codes of all refusals in the node's log since its start.
        sent: Number of messages or requests sent.
    """

    silence_s: float
    before_s: float
    growth_mb: float
    refusals: int
    codes: tuple[str, ...]
    sent: int


class Life:
    """Signs of life of a node: its heartbeats, or its answers to a small request."""

    def __init__(self, graph: Graph, name: str) -> None:
        self._graph = graph
        self._came: list[float] = []
        if name in HEARTBEATS:
            kind, topic = HEARTBEATS[name]
            matched = graph.probe.create_subscription(kind, topic, self._on_sign, SENSOR)
        else:
            matched = graph.probe.create_client(GetState, f"{name}/get_state", qos_profile=EVENTS)
            self._client, self._answer = matched, None
            graph.probe.create_timer(PERIOD_S, self._ask)
        graph.until_matched(matched)

    def watch(self, goes_on: Callable[[int], bool]) -> float:
        """Watch while ``goes_on`` returns True for the number of signs so far.

        Returns:
            The longest time between two signs [s].
        """
        self._came = [time.monotonic()]
        while goes_on(len(self._came) - 1):
            self._graph.turn()
        came = [*self._came, time.monotonic()]
        return max(later - earlier for earlier, later in pairwise(came))

    def _ask(self) -> None:
        if self._answer is None or self._answer.done():
            self._answer = self._client.call_async(GetState.Request())
            self._answer.add_done_callback(self._on_sign)

    def _on_sign(self, _sign: Any) -> None:
        self._came.append(time.monotonic())


class System:
    """The nodes of a system, to be flooded one after another."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        trees = write_trees(graph.folder / "trees", {"leo": "{say: hello}"})
        self.processes: dict[str, Running] = {
            component.name: graph.start(component)
            for component in (
                components.market(trees),
                components.scene_layer(trees),
                components.feedback(trees, str(graph.folder / "ledger.sqlite")),
                components.robot("off"),
                components.host(trees),
            )
        }
        graph.until_up()
        self._lives = {name: Life(graph, name) for name in self.processes}
        self._flooder = graph.bare("flooder.py")

    def flood(self, kind: str, target: str, seconds: float, rest_s: float) -> Outcome:
        """Flood a node for a time [s], and watch it before and afterwards [s]."""
        life, process = self._lives[target], self.processes[target]
        before_s = life.watch(_lasting(rest_s))
        before_mb, before = process.resident_mb, _refusals(process)
        said = len(self._flooder.said)

        def says(word: str) -> bool:
            if self._flooder.exit_code is not None:
                raise RuntimeError(f"{kind} at {target}: {self._flooder.said[-2000:]}")
            return any(line.startswith(word) for line in self._flooder.said[said:].splitlines())

        self._flooder.tell(f"{kind}, {target}, {seconds}")
        self._graph.until(lambda: says("begins"), f"{kind} at {target} begins")
        silence_s = life.watch(lambda _count: not says("sent"))
        rests, lives = _lasting(rest_s), _lasting(_LIFE_S)
        after_s = life.watch(lambda count: rests() or (count < ALIVE and lives()))
        self._graph.until(lambda: process.is_up, "it lives")
        return Outcome(
            silence_s=max(silence_s, after_s),
            before_s=before_s,
            growth_mb=process.resident_mb - before_mb,
            refusals=_refusals(process) - before,
            codes=tuple(code for code in _CODES if f"{code}: " in process.said),
            sent=int(self._flooder.said[said:].split()[-1]),
        )


def _refusals(process: Running) -> int:
    return sum(process.said.count(f"{code}: ") for code in _CODES)


def _lasting(seconds: float) -> Callable[..., bool]:
    end = time.monotonic() + seconds
    return lambda *_: time.monotonic() < end


def measure(effort: Effort) -> Iterator[Row]:
    """Yield how long each flood silences each node."""
    with graphs() as make:
        system = System(make("floods"))
        for kind, target in pairs():
            if effort.is_short and target != FLOODS[kind][1][0]:
                continue
            rest_s = max(0.2, effort.scale * REST_S)
            found = system.flood(kind, target, effort.scale * FLOOD_S, rest_s)
            yield Row(
                case=kind,
                side=f"{target}: {found.sent:,} sent, memory {found.growth_mb:+.0f} MB",
                values=[found.silence_s],
                floor="without it",
                floor_values=[found.before_s],
            )


def main() -> None:
    """Flood each node with each kind for so long, and rest in between as long; print JSON."""
    seconds, rest_s = (float(word) for word in sys.argv[1:])
    with graphs() as make:
        system = System(make("flooded"))
        for kind, target in pairs():
            for _ in range(ROUNDS.get(kind, 1)):
                found = system.flood(kind, target, seconds, rest_s)
                print(json.dumps({"kind": kind, "node": target, **asdict(found)}), flush=True)


if __name__ == "__main__":
    main()
