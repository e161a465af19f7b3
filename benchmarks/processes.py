# SPDX-License-Identifier: Apache-2.0
"""Node processes on ROS domains of their own, and a probe in this process."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from bare import executor
from bt_agents_ros.node_main import READY, SUPERVISED
from bt_agents_tools.launcher.domain_lock import reserve_domain
from bt_agents_tools.launcher.supervisor import Component, set_discovery

HERE = Path(__file__).parent

LIMIT_S = 60.0
"""Time limit of every wait [s]."""

_TURN_S = 0.05
_END_S = 3.0
_CPU_CLOCK = 2
"""Bits in the id of another process's clock that select its CPU time."""

SKILLS = """\
format: 1
skills:
  say:
    description: Speak a text.
    main: text
    inputs: {text: {type: text, description: what to say}}
    action: {name: say, type: bt_agents_interfaces/action/Say, goal: {text: "${text}"}}
"""


class Running:
    """A started process.

    Args:
        command: Its command line.
        environment: Its environment.
        log: File of its output.

    Attributes:
        name: Name in messages.
    """

    def __init__(
        self, name: str, command: list[str], environment: Mapping[str, str], log: Path
    ) -> None:
        self.name = name
        self._log = log
        self._ready, says_ready = os.pipe()
        os.set_blocking(self._ready, False)
        self._is_up = False
        with log.open("wb") as file:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=file,
                stderr=subprocess.STDOUT,
                env={
                    **environment,
                    SUPERVISED: str(os.getpid()),
                    READY: str(says_ready),
                    "PYTHONUNBUFFERED": "1",
                },
                pass_fds=(says_ready,),
            )
        os.close(says_ready)

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    @property
    def is_up(self) -> bool:
        """Whether it has reported that its nodes exist.

        Raises:
            RuntimeError: It has ended; the message ends with its last output.
        """
        if self._process.poll() is not None:
            raise RuntimeError(f"{self.name} ended by itself:\n{self.said[-3000:]}")
        if not self._is_up:
            with suppress(BlockingIOError):
                self._is_up = bool(os.read(self._ready, 8))
        return self._is_up

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process; None while it lives."""
        return self._process.poll()

    @property
    def cpu_s(self) -> float:
        """CPU time [s]."""
        return time.clock_gettime((~self.pid << 3) | _CPU_CLOCK)

    @property
    def resident_mb(self) -> float:
        """Memory in RAM [MB]."""
        statm = Path(f"/proc/{self.pid}/statm").read_text(encoding="ascii")
        return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    @property
    def proportional_mib(self) -> float:
        """Memory in RAM, with its share of shared memory [MiB]."""
        rollup = Path(f"/proc/{self.pid}/smaps_rollup").read_text(encoding="ascii")
        (line,) = (line for line in rollup.splitlines() if line.startswith("Pss:"))
        return int(line.split()[1]) / 1024

    @property
    def said(self) -> str:
        """Its whole output."""
        return self._log.read_text(errors="replace")

    def tell(self, line: str) -> None:
        """Write a line to its input."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())
        self._process.stdin.flush()

    def kill(self) -> None:
        """Kill it, as in a crash; do nothing if it has ended."""
        self._process.kill()
        self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()
        if self._ready >= 0:
            os.close(self._ready)
            self._ready = -1

    def end(self) -> None:
        """End it cleanly, or kill it if that takes too long."""
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        self.kill()


