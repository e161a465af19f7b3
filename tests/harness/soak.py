# SPDX-License-Identifier: Apache-2.0
"""Operates a whole system at random while its processes are killed: ``scripts/soak [MINUTES]``."""

from __future__ import annotations

import fcntl
import json
import math
import os
import random
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click
import rclpy
from action_msgs.msg import GoalStatus, GoalStatusArray
from rcl_interfaces.srv import GetParameters
from rclpy.signals import SignalHandlerOptions

from bt_agents_interfaces.msg import Auction, Feedback, MarketStatus, OpenGoals, Run, SceneEnd
from bt_agents_interfaces.srv import (
    Analyze,
    CancelRun,
    GiveFeedback,
    ManageProfiles,
    OperateMarket,
    PreviewAuction,
    ReloadAgents,
    Tune,
)
from bt_agents_lab.recorder.daily_recorder import newest_files
from bt_agents_lab.replay.decisions import replay_decisions
from bt_agents_lab.replay.findings import ReplayVerdict
from bt_agents_lab.replay.recording_index import read
from bt_agents_lab.replay.replay_learning import replay_feedback
from bt_agents_ros import qos
from bt_agents_ros.messages import seconds
from bt_agents_ros.workarounds.cached_executor import CachedExecutor
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import reserve_domain
from bt_agents_tools.launcher.supervisor import Supervisor, set_discovery
from programs import ROOT, Program, environment_of, nodes
from soak_promises import (
    EVERYTHING,
    FEEDBACK_STORED,
    MOST_PER_MINUTE,
    ONE_END,
    RECOVERY,
    Acted,
    Event,
    Failed,
    Fault,
    FeedbackAcknowledged,
    FilesCounted,
    LedgerRead,
    Measured,
    Replayed,
    RobotGoals,
    SceneAcknowledged,
    SceneEnded,
    SceneShown,
    Served,
    SettingRead,
    SettingRequested,
    Verdict,
    check,
    died_unsent,
    growths,
    longest_wait,
)
from tree_harness import agent_text, trees_folder

OTHER_HOST = "other_agents"

MODULES = {
    "marketplace_node.node": "marketplace",
    "scene_layer.node": "scene_layer",
    "bt_agents.host.node": "agents",
    "feedback_node.node": "feedback",
    "bt_agents_robot.robot": "robot",
    "bt_agents_lab.node": "journal",
}
"""Module of a process of ``bt-agents up`` → its component."""

COMPONENTS = (*MODULES.values(), OTHER_HOST)
HOSTS = ("agents", OTHER_HOST)

SERVICES = {
    "scene_layer/analyze": Analyze,
    "marketplace/cancel": CancelRun,
    "marketplace/operate": OperateMarket,
    "marketplace/preview": PreviewAuction,
    "feedback/give": GiveFeedback,
    "feedback/manage": ManageProfiles,
    **{f"{host}/tune": Tune for host in HOSTS},
    **{f"{host}/reload": ReloadAgents for host in HOSTS},
    **{f"{host}/get_parameters": GetParameters for host in HOSTS},
}
"""Service → its type; each begins with its component."""

AGENTS = {
    "alma": ("agents", 1.5),
    "bruno": ("agents", 2.5),
    "carla": (OTHER_HOST, 3.5),
    "dario": (OTHER_HOST, 4.5),
}
"""Agent → its host, and the age in its profile."""

TREE = """sequence:
    - parallel:
        succeed_on: all
        children:
          - say: {text}
          - show: {{text: {name}, duration: 300 ms}}
    - wait: ${{pause}}
    - say: bye"""
TUNABLES = """tunables:
  pause: {default: 0.2 s, min: 0.1 s, max: 1 s, description: between two sentences}"""

ACTIONS = ("say", "show", "ask", "drive")
FLOODER = ROOT / "benchmarks" / "flooder.py"
FLOODS = ("small messages", "malformed messages", "parameters")
"""Kinds of floods without large messages: the middleware keeps the memory of the largest one."""

FLOOD_S = 2.0
"""How long a flood of the marketplace lasts [s]."""

FLOODED_S = 5.0
"""Length of a flood [s], including the start of the process that floods."""

ANSWER_S = 5.0
"""Time after which a request counts as unanswered [s]."""

READY_S = 60.0
"""Time after which a start, or the end of all scenes, counts as failed [s]."""

SERVED_S = 30.0
"""Longest wait for a run after a fault [s]."""

PROBE_S = 0.3
"""Time between two scenes after a fault while no scene is waiting [s]."""

