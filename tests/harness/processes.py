# SPDX-License-Identifier: Apache-2.0
"""Real node processes that a test kills, stops and starts again, and the probe that hears them."""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import textwrap
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import ActionServer, CancelResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from bt_agents_interfaces.action import Say
from bt_agents_interfaces.msg import (
    Auction,
    Bids,
    CallForBids,
    Heartbeat,
    MarketStatus,
    Run,
    Scene,
    SceneEnd,
)
from bt_agents_interfaces.srv import RegisterHost
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from bt_agents_ros.node_main import SUPERVISED
from bt_agents_ros.timers import HEARTBEAT_S
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.fork_server import ForkServer
from bt_agents_tools.launcher.supervisor import Component, launch
from graph import Ros
from programs import ROOT
from tree_harness import SPACE, scene

HELD_UP = "Timeout (0:00:05)!"
"""Said by a process that the middleware has held up for so long at its end."""

LIMIT_S = 60.0
"""Until a test gives up waiting for something that hangs [s]."""

BEATS_A_SECOND = round(1 / HEARTBEAT_S)
"""Heartbeats of a host in a second; on a machine under load the clock of the processes."""

MODULES = (
    "marketplace_node.node",
    "bt_agents.host.node",
    "feedback_node.node",
    "scene_layer.node",
    "bt_agents_robot.robot",
    "bt_agents_ros.one_process",
)
"""Modules that are loaded once for all processes of a test worker."""

SKILLS = """
format: 1
skills:
  say:
    description: Speak a text.
    main: text
    inputs: {text: {type: text, description: what to say}}
    action: {name: say, type: bt_agents_interfaces/action/Say, goal: {text: "${text}"}}
"""


def write_trees(folder: Path, **trees: tuple[float, str]) -> Path:
    """Make a trees folder whose agents know one skill, ``say``; return it.

    Args:
        folder: Made by this.
        trees: Agent to the age in its profile, and its tree as an author writes it.
    """
    (folder / "agents").mkdir(parents=True)
    (folder / "skills").mkdir()
    shutil.copy(ROOT / "trees" / "scene.yaml", folder)
    (folder / "skills" / "voice.yaml").write_text(SKILLS)
    for name, (age, tree) in trees.items():
        text = (
            f"format: 1\nagent: {name}\ntitle: {name}\ndescription: d\n"
            f"profile: {{age: {age}, familiarity: 3, mood: 3}}\ntree:\n"
        )
        (folder / "agents" / f"{name}.yaml").write_text(
            text + textwrap.indent(textwrap.dedent(tree), "  ")
        )
    return folder


@cache
def fork_server() -> ForkServer:
    """Return the server of this test worker."""
    server = ForkServer(MODULES)
    atexit.register(server.close)
    return server


