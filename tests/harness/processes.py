# SPDX-License-Identifier: Apache-2.0
"""Node processes that a test kills, suspends and restarts, and a probe of their messages."""

from __future__ import annotations

import atexit
import os
import signal
import textwrap
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import GoalResponse

from bt_agents_core.liveness import HEARTBEAT_S
from bt_agents_interfaces.msg import Auction, Bids, Heartbeat, MarketStatus, Run, Scene, SceneEnd
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from bt_agents_ros.node_main import SUPERVISED
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.fork_server import ForkServer
from bt_agents_tools.launcher.supervisor import Component, launch
from graph import Ros
from scripted_server import Script, ScriptedServer
from tree_harness import VOICE, agent_text, scene, trees_folder

LIMIT_S = 60.0
"""Time limit of a wait for something that may hang [s]."""

BEATS_A_SECOND = round(1 / HEARTBEAT_S)
"""Heartbeats of a host per second; on a busy machine, the clock of the processes."""

PATIENT_S = 10.0
"""Lease of hosts that no busy machine silences for so long [s]."""

MODULES = (
    "marketplace_node.node",
    "bt_agents.host.node",
    "feedback_node.node",
    "scene_layer.node",
    "bt_agents_robot.robot",
    "bt_agents_ros.one_process",
)
"""Modules that a test worker loads once for all its processes."""


def write_trees(folder: Path, **trees: tuple[float, str]) -> Path:
    """Make a trees folder whose agents know one skill, ``say``; return it.

    Args:
        folder: Created by this function.
        trees: Agent → the age in its profile, and its tree as YAML.
    """
    texts = {}
    for name, (age, tree) in trees.items():
        indented = textwrap.indent(textwrap.dedent(tree), "  ").strip()
        texts[name] = agent_text(name, indented, profile=(age, 3, 3))
    return trees_folder(folder, texts, VOICE)


@cache
def fork_server() -> ForkServer:
    """Return the fork server of this test worker."""
    server = ForkServer(MODULES)
    atexit.register(server.close)
    return server


class NodeProcess:
    """One node in a process of its own.

    Args:
        component: Component to run.
        node: Name of the node instead of its own.
        log: File of its output; grows over restarts.
    """

    def __init__(self, component: Component, node: str, log: Path) -> None:
        self.node = node
        self._component = component
        self._log = log
        self.start()

    def start(self) -> None:
        """Start it, or restart it after a kill."""
        self._killed = False
        component = self._component
        # All nodes in one process would get the name.
        remapping = [] if component.parts else ["-r", f"__node:={self.node}"]
        with self._log.open("ab") as log:
            self._process = launch(
                [*component.command(), *remapping],
                {**os.environ, SUPERVISED: str(os.getpid()), "PYTHONUNBUFFERED": "1"},
                log.fileno(),
                (),
                fork_server() if {*component.modules} <= {*MODULES} else None,
            )

    @property
    def said(self) -> str:
        """Its whole output."""
        return self._log.read_text(errors="replace")

    def hang(self) -> None:
        """Suspend it."""
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Resume it."""
        self._process.send_signal(signal.SIGCONT)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def crashed(self) -> bool:
        """Whether it has ended without being killed."""
        return not self._killed and self._process.poll() is not None

    def terminate(self) -> None:
        """Ask it to end, as a supervisor does; it cleans up until :attr:`ended`."""
        self._killed = True
        self._process.send_signal(signal.SIGTERM)

    @property
    def ended(self) -> bool:
        """Whether its process has ended."""
        return self._process.poll() is not None

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process; None while it lives."""
        return self._process.poll()

    def expect_end(self) -> None:
        """Do not count its end as a crash."""
        self._killed = True

    def kill(self) -> None:
        """Kill it, as in a crash; do nothing if it has ended."""
        self._killed = True
        self._process.kill()
        self._process.wait()