ACTED = ("SUCCEEDED", "FAILED", "CANCELLED", "STOPPED", "PREEMPTED")
"""Codes of scenes that end after an act, or that an operator drops; others end in vain."""

STEADY_S = 11.0
"""Least life of a process before the next kill [s]; otherwise its supervisor would wait longer."""

TRAP_SHARE = 0.5
"""Share of the kills that follow right after an answer or announcement of the victim."""

TRAP_S = 4.0
"""Longest wait for that [s]."""

UNREAD_SHARE = 0.2
"""Share of the faults during which nobody reads the output of ``up``."""

PIPE_BYTES = 4096
"""Capacity of the pipe of ``up``."""

SETTLED_S = 1.5
"""Delay after a request or a start before settings in force are read [s]."""

MEASURED_S = 5.0
SPARE_SHARE = 0.15
"""Idle share of all cores below which the machine counts as overloaded."""

UNDER_WAY = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)
TRACES = ("Traceback (most recent call last)", "Fatal Python error", "terminate called")


def cpu_times() -> tuple[float, float]:
    """Return the idle time and all time of all cores, in ticks of the kernel."""
    values = [float(one) for one in Path("/proc/stat").read_text().splitlines()[0].split()[1:]]
    return values[3] + values[4], sum(values[:8])