class Graph:
    """A ROS graph of processes on a domain of its own, with a probe in this process.

    Discovery and transport are the same as under ``bt-agents up``. Several graphs may exist at the
    same time, isolated from each other.

    Args:
        name: Name in messages.

    Attributes:
        context: Context of all nodes in this process.
        probe: A bare node in this process; spun during waits.
        folder: For trees, logs and a ledger; removed at the end.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.folder = Path(tempfile.mkdtemp(prefix=f"bt-agents-{name}-"))
        self._running: list[Running] = []
        set_discovery(os.environ)  # the probe reads the same settings as the processes
        domain = reserve_domain()
        self._environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        self.context = Context()
        rclpy.init(
            context=self.context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO
        )
        self._executor = executor(self.context)
        self.probe = Node("probe", context=self.context, enable_rosout=False)
        self._executor.add_node(self.probe)

    def start(self, component: Component, node: str = "") -> Running:
        """Start one of our nodes, optionally under another name, or several in one process."""
        name = node or component.name
        # All nodes in one process would get the name.
        remapping = [] if component.parts else ["-r", f"__node:={name}"]
        return self._start(name, [*component.command(), *remapping])

    def bare(self, program: str, *arguments: object) -> Running:
        """Start a program of this folder."""
        return self._run([sys.executable, str(HERE / program)], program, *arguments)

    def command(self, program: str, *arguments: object) -> Running:
        """Start a program of our installation."""
        return self._run([str(Path(sys.executable).parent / program)], program, *arguments)

    def _run(self, command: list[str], program: str, *arguments: object) -> Running:
        words = [str(argument) for argument in arguments]
        return self._start(" ".join([program, *words]), [*command, *words])

    def _start(self, name: str, command: list[str]) -> Running:
        log = self.folder / f"{len(self._running)}.log"
        self._running.append(Running(name, command, self._environment, log))
        return self._running[-1]

    def turn(self, timeout_s: float = _TURN_S) -> None:
        """Spin the nodes of this process once, waiting for work up to a time limit [s]."""
        self._executor.spin_once(timeout_sec=timeout_s)

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Spin the nodes of this process until a condition holds.

        Args:
            condition: Checked after each piece of work.
            what: Description of the condition.

        Raises:
            RuntimeError: It takes too long, or a process has ended.
        """
        end = time.monotonic() + LIMIT_S
        while not condition():
            if time.monotonic() > end:
                words = "\n".join(f"--- {one.name}\n{one.said[-2000:]}" for one in self._running)
                raise RuntimeError(f"{self.name}: not within {LIMIT_S:g} s: {what}\n{words}")
            self.turn()

    def until_up(self) -> None:
        """Wait until every process has reported that its nodes exist."""
        self.until(lambda: all(one.is_up for one in self._running), "all processes are up")

    def until_matched(self, *endpoints: Any, count: int = 1) -> None:
        """Wait until endpoints of the probe have this many partners."""
        for endpoint in endpoints:
            self.until(lambda of=endpoint: _partners(of) >= count, f"a partner of {endpoint}")

    def rest(self, seconds: float) -> None:
        """Spin for a time [s], for example between two cold requests."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.turn(left)

    def close(self) -> None:
        """End all processes, then the nodes of this one."""
        try:
            for one in self._running:
                one.kill()
        finally:
            self._executor.shutdown(timeout_sec=1.0)
            self.probe.destroy_node()
            self.context.try_shutdown()
            shutil.rmtree(self.folder, ignore_errors=True)


def _partners(endpoint: Any) -> int:
    for count in ("get_subscription_count", "get_publisher_count"):
        if hasattr(endpoint, count):
            return int(getattr(endpoint, count)())
    ready = getattr(endpoint, "service_is_ready", None) or endpoint.server_is_ready
    return int(ready())


@contextmanager
def graphs() -> Iterator[Callable[[str], Graph]]:
    """Yield a function that makes graphs; end all of them afterwards, even after an exception."""
    with ExitStack() as stack:

        def make(name: str) -> Graph:
            graph = Graph(name)
            stack.callback(graph.close)
            return graph

        yield make


def write_trees(folder: Path, agents: Mapping[str, str]) -> Path:
    """Make a trees folder of agents with profiles that differ; return it.

    Args:
        folder: Created by this function.
        agents: Name → tree, as JSON or on lines indented by two spaces.
    """
    (folder / "agents").mkdir(parents=True)
    (folder / "skills").mkdir()
    shutil.copy(HERE.parent / "trees" / "scene.yaml", folder)
    (folder / "skills" / "voice.yaml").write_text(SKILLS, encoding="utf-8")
    for index, (name, tree) in enumerate(agents.items()):
        profile = {"age": 1 + index % 997 * 4 / 997, "familiarity": 3.0, "mood": 3.0}
        (folder / "agents" / f"{name}.yaml").write_text(
            f"format: 1\nagent: {name}\ntitle: {name}\ndescription: d\n"
            f"profile: {json.dumps(profile)}\ntree: {tree}\n",
            encoding="utf-8",
        )
    return folder