class SayServer(ScriptedServer):
    """Action server of ``say``: says each text until the test ends it, or until it is cancelled.

    Attributes:
        beside: For each goal, the texts that were already being said when it came.
    """

    def __init__(self, ros: Ros) -> None:
        super().__init__(ros, script=Script(finish_s=None), node="say_server")
        self.beside: list[list[str]] = []

    @property
    def texts(self) -> list[str]:
        """Texts of all goals so far, in order."""
        return [goal.request.text for goal in self.goals]

    @property
    def speaking(self) -> list[str]:
        """Texts that are being said now."""
        return [goal.request.text for goal in self.goals if not goal.outcome]

    def finish(self) -> None:
        """Finish all texts that are being said."""
        for goal in self.goals:
            goal.finish()

    def let_go(self) -> None:
        """Finish all texts, from now on each one at once."""
        self.script.finish_s = 0.0
        self.finish()

    async def _answer(self, request: Any) -> GoalResponse:
        self.beside.append(self.speaking)
        return await super()._answer(request)


@dataclass(eq=False)
class HeartbeatProbe:
    """Heartbeats of a host that the probe has received."""

    beats: list[Heartbeat] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of heartbeats: elapsed time of a busy machine, in :data:`HEARTBEAT_S`."""
        return len(self.beats)

    @property
    def busy(self) -> bool:
        """Whether a tree was running at the last heartbeat."""
        return bool(self.beats) and self.beats[-1].round > 0


class System:
    """Node processes around one probe in this process.

    Args:
        ros: The nodes of this process.
        folder: For trees, logs and a ledger.
    """

    def __init__(self, ros: Ros, folder: Path) -> None:
        self.ros = ros
        self.folder = folder
        self.processes: list[NodeProcess] = []
        self.say_server = SayServer(ros)
        self.auctions: list[Auction] = ros.collect(Auction, "bt_agents/auctions", qos.HISTORY)
        self.bids: list[Bids] = []
        self._bidding = ros.node.create_subscription(
            Bids, "bt_agents/bids", self.bids.append, qos.EVENTS
        )
        self.runs: list[Run] = ros.collect(Run, "bt_agents/runs", qos.HISTORY)
        self.ends: list[SceneEnd] = ros.collect(SceneEnd, "bt_agents/scene_ends", qos.FACTS)
        self.statuses: list[MarketStatus] = ros.collect(
            MarketStatus, "bt_agents/market", qos.FACTS
        )
        self._scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
        self._dead_readers: set[bytes] = set()

    # Processes

    def start(self, component: Component, node: str = "") -> NodeProcess:
        """Start a node, optionally under another name."""
        node = node or component.name
        log = self.folder / f"{node}-{len(self.processes)}.log"
        self.processes.append(NodeProcess(component, node, log))
        return self.processes[-1]

    def market(self, trees: Path, **parameters: float | str | int) -> NodeProcess:
        """Start the marketplace; without another ``host_lease``, it misses no slow host."""
        component = components.market(trees)
        given = {**component.parameters, "host_lease": PATIENT_S, **parameters}
        return self.start(replace(component, parameters=given))

    def host(
        self, name: str, trees: Path, open_goals: Path | None = None, **parameters: float
    ) -> NodeProcess:
        """Start a host of the agents of a folder; the file ``open_goals`` outlives it."""
        file = str(open_goals) if open_goals is not None else ""
        component = components.host(trees, open_goals=file)
        given = {**component.parameters, **parameters}
        return self.start(replace(component, parameters=given), name)

    def heartbeat_probe(self, host: str) -> HeartbeatProbe:
        """Subscribe to the heartbeats of a host; wait for the first."""
        probe = HeartbeatProbe(self.ros.collect(Heartbeat, f"/{host}/heartbeat", qos.EVENTS))
        self.until(lambda: probe.count, f"a heartbeat of {host}")
        return probe

    def close(self) -> None:
        """Kill everything and print its output, which pytest shows if a test fails."""
        for process in self.processes:
            process.kill()
            print(f"--- {process.node}\n{process.said[-6000:]}")
        # A received goal needs an answer, or rclpy leaves a coroutine behind.
        self.say_server.let_go()
        self.ros.turns()

    # Waiting

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Spin until a condition holds; ``what`` describes it."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"not within {LIMIT_S:g} s: {what}\n{self.told()}")
            crashed = [process.node for process in self.processes if process.crashed]
            assert not crashed, f"{crashed} ended while the test waited for {what}"
            self.ros.executor.spin_once(timeout_sec=0.05)

    def ask(self, client: Any, request: Any) -> Any:
        """Call a service repeatedly until it answers: the graph may still list a dead process."""
        asked = time.monotonic()
        answers = [client.call_async(request)]

        def answered() -> bool:
            nonlocal asked
            if time.monotonic() - asked > 1.0:
                asked = time.monotonic()
                answers.append(client.call_async(request))
            return any(answer.done() for answer in answers)

        self.until(client.service_is_ready, f"{client.srv_name} is there")
        self.until(answered, f"an answer of {client.srv_name}")
        return next(answer.result() for answer in answers if answer.done())

    def told(self) -> str:
        """Return the events so far as text."""
        lines = [
            f"round {r.round} of {r.epoch}: {r.agent} {r.event}-{r.outcome}: {r.message}"
            for r in self.runs
        ]
        lines += [f"round {bids.round}: {bids.host} answers" for bids in self.bids[-20:]]
        lines += [f"scene {end.scene_id} {end.code}: {end.message}" for end in self.ends]
        lines += [
            f"{one.outcome or 'speaking'}: {one.request.text}"
            for one in self.say_server.goals[-20:]
        ]
        if self.statuses:
            lines.append(f"market: {self.statuses[-1].message}")
        return "\n".join(lines)

    @property
    def epoch(self) -> str:
        """Epoch in the last status of the market; empty before the first."""
        return self.statuses[-1].epoch if self.statuses else ""

    def until_ready(self, hosts: int, agents: int, *, after: str = "") -> None:
        """Wait for a market that has this many hosts and subscribes to scenes.

        Args:
            hosts: Number of hosts.
            agents: Number of agents of all hosts.
            after: Epoch of an earlier, killed market.
        """

        def ready() -> bool:
            if not self.statuses or self.epoch == after:
                return False
            return (self.statuses[-1].hosts, self.statuses[-1].agents) == (hosts, agents)

        self.until(ready, f"{agents} agents of {hosts} hosts at a market other than '{after}'")
        heard = self._scenes.get_subscription_count
        self.until(
            lambda: heard() > len(self._readers() & self._dead_readers), "the market hears scenes"
        )
        bidders = self._bidding.get_publisher_count
        self.until(lambda: bidders() >= hosts, "the bids of all hosts are heard")

    def kill_market(self, market: NodeProcess) -> str:
        """Kill the marketplace; return its epoch."""
        market.kill()
        # The graph still has a killed subscriber until its lease ends.
        self._dead_readers = self._readers()
        return self.epoch

    def _readers(self) -> set[bytes]:
        """Return the ids of all subscriptions to scenes in the graph."""
        found = self.ros.node.get_subscriptions_info_by_topic("bt_agents/scene")
        return {bytes(one.endpoint_gid) for one in found}

    # Scenes and runs

    def scene(self, scene_id: str, **values: float) -> None:
        """Send a scene to the market."""
        self._scenes.publish(scene_to_msg(scene(scene_id, **values)))

    def old_person(self, scene_id: str) -> None:
        """Send a scene with an old person."""
        self.scene(scene_id, age=5, familiarity=3, mood=3)

    def has_bid(self, host: str, round_number: int) -> bool:
        """Return whether a host has answered the call for bids of a round."""
        return any((b.host, b.round) == (host, round_number) for b in self.bids)

    def started(self, agent: str = "", *, epoch: str = "") -> list[Run]:
        """Return the starts of runs, optionally of one agent and one market."""
        return self._events(Run.STARTED, agent, epoch)

    def ended(self, agent: str = "", *, epoch: str = "") -> list[Run]:
        """Return the ends of runs, optionally of one agent and one market."""
        return self._events(Run.ENDED, agent, epoch)

    def _events(self, event: int, agent: str, epoch: str) -> list[Run]:
        return [
            run
            for run in self.runs
            if run.event == event and agent in ("", run.agent) and epoch in ("", run.epoch)
        ]

    def ends_of(self, scene_id: str) -> list[SceneEnd]:
        """Return the ends of a scene, of which only one is allowed."""
        return [end for end in self.ends if end.scene_id == scene_id]

    def until_end_of(self, scene_id: str) -> SceneEnd:
        """Wait for the end of a scene."""
        self.until(lambda: self.ends_of(scene_id), f"the end of scene {scene_id}")
        return self.ends_of(scene_id)[0]

    def until_speaking(self, *texts: str) -> None:
        """Wait until exactly these texts are being said."""
        self.until(lambda: self.say_server.speaking == list(texts), f"{texts} being said")