class Soak:
    """A system of real processes, its operator, a source of faults, and an observer.

    Args:
        folder: For trees, state and logs.
        seed: Seed of all random choices.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self.events: list[Event] = []
        self._chance = random.Random(seed)
        self._began = time.monotonic()
        self._wall = time.time() - self._began
        self._market: Any = None
        self._market_since = 0.0
        self._ended: set[str] = set()
        self._not_shown: dict[str, float] = {}
        self._scene_layer_killed = -math.inf
        self._robot_goals = RobotGoals()
        self._runs: dict[bytes, str] = {}
        # Faults after which no run has started yet, and the CPU times at each.
        self._pending: list[tuple[Fault, tuple[float, float]]] = []
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._floods: list[subprocess.Popen[bytes]] = []
        self._stopped: set[int] = set()
        self._since: dict[str, tuple[int, float]] = {}
        self._next_fault = 5.0
        self._next_probe = 0.0
        self._trap = ""
        self._trap_until = 0.0
        self._faults = False
        self._measured = 0.0
        self._asked: dict[str, float] = {}
        self._presets: dict[str, object] = {}
        self._values: dict[str, object] = {}
        self._numbers = 0
        self._scene_requests: list[tuple[float, float]] = []
        self.done: dict[str, int] = {}

    def now(self) -> float:
        return time.monotonic() - self._began

    def _at(self, wall_s: float) -> float:
        return wall_s - self._wall - self._began

    def _note(self, kind: Callable[..., Event], **fields: Any) -> None:
        """Record an event of now, or of another moment ``at``."""
        self.events.append(kind(**({"at": self.now()} | fields)))

    # The system

    def start(self) -> None:
        """Start the processes, and wait until all agents are registered."""
        for host in HOSTS:
            trees_folder(self._trees(host), {})
        for name, (_, age) in AGENTS.items():
            self._write_agent(name, age, "hello")
        state = self.folder / "state"
        environment = environment_of(self.folder / "home") | {"COLUMNS": "200"}
        places = ("--state", str(state), "--journal", str(self.folder / "journal"))
        up = ("up", str(self._trees("agents")), "--no-voice", "--on-new-scene", "preempt")
        self._up = Program((*up, *places), environment)
        assert self._up.process.stdout is not None
        fcntl.fcntl(self._up.process.stdout, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        other = components.host(
            self._trees(OTHER_HOST),
            tunings=str(state / "other" / "tunings.json"),
            open_goals=str(state / "other" / "open-goals"),
            name=OTHER_HOST,
        )
        self._supervisor = Supervisor(self.folder / "logs")
        self._supervisor.start(other)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._executor = CachedExecutor()
        self._node = rclpy.create_node("soak")
        self._executor.add_node(self._node)
        self._observe()
        self._until(lambda: self._market and self._market.agents == len(AGENTS), "all agents")

    def _trees(self, host: str) -> Path:
        return self.folder / f"trees-{host}"

    def _write_agent(self, name: str, age: float, text: str) -> None:
        path = self._trees(AGENTS[name][0]) / "agents" / f"{name}.yaml"
        new = path.with_suffix(".new")
        tree = TREE.format(name=name, text=text)
        new.write_text(agent_text(name, tree, TUNABLES, (age, 3, 3)))
        new.replace(path)

    def _observe(self) -> None:
        node = self._node
        for kind, topic, handle, profile in (
            (SceneEnd, "bt_agents/scene_ends", self._on_end, qos.FACTS),
            (Run, "bt_agents/runs", self._on_run, qos.FACTS),
            (MarketStatus, "bt_agents/market", self._on_market, qos.FACTS),
            (Auction, "bt_agents/auctions", lambda one: self._show(one.scene.scene_id), qos.FACTS),
            (OpenGoals, "bt_agents/open_goals", self._on_open_goals, qos.FACTS),
        ):
            node.create_subscription(kind, topic, handle, profile)
        for action in ACTIONS:
            node.create_subscription(
                GoalStatusArray, f"{action}/_action/status", self._states(action), qos.FACTS
            )
        self._clients = {
            name: node.create_client(kind, name, qos_profile=qos.SERVICE)
            for name, kind in SERVICES.items()
        }

    # What is heard

    def _on_end(self, message: Any) -> None:
        self._ended.add(message.scene_id)
        self._spring("marketplace")
        if message.scene_id:  # the scenes of a flood have no id
            self._note(SceneEnded, scene=message.scene_id, code=message.code, epoch=message.epoch)

    def _on_run(self, message: Any) -> None:
        self._show(message.scene.scene_id)
        at = self._at(seconds(message.header.stamp))
        if message.event != Run.STARTED:
            return
        self._spring(message.host.strip("/"))
        served = [one for one in self._pending if one[0].at < at]
        for fault, cpu in served:
            self._pending.remove((fault, cpu))
            idle, total = (a - b for a, b in zip(cpu_times(), cpu, strict=True))
            overloaded = total > 0 and idle / total < SPARE_SHARE
            silence_s = self._silence_s(fault, at)
            self._note(Served, at=at, fault=fault, silence_s=silence_s, overloaded=overloaded)
            self._next_fault = self.now() + self._chance.uniform(2.0, 7.0)

    def _silence_s(self, fault: Fault, until: float) -> float:
        """Return the longest wait for an act between a fault and the next run."""
        goals = self._robot_goals.all.values()
        acts = [moment for goal in goals for moment in (goal.at, goal.until)]
        ended = dict.fromkeys(self._waiting(), math.inf)
        for end in self.events:
            if isinstance(end, SceneEnded):
                in_vain = end.code not in ACTED and end.at > fault.over
                ended[end.scene] = until if in_vain else end.at
        wanted = [
            (one.at, ended.get(one.scene, one.at))
            for one in self.events
            if isinstance(one, SceneAcknowledged)
        ]
        return longest_wait(fault.over, until, acts, [*wanted, *self._scene_requests])

    def _on_market(self, message: Any) -> None:
        if self._market is None or self._market.epoch != message.epoch:
            self._market_since = self.now()
        self._market = message
        for scene in (message.scene_id, message.finished_scene_id, *message.waiting):
            self._show(scene)

    def _show(self, scene: str) -> None:
        if self._not_shown.pop(scene, None) is not None:
            self._note(SceneShown, scene=scene)

    def _on_open_goals(self, message: Any) -> None:
        run = f"{message.host} {message.host_instance} {message.epoch}/{message.round}"
        for goal in message.goals:
            # The host's next run names a goal again if its end is not confirmed.
            self._runs.setdefault(bytes(goal.goal_id), run)

    def _states(self, action: str) -> Callable[[Any, Any], None]:
        def take(message: Any, info: Any) -> None:
            at = self._at(int(info["source_timestamp"]) * 1e-9)
            listed = {
                bytes(one.goal_info.goal_id.uuid): one.status in UNDER_WAY
                for one in message.status_list
            }
            self._robot_goals.take(action, at, listed)

        return take

    # Turning

    def turn(self) -> None:
        """Handle messages, do what is due, and cause a fault when it is time."""
        self._executor.spin_once(timeout_sec=0.02)
        now = self.now()
        due = [one for one in self._due if one[0] <= now]
        self._due = [one for one in self._due if one[0] > now]
        for _, act in due:
            act()
        self._take_lines()
        if now - self._measured >= MEASURED_S:
            self._measured = now
            self._measure()
        if self._pending and now >= self._next_probe:
            self._next_probe = now + PROBE_S
            self._probe()
        late = [one for one in self._pending if now - one[0].over > SERVED_S]
        for pending in late:
            self._pending.remove(pending)
            self._next_fault = now + 2.0
        if self._trap:
            if now > self._trap_until:
                self._spring(self._trap)
        elif self._faults and not (self._pending or self._stopped) and now >= self._next_fault:
            self._disturb()

    def _probe(self) -> None:
        """Announce a scene if none is waiting, so that a run can follow."""
        client = self._clients["scene_layer/analyze"]
        if not self._waiting() and client.service_is_ready():
            future = client.call_async(self._scene())
            future.add_done_callback(lambda done: self._take_scene(done.result()))

    def _until(self, condition: Callable[[], Any], what: str) -> None:
        """Spin until a condition holds; record a failure if it takes too long."""
        end = self.now() + READY_S
        while not condition():
            if self.now() > end:
                self._note(Failed, component="system", text=f"not in {READY_S:g} s: {what}")
                return
            self.turn()

    def rest(self, seconds: float) -> None:
        end = self.now() + seconds
        while self.now() < end:
            self.turn()

    def _take_lines(self) -> None:
        new = (("up", self._up.new_lines()), (OTHER_HOST, self._supervisor.poll()))
        for name, lines in new:
            for line in lines:
                own = "killed by signal 9" in line
                if (" ended (" in line or "hangs (no" in line or "exit code" in line) and not own:
                    component = line.split()[0] if name == "up" else name
                    text = line.strip()
                    self._note(Failed, component=component, text=text)

    def pids(self) -> dict[str, int]:
        """Return component → process id of the living ones."""
        found = {}
        for parent, other in ((self._up.process.pid, ""), (os.getpid(), OTHER_HOST)):
            for module, pid in nodes(parent):
                component = MODULES.get(module)
                if component == "agents" or (component and not other):
                    found[other or component] = pid
        now = self.now()
        for component, pid in found.items():
            if self._since.get(component, (0, 0.0))[0] != pid:
                self._since[component] = (pid, now)
        return found

    def _measure(self) -> None:
        at = self.now()
        for component, pid in {**self.pids(), "up": self._up.process.pid}.items():
            with suppress(OSError, ValueError):
                statm = Path(f"/proc/{pid}/statm").read_text().split()
                threads = len(list(Path(f"/proc/{pid}/task").iterdir()))
                descriptors = len(list(Path(f"/proc/{pid}/fd").iterdir()))
                memory_mb = int(statm[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
                self._note(
                    Measured,
                    at=at,
                    component=component,
                    pid=pid,
                    memory_mb=memory_mb,
                    descriptors=descriptors,
                    threads=threads,
                )
        files = sum(1 for one in (self.folder / "state").rglob("*") if one.is_file())
        self._note(FilesCounted, at=at, files=files)

    # Faults

    def _disturb(self) -> None:
        pids = self.pids()
        now = self.now()
        ready = [one for one in pids if now - self._since[one][1] >= STEADY_S]
        if not ready:
            self._next_fault = now + 1.0
            return
        kind = self._chance.choices(("killed", "hung", "flooded"), (55, 30, 15))[0]
        number = 2 if kind == "killed" and self._chance.random() < 0.25 else 1
        chosen = self._chance.sample(ready, min(number, len(ready)))
        is_unread = self._chance.random() < UNREAD_SHARE
        if kind == "killed" and self._chance.random() < TRAP_SHARE:
            self._trap, self._trap_until = chosen[0], now + TRAP_S
        else:
            for component in chosen:
                getattr(self, f"_{kind}")(component, pids[component])
        if is_unread:
            self._leave_unread()

    def _spring(self, component: str) -> None:
        """Kill a component just after it has answered or announced something."""
        if self._trap == component:
            self._trap = ""
            pid = self.pids().get(component)
            if pid is not None:
                self._killed(component, pid)

    def _pend(self, component: str, kind: str, over: float) -> None:
        fault = Fault(at=self.now(), component=component, kind=kind, over=over)
        self.events.append(fault)
        self._pending.append((fault, cpu_times()))

    def _killed(self, component: str, pid: int) -> None:
        self._pend(component, "killed", self.now())
        os.kill(pid, signal.SIGKILL)
        self._note_end(component)

    def _note_end(self, component: str) -> None:
        """Record the ends that the death of a component implies."""
        if component == "robot":
            self._robot_goals.end(self.now())
        elif component == "scene_layer":
            self._scene_layer_killed = self.now()

    def _kill_everything(self) -> None:
        self._pend(EVERYTHING, "killed", self.now())
        for component, pid in self.pids().items():
            os.kill(pid, signal.SIGKILL)
            self._note_end(component)

    def _hung(self, component: str, pid: int) -> None:
        lasts = self._chance.uniform(0.5, 3.0)
        self._pend(component, "hung", self.now() + lasts)
        os.kill(pid, signal.SIGSTOP)
        self._stopped.add(pid)
        self._due.append((self.now() + lasts, partial(self._go_on, pid)))

    def _leave_unread(self) -> None:
        """Leave the output of ``up`` unread for a while, which must disturb nothing.

        An act may have to wait until another fault of this moment is over.
        """
        self._pend("up", "unread", max([self.now(), *(fault.over for fault, _ in self._pending)]))
        self._up.leave_unread()
        self._due.append((self.now() + self._chance.uniform(5.0, 20.0), self._up.read_on))

    def _go_on(self, pid: int) -> None:
        self._stopped.discard(pid)
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

    def _flooded(self, component: str, _pid: int) -> None:
        if component in ("feedback", "scene_layer", "agents", OTHER_HOST):
            name, request = {
                "feedback": (
                    "feedback/give",
                    GiveFeedback.Request(agent="nobody", values=[1.0] * 500),
                ),
                "scene_layer": ("scene_layer/analyze", Analyze.Request(names=["x"] * 500)),
            }.get(component, (f"{component}/tune", Tune.Request(names=["x.y"] * 500)))
            self._pend(component, "flooded", self.now())
            for _ in range(300):
                self._clients[name].call_async(request)
            return
        kind = self._chance.choice(FLOODS)
        self._pend("marketplace", "flooded", self.now() + FLOODED_S)
        flood = subprocess.Popen(
            [sys.executable, str(FLOODER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        assert flood.stdin is not None
        flood.stdin.write(f"{kind}, marketplace, {FLOOD_S}\n".encode())
        flood.stdin.close()
        self._floods.append(flood)
        self._due.append((self.now() + FLOODED_S, flood.kill))

    # Operation

    def ask(
        self, service: str, request: Any, then: Callable[[Any], None] | None = None
    ) -> Any | None:
        """Call a service; return the answer, or None without one.

        ``then`` receives the answer when it comes, even if nobody waits for it any more.
        """
        client = self._clients[service]
        end = self.now() + ANSWER_S
        while not client.service_is_ready():
            if self.now() > end:
                return None
            self.turn()
        future = client.call_async(request)
        if then is not None:
            future.add_done_callback(lambda done: then(done.result()))
        owner = service.partition("/")[0]
        future.add_done_callback(lambda _done: self._spring(owner))
        while not future.done():
            if self.now() > end:
                return None
            self.turn()
        return future.result()

    def operate(self) -> None:
        """Do one random operation of an operator."""
        weights = {
            "scene": 40,
            "cancel": 5,
            "feedback": 12,
            "undo": 4,
            "tune": 10,
            "preset": 4,
            "pin": 4,
            "veto": 4,
            "award": 4,
            "reload": 4,
            "preview": 5,
            "look": 8,
        }
        waiting = len(self._waiting())
        action = self._chance.choices(list(weights), list(weights.values()))[0]
        if waiting == 0 or (self._pending and self._chance.random() < 0.5):
            action = "scene" if waiting < 6 else "look"
        self.done[action] = self.done.get(action, 0) + 1
        getattr(self, f"do_{action}")()

    def _acknowledged(self) -> set[str]:
        return {one.scene for one in self.events if isinstance(one, SceneAcknowledged)}

    def _waiting(self) -> set[str]:
        """Return the scenes that may still end; see :func:`died_unsent`."""
        died = {
            scene
            for scene, at in self._not_shown.items()
            if died_unsent(at, [self._scene_layer_killed])
        }
        return self._acknowledged() - self._ended - died

    def do_scene(self) -> None:
        for _ in range(self._chance.choice([1, 1, 1, 1, 4])):
            asked_at = self.now()
            answer = self.ask("scene_layer/analyze", self._scene(), self._take_scene)
            self._scene_requests.append((asked_at, self.now()))
            if answer is None:
                break

    def _scene(self) -> Any:
        return Analyze.Request(
            names=["age", "familiarity", "mood"],
            values=[self._chance.uniform(1.0, 5.0), 3.0, 3.0],
            person=Analyze.Request.PRESENT,
            urgent=self._chance.random() < 0.15,
            announce=True,
        )

    def _take_scene(self, answer: Any) -> None:
        if answer.accepted:
            scene = answer.scene.scene_id
            self._note(SceneAcknowledged, scene=scene)
            if scene not in self._ended:
                self._not_shown[scene] = self.now()

    def do_cancel(self) -> None:
        # Only some cancels also drop the scenes in line.
        number = 0 if self._chance.random() < 0.2 else self._market.round
        request = CancelRun.Request(reason="soak", by=Run.OPERATOR, round=number)
        self.ask("marketplace/cancel", request)

    def do_feedback(self) -> None:
        self._numbers += 1
        feedback = f"soak-{self._numbers}"
        kind = self._chance.choice([Feedback.DIRECT, Feedback.POSITIVE, Feedback.NEGATIVE])
        request = GiveFeedback.Request(
            feedback_id=feedback, agent=self._chance.choice(list(AGENTS)), kind=kind, source="soak"
        )
        if kind == Feedback.DIRECT:
            request.values = [self._chance.uniform(1.0, 5.0) for _ in range(3)]

        def take(answer: Any) -> None:
            if answer.accepted:
                self._note(FeedbackAcknowledged, feedback=feedback)

        self.ask("feedback/give", request, take)

    def do_undo(self) -> None:
        agent = self._chance.choice(list(AGENTS))
        undo = ManageProfiles.Request(action=ManageProfiles.Request.UNDO, agent=agent)
        self.ask("feedback/manage", undo)

    def _set(self, name: str, value: object, *, acknowledged: bool) -> None:
        self._asked[name] = self.now()
        self._values[name] = value if acknowledged else None
        self._note(SettingRequested, name=name, value=value, acknowledged=acknowledged)

    def do_tune(self) -> None:
        agent = self._chance.choice(list(AGENTS))
        value = round(self._chance.uniform(0.1, 0.6), 2)
        name = f"{agent}.pause"
        request = Tune.Request(action=Tune.Request.SET, names=[name], values=[f"{value} s"])
        answer = self.ask(f"{AGENTS[agent][0]}/tune", request)
        if answer is None or answer.accepted:
            self._set(name, value, acknowledged=answer is not None)

    def do_preset(self) -> None:
        """Save the value of an agent, or restore a saved one."""
        agent = self._chance.choice(list(AGENTS))
        name, service = f"{agent}.pause", f"{AGENTS[agent][0]}/tune"
        value, saved = self._values.get(name), self._presets.get(agent)
        if saved is None and value is not None:
            request = Tune.Request(action=Tune.Request.SAVE, preset=agent, agents=[agent])
            answer = self.ask(service, request)
            if answer is not None and answer.accepted:
                self._presets[agent] = value
            return
        if saved is None:
            return
        answer = self.ask(service, Tune.Request(action=Tune.Request.APPLY, preset=agent))
        if answer is None or answer.accepted:
            self._set(name, saved, acknowledged=answer is not None)
        elif answer.code == "UNKNOWN_PRESET":
            self._set(f"preset of {agent}", saved, acknowledged=True)
            self._read(f"preset of {agent}", answer.code)

    def _order(self, action: int, agent: str) -> bool:
        order = OperateMarket.Request
        answer = self.ask("marketplace/operate", order(action=action, agent=agent, author="soak"))
        name = "pinned" if action <= order.UNPIN else f"veto of {agent}"
        value = {order.PIN: agent, order.UNPIN: "", order.VETO: True, order.ALLOW: False}[action]
        if answer is None or answer.accepted:
            self._set(name, value, acknowledged=answer is not None)
        return answer is not None

    def _order_for_a_while(self, do: int, undo: int) -> None:
        agent = self._chance.choice(list(AGENTS))
        self._order(do, agent)
        self.rest(self._chance.uniform(0.0, 2.0))
        self.do_look()
        for _ in range(10):
            if self._order(undo, agent):
                break

    def do_pin(self) -> None:
        self._order_for_a_while(OperateMarket.Request.PIN, OperateMarket.Request.UNPIN)

    def do_veto(self) -> None:
        self._order_for_a_while(OperateMarket.Request.VETO, OperateMarket.Request.ALLOW)

    def do_award(self) -> None:
        agent = self._chance.choice(list(AGENTS))
        award = OperateMarket.Request(action=OperateMarket.Request.AWARD, agent=agent)
        self.ask("marketplace/operate", award)

    def do_reload(self) -> None:
        name = self._chance.choice(list(AGENTS))
        host, age = AGENTS[name]
        self._write_agent(name, age, f"hello {self._chance.randrange(1000)}")
        self.ask(f"{host}/reload", ReloadAgents.Request())

    def do_preview(self) -> None:
        self.ask("marketplace/preview", PreviewAuction.Request())

    def do_look(self) -> None:
        """Read all settings that were requested before."""
        for host in HOSTS:
            own = [f"{agent}.pause" for agent, (of, _) in AGENTS.items() if of == host]
            names = [name for name in own if name in self._asked]
            if names:
                answer = self.ask(f"{host}/get_parameters", GetParameters.Request(names=names))
                if answer is not None and len(answer.values) == len(names):
                    for name, value in zip(names, answer.values, strict=True):
                        self._read(name, round(value.double_value, 2))
        now = self.now()
        asked = max((at for name, at in self._asked.items() if "." not in name), default=now)
        market = self._market
        down = "marketplace" not in self.pids()
        if down or now - max(asked, self._market_since) < SETTLED_S:
            return
        self._read("pinned", market.pinned)
        for agent in AGENTS:
            self._read(f"veto of {agent}", agent in market.vetoed)

    def _read(self, name: str, value: object) -> None:
        self._note(SettingRead, name=name, value=value)

    # The whole

    def run(self, minutes: float, tell: Callable[[str], None]) -> None:
        """Operate and disturb the system for a while, then let it come to rest."""
        self._faults = True
        end, told = self.now() + 60.0 * minutes, self.now()
        self._next_fault = self.now() + 3.0
        while self.now() < end:
            self.operate()
            self.rest(self._chance.uniform(0.0, 0.4))
            if self.now() - told > 60.0:
                told = self.now()
                tell(self.progress())
        self._faults, self._trap = False, ""
        self._until(lambda: not (self._pending or self._stopped), "the last fault is over")
        tell("killing everything once more")
        self._kill_everything()
        self._until(lambda: len(self.pids()) == len(COMPONENTS), "everything is started again")
        self._until(lambda: self._market.agents == len(AGENTS), "all agents are back")
        self._until(self._served, "a scene is served")
        end = self.now() + READY_S
        while self._waiting() and self.now() < end:
            self.turn()
        self.rest(SETTLED_S)
        self.do_look()

    def _served(self) -> bool:
        if not self._waiting():
            self.do_scene()
        return not self._pending

    def progress(self) -> str:
        """Return the progress on one line."""
        faults = sum(isinstance(one, Fault) for one in self.events)
        scenes = len(self._acknowledged())
        # Ends and stored feedback can be judged only after the soak.
        broken = sum(
            len(verdict.breaches)
            for verdict in check(self._all())
            if verdict.promise not in (ONE_END, FEEDBACK_STORED)
        )
        return f"{self.now() / 60:4.1f} min: {scenes} scenes, {faults} faults, {broken} breaches"

    def _all(self) -> list[Event]:
        """Return all events, including the acts of the robot."""
        acts = [
            Acted(at=goal.at, until=goal.until, run=self._runs[goal_id], what=action)
            for (action, goal_id), goal in self._robot_goals.all.items()
            if goal_id in self._runs
        ]
        return [*self.events, *acts]

    def close(self) -> list[Event]:
        """End everything; return all events."""
        for pid in list(self._stopped):
            self._go_on(pid)
        for flood in self._floods:
            flood.kill()
            flood.wait()
        at = self.now()
        self._up.read_on()
        try:
            if self._up.process.poll() is None:
                code, _ = self._up.stop()
                if code != 0:
                    self._note(Failed, at=at, component="up", text=f"exit code {code}")
        finally:
            self._up.kill()
            self._supervisor.stop()
            self._node.destroy_node()
            self._executor.shutdown()
            rclpy.try_shutdown()
            (self.folder / "up.log").write_text(self._up.output)
        self._read_ledger(at)
        self._replay_journal(at)
        for log in sorted(self.folder.rglob("*.log*")):
            text = log.read_text(errors="replace")
            for trace in TRACES:
                if trace in text:
                    found = f"'{trace}' in {log.relative_to(self.folder)}"
                    self._note(Failed, at=at, component=log.stem, text=found)
        events = self._all()
        with (self.folder / "events.jsonl").open("w") as file:
            for one in sorted(events, key=lambda one: one.at):
                kept = asdict(one) | {"event": type(one).__name__}
                file.write(json.dumps(kept, default=list) + "\n")
        return events

    def _read_ledger(self, at: float) -> None:
        ledger = self.folder / "state" / "ledger.sqlite"
        with closing(sqlite3.connect(f"file:{ledger}?mode=ro", uri=True)) as db:
            rows = db.execute("SELECT feedback_id FROM revision WHERE feedback_id IS NOT NULL")
            self._note(LedgerRead, at=at, feedback=frozenset(row[0] for row in rows))

    def _replay_journal(self, at: float) -> None:
        """Record how the journal replays; it has gaps where its process was dead."""
        recording = read(newest_files(self.folder / "journal"))
        for findings in (replay_decisions(recording.rounds), replay_feedback(recording.feedbacks)):
            for one in findings:
                if one.verdict is not ReplayVerdict.NOT_RECORDED:
                    self._note(Replayed, at=at, item=one.where, difference=one.text)


def table(verdicts: list[Verdict]) -> Iterator[str]:
    """Return the lines of the promises: how often each was checked and broken."""
    yield f"{'promise':<62}{'checked':>9}{'broken':>8}"
    for verdict in verdicts:
        yield f"{verdict.promise:<62}{verdict.checked:>9}{len(verdict.breaches):>8}"


def recovery_table(events: list[Event]) -> Iterator[str]:
    """Return the lines of the times without an act after a fault, by fault."""
    kinds: dict[str, list[Served]] = {}
    for one in events:
        if isinstance(one, Served):
            kinds.setdefault(f"{one.fault.component} {one.fault.kind}", []).append(one)
            kinds.setdefault("all", []).append(one)
    head = f"{'nobody acts after':<24}{'faults':>8}{'median':>10}{'worst':>9}"
    yield head + "   of these with time to spare"
    for name, found in sorted(kinds.items(), key=lambda kind: (kind[0] == "all", kind[0])):
        times = [one.silence_s for one in found]
        calm = [one.silence_s for one in found if not one.overloaded]
        rest = f"{statistics.median(calm):>8.1f} s{max(calm):>7.1f} s" if calm else ""
        line = f"{name:<24}{len(found):>8}{statistics.median(times):>8.1f} s{max(times):>7.1f} s"
        yield f"{line}{len(calm):>8}{rest}"


def growth_table(events: list[Event]) -> Iterator[str]:
    """Return the lines of the strongest growth of each component."""
    by_component: dict[str, list[Any]] = {}
    for growth in growths(events):
        by_component.setdefault(growth.component, []).append(growth)
    head = f"{'growth a minute':<18}{'lives':>7}{'longest':>11}"
    yield head + f"{'MB':>10}{'descriptors':>14}{'threads':>10}"
    for component, found in sorted(by_component.items()):
        worst = [max(one.per_minute[name] for one in found) for name in MOST_PER_MINUTE]
        longest = max(one.until - one.since for one in found)
        yield (
            f"{component:<18}{len(found):>7}{longest:>9.0f} s"
            f"{worst[0]:>10.2f}{worst[1]:>14.2f}{worst[2]:>10.2f}"
        )


@click.command()
@click.argument("minutes", type=click.FloatRange(min=0.1), default=10.0)
@click.option("--seed", default=1, show_default=True, help="Of all that is left to chance.")
@click.option("--any-time", is_flag=True, help="Recovery may take any time, as beside other work.")
@click.option("--logs", default="", help="Folder for logs and events, instead of a new one.")
def main(minutes: float, seed: int, any_time: bool, logs: str) -> None:
    """Operate a whole system for MINUTES while its processes are killed, hung and flooded."""
    set_discovery(os.environ)
    os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    # A shell starts background processes with SIGINT ignored.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    folder = Path(logs).resolve() if logs else Path(tempfile.mkdtemp(prefix="bt-agents-soak-"))
    folder.mkdir(parents=True, exist_ok=True)
    click.echo(f"seed {seed}, {minutes:g} minutes; logs in {folder}")
    running = Soak(folder, seed)
    try:
        running.start()
        running.run(minutes, click.echo)
    finally:
        events = running.close()
    verdicts = check(events)
    for lines in (table(verdicts), recovery_table(events), growth_table(events)):
        click.echo("\n" + "\n".join(lines))
    done = ", ".join(f"{name} {count}" for name, count in sorted(running.done.items()))
    click.echo(f"\ndone: {done}")
    for verdict in verdicts:
        for breach in verdict.breaches:
            text = f"{breach.promise}: {breach.text}"
            click.echo(f"broken at {breach.at:.1f} s (seed {seed}): {text}")
    judged = [one for one in verdicts if not (any_time and one.promise == RECOVERY)]
    raise SystemExit(int(any(verdict.breaches for verdict in judged)))


if __name__ == "__main__":
    main()