class NodeProcess:
    """One node in a process of its own.

    Args:
        component: What to run.
        node: Name of the node instead of its own.
        log: File for what it prints; grows over its starts.
    """

    def __init__(self, component: Component, node: str, log: Path) -> None:
        self.node = node
        self._component = component
        self._log = log
        self.start()

    def start(self) -> None:
        """Start it, once more after it was killed."""
        self._killed = False
        component = self._component
        # Nodes that share a process would all get the name.
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
        """All that it has printed."""
        return self._log.read_text(errors="replace")

    def hang(self) -> None:
        """Stop its time."""
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Let its time go on."""
        self._process.send_signal(signal.SIGCONT)

    @property
    def pid(self) -> int:
        """Id of its process."""
        return self._process.pid

    @property
    def crashed(self) -> bool:
        """Whether it has ended without having been killed."""
        return not self._killed and self._process.poll() is not None

    def terminate(self) -> None:
        """Tell it to end, as a supervisor does; until :attr:`ended` it cleans up."""
        self._killed = True
        self._process.terminate()

    @property
    def ended(self) -> bool:
        """Whether its process is over."""
        return self._process.poll() is not None

    @property
    def exit_code(self) -> int | None:
        """The code with which it has ended; None while it lives.

        It is 0 for a process whose work was over when the middleware held it up: see
        ``bt_agents_ros.workarounds.bounded_end``.
        """
        code = self._process.poll()
        return 0 if code == 1 and HELD_UP in self.said else code

    def expect_end(self) -> None:
        """Do not take it for a crash when it ends."""
        self._killed = True

    def kill(self) -> None:
        """End it as a crash does; nothing when it has ended."""
        self._killed = True
        self._process.kill()
        self._process.wait()


@dataclass(eq=False, kw_only=True)
class SayGoal:
    """One goal of ``say``.

    Attributes:
        how: Empty while it is being said, then finished or cancelled.
        beside: What was being said already when it began.
    """

    text: str
    goal: Any
    done: Any
    how: str = ""
    beside: tuple[str, ...] = ()


class SayServer(Node):
    """Action server of `say`: says each text until the test lets it end, or until it is cancelled.

    Attributes:
        holds: Whether a text is held until :meth:`finish`; others end at once.
        on_cancel: ``stops``; ``refuses``; ``hangs``, which never answers.
        say_goals: Everything it was told to say, in order.
    """

    def __init__(self) -> None:
        super().__init__("say_server")
        self.holds: Callable[[str], bool] = lambda _text: True
        self.on_cancel = "stops"
        self.say_goals: list[SayGoal] = []
        self._server = ActionServer(
            self,
            Say,
            "say",
            self._say,
            cancel_callback=self._cancel,
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
            result_timeout=5,
        )

    @property
    def texts(self) -> list[str]:
        """What it was told to say, in order."""
        return [sentence.text for sentence in self.say_goals]

    @property
    def speaking(self) -> list[str]:
        """What is being said now."""
        return [sentence.text for sentence in self.say_goals if not sentence.how]

    def finish(self) -> None:
        """Come to the end of everything that is being said."""
        for sentence in self.say_goals:
            self._end(sentence, "finished")

    def destroy_node(self) -> None:
        """Go, the action first."""
        self._server.destroy()
        super().destroy_node()

    async def _cancel(self, handle: Any) -> CancelResponse:
        if self.on_cancel == "hangs":
            await Future(executor=self.executor)
        if self.on_cancel == "refuses":
            return CancelResponse.REJECT
        for sentence in self.say_goals:
            if sentence.goal.goal_id == handle.goal_id:
                self._end(sentence, "cancelled")
        return CancelResponse.ACCEPT

    async def _say(self, handle: Any) -> Say.Result:
        text = handle.request.text
        done = Future(executor=self.executor)
        sentence = SayGoal(text=text, goal=handle, done=done, beside=tuple(self.speaking))
        self.say_goals.append(sentence)
        if self.holds(text):
            await sentence.done
        else:
            sentence.how = "finished"
        if sentence.how == "cancelled":
            handle.canceled()
        else:
            handle.succeed()
        return Say.Result()

    @staticmethod
    def _end(sentence: SayGoal, how: str) -> None:
        if not sentence.how:
            sentence.how = how
            sentence.done.set_result(None)


class SilentHost(Node):
    """A healthy host that never answers a call, so that each round lasts to its deadline."""

    def __init__(self) -> None:
        super().__init__("silent")
        self._heartbeat = Heartbeat(host=self.get_fully_qualified_name(), host_instance="first")
        self._beats = self.create_publisher(Heartbeat, "~/heartbeat", qos.EVENTS)
        self.create_timer(HEARTBEAT_S, self._beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_publisher(Bids, "bt_agents/bids", qos.EVENTS)
        self.create_subscription(CallForBids, "bt_agents/calls", lambda _call: None, qos.EVENTS)
        self._market = self.create_client(
            RegisterHost, "marketplace/register", qos_profile=qos.SERVICE
        )

    def register(self, ros: Ros) -> None:
        """Enter the market."""
        host = self.get_fully_qualified_name()
        request = RegisterHost.Request(
            host=host,
            host_instance="first",
            run_action=f"{host}/run",
            heartbeat=f"{host}/heartbeat",
            parameters=list(SPACE.names),
            agents=["nobody"],
        )
        answer = ros.call(self._market, request)
        assert answer.accepted
        self._heartbeat.token = answer.token

    def _beat(self) -> None:
        self._beats.publish(self._heartbeat)


@dataclass(eq=False)
class HeartbeatProbe:
    """The heartbeats of a host, as the probe hears them."""

    beats: list[Heartbeat] = field(default_factory=list)

    @property
    def count(self) -> int:
        """How many there were; the time of a loaded machine, in :data:`HEARTBEAT_S`."""
        return len(self.beats)

    @property
    def busy(self) -> bool:
        """Whether a tree was under way at the last one."""
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
        self.say_server: SayServer = ros.add(SayServer())
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
        self._dead_readers = 0

    # Processes

    def start(self, component: Component, node: str = "") -> NodeProcess:
        """Start a node, under another name if one is given."""
        node = node or component.name
        log = self.folder / f"{node}-{len(self.processes)}.log"
        self.processes.append(NodeProcess(component, node, log))
        return self.processes[-1]

    def market(self, trees: Path, **parameters: float | str | int) -> NodeProcess:
        """Start the marketplace."""
        component = components.market(trees)
        return self.start(replace(component, parameters={**component.parameters, **parameters}))

    def host(
        self, name: str, trees: Path, open_goals: Path | None = None, **parameters: float
    ) -> NodeProcess:
        """Start a host of the agents of a folder; ``open_goals`` is the file that outlives it."""
        file = str(open_goals) if open_goals is not None else ""
        component = components.host(trees, open_goals=file)
        given = {**component.parameters, **parameters}
        return self.start(replace(component, parameters=given), name)

    def heartbeat_probe(self, host: str) -> HeartbeatProbe:
        """Listen to the heartbeats of a host."""
        return HeartbeatProbe(self.ros.collect(Heartbeat, f"/{host}/heartbeat", qos.EVENTS))

    def close(self) -> None:
        """Kill everything and print what it said, which pytest shows of a failed test."""
        for process in self.processes:
            process.kill()
            print(f"--- {process.node}\n{process.said[-6000:]}")
        # A goal that has come in has to be answered, or rclpy leaves a coroutine behind.
        self.say_server.holds = lambda _text: False
        self.say_server.finish()
        self.ros.turns()

    # Waiting

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Turn until a condition holds, of which ``what`` says what it is."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"not within {LIMIT_S:g} s: {what}\n{self.told()}")
            crashed = [process.node for process in self.processes if process.crashed]
            assert not crashed, f"{crashed} ended while the test waited for {what}"
            self.ros.executor.spin_once(timeout_sec=0.05)

    def ask(self, client: Any, request: Any) -> Any:
        """Call a service of a process, again and again: what the graph shows may be dead."""
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
        """Return what has happened so far, in words."""
        lines = [
            f"round {r.round} of {r.epoch}: {r.agent} {_event(r)}: {r.message}" for r in self.runs
        ]
        lines += [f"round {bids.round}: {bids.host} answers" for bids in self.bids[-20:]]
        lines += [f"scene {end.scene_id} {end.code}: {end.message}" for end in self.ends]
        lines += [f"{s.how or 'speaking'}: {s.text}" for s in self.say_server.say_goals[-20:]]
        if self.statuses:
            lines.append(f"market: {self.statuses[-1].message}")
        return "\n".join(lines)

    @property
    def epoch(self) -> str:
        """The market of the last status; empty before the first."""
        return self.statuses[-1].epoch if self.statuses else ""

    def until_ready(self, hosts: int, agents: int, *, after: str = "") -> None:
        """Wait for a market that has so many hosts and hears scenes.

        Args:
            hosts: How many hosts.
            agents: How many agents all of them have.
            after: Epoch of an earlier market that was killed.
        """

        def ready() -> bool:
            status = self.statuses[-1] if self.statuses else None
            return (
                status is not None
                and status.epoch != after
                and (status.hosts, status.agents) == (hosts, agents)
            )

        self.until(ready, f"{agents} agents of {hosts} hosts at a market other than '{after}'")
        heard = self._scenes.get_subscription_count
        self.until(lambda: heard() > self._dead_readers, "the market hears scenes")
        bidders = self._bidding.get_publisher_count
        self.until(lambda: bidders() >= hosts, "the bids of all hosts are heard")

    def kill_market(self, market: NodeProcess) -> str:
        """Kill the marketplace; return its epoch."""
        market.kill()
        # The graph goes on counting a reader that was killed.
        self._dead_readers = self._scenes.get_subscription_count()
        return self.epoch

    # Scenes and runs

    def scene(self, scene_id: str, **values: float) -> None:
        """Put a scene on the market."""
        self._scenes.publish(scene_to_msg(scene(scene_id, **values)))

    def has_bid(self, host: str, round_number: int) -> bool:
        """Return whether a host has answered the call of a round."""
        return any((b.host, b.round) == (host, round_number) for b in self.bids)

    def started(self, agent: str = "", *, epoch: str = "") -> list[Run]:
        """Return the starts of runs, of one agent and of one market where they are named."""
        return [
            run
            for run in self.runs
            if run.event == Run.STARTED and agent in ("", run.agent) and epoch in ("", run.epoch)
        ]

    def ended(self, agent: str = "", *, epoch: str = "") -> list[Run]:
        """Return the ends of runs, of one agent and of one market where they are named."""
        return [
            run
            for run in self.runs
            if run.event == Run.ENDED and agent in ("", run.agent) and epoch in ("", run.epoch)
        ]

    def ends_of(self, scene_id: str) -> list[SceneEnd]:
        """Return the ends of a scene, of which there should be one."""
        return [end for end in self.ends if end.scene_id == scene_id]

    def until_end_of(self, scene_id: str) -> SceneEnd:
        """Wait for the end of a scene."""
        self.until(lambda: self.ends_of(scene_id), f"the end of scene {scene_id}")
        return self.ends_of(scene_id)[0]

    def until_speaking(self, *texts: str) -> None:
        """Wait until exactly these texts are being said."""
        self.until(lambda: self.say_server.speaking == list(texts), f"{texts} being said")


def _event(run: Run) -> str:
    events = {Run.STARTED: "started", Run.CANCELLING: "cancelling", Run.REFUSED: "refused"}
    outcomes = {
        Run.SUCCEEDED: "succeeded",
        Run.FAILED: "failed",
        Run.CANCELLED: "cancelled",
        Run.LOST: "lost",
    }
    return events.get(run.event) or outcomes.get(run.outcome, "ended")
