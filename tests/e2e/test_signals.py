# SPDX-License-Identifier: Apache-2.0
"""Every node ends cleanly at any time, on a busy machine."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest

from bt_agents_interfaces.msg import MarketStatus, Run, Scene
from bt_agents_ros import qos
from bt_agents_ros.messages import scene_to_msg
from bt_agents_ros.signals import sigint_blocked
from bt_agents_tools.launcher import components as system
from bt_agents_tools.launcher.fork_server import ForkedProcess, ForkServer
from bt_agents_tools.launcher.log_files import LogFile
from bt_agents_tools.launcher.supervisor import STOP_LIMIT_S, Component, spawn
from graph import Ros, fresh_graph
from processes import write_trees
from programs import HANG_S
from tree_harness import TREES, scene

pytestmark = pytest.mark.e2e

LIMIT_S = STOP_LIMIT_S
"""Longest time from the signal to the end; after that, a supervisor would kill it [s]."""

LATEST_S = 1.5
"""Longest time from the start, or from the start of a run, to the signal [s]."""

EARLY = 12
"""Starts of each of the six kinds, with a signal before or during start-up."""

TIMES = int(os.environ.get("BT_AGENTS_SIGNALS", "1"))
"""Factor for a longer run by hand; 42 starts each kind 500 times."""

RUNNING = 4
"""Starts of a system of seven, with a signal during a run: 12 * 6 + 4 * 7 = 100."""

SPEAKER = """
repeat: 1000
sequence:
  - say: One more word.
  - wait: 0.2 s
"""


@dataclass(eq=False)
class Told:
    """A process, its signal, and its end.

    Attributes:
        due: When to send the signal, on the steady clock [s].
        sent: When the signal was sent; None before.
        ended: When its end was noticed; None before.
    """

    component: Component
    log: LogFile
    number: signal.Signals
    fork_server: ForkServer | None = None
    process: subprocess.Popen[bytes] | ForkedProcess = field(init=False)
    ready: int = field(init=False)
    due: float = 0.0
    sent: float | None = None
    ended: float | None = None

    def __post_init__(self) -> None:
        self.process, self.ready = spawn(self.component, self.log, 1, self.fork_server)

    def look(self, now: float) -> None:
        """Send the signal when it is due; record the end."""
        if self.ended is None and self.process.poll() is not None:
            self.ended = now
        elif self.sent is None and now >= self.due:
            self.process.send_signal(self.number)
            self.sent = time.monotonic()

    def problem(self) -> str:
        """Return the fault in its end; empty if it was clean."""
        if self.ended is None:
            # Python's fault handler writes the stacks of all threads into the log. It crashes if
            # the main thread continues meanwhile, so that thread gets the signal.
            pid = self.process.pid
            ctypes.CDLL(None).tgkill(pid, pid, signal.SIGABRT)
            self.process.wait(HANG_S)
            said = self.log.path.read_text(errors="replace")
            return f"{self.component.name}, {self.number.name}: has not ended; it was in\n{said}"
        said = self.log.path.read_text(errors="replace")
        code = self.process.returncode
        up = bool(os.read(self.ready, 8))
        allowed = (0,) if up else (0, 130, -signal.SIGINT, -signal.SIGTERM)
        problems = [word for word in ("Traceback", "KeyboardInterrupt", "Fatal") if word in said]
        if self.sent is None:
            problems.append("ended before it was told to")
        elif self.ended - self.sent > LIMIT_S:
            problems.append(f"took longer than {LIMIT_S:g} s")
        if code not in allowed:
            problems.append(f"exit code {code}, {'up' if up else 'not yet up'}")
        if not problems:
            return ""
        took = self.ended - (self.sent or self.ended)
        return (
            f"{self.component.name}, {self.number.name}, {took:.2f} s: "
            f"{', '.join(problems)}\n{said}"
        )

    def close(self) -> None:
        """Kill the process if it still runs."""
        self.process.kill()
        self.process.wait()
        os.close(self.ready)


@pytest.fixture
def busy() -> Iterator[None]:
    """A process that uses all available CPU time, alongside six that start at once."""
    burner = subprocess.Popen([sys.executable, "-c", "while True: pass"], stdin=subprocess.DEVNULL)
    try:
        yield
    finally:
        burner.kill()
        burner.wait()


@contextmanager
def running(
    components: list[Component], folder: Path, random: Random, fork_server: ForkServer
) -> Iterator[list[Told]]:
    """Start processes, half of them forked; kill those that still run at the end."""
    told = [
        Told(
            component,
            LogFile(folder / f"{number}-{component.name}.log"),
            random.choice([signal.SIGINT, signal.SIGTERM]),
            random.choice([fork_server, None]),
        )
        for number, component in enumerate(components)
    ]
    try:
        yield told
    finally:
        for one in told:
            one.close()


def watch(told: list[Told], random: Random, turn: Callable[[], None]) -> list[str]:
    """Signal each process at its own time and wait for all ends; return the faults."""
    now = time.monotonic()
    for one in told:
        one.due = now + random.uniform(0.0, LATEST_S)
    end = now + LATEST_S + HANG_S
    while any(one.ended is None for one in told) and time.monotonic() < end:
        turn()
        for one in told:
            one.look(time.monotonic())
    return [problem for one in told if (problem := one.problem())]


def everything(trees: Path, folder: Path) -> list[Component]:
    script = TREES / "scripts" / "airport_morning.yaml"
    return [
        system.market(trees),
        system.scene_layer(trees),
        system.host(trees),
        system.feedback(trees, ledger=str(folder / "ledger.sqlite")),
        system.robot("off"),
        system.visitors(TREES, script),
    ]


@pytest.mark.usefixtures("busy")
def test_hundred_randomly_timed_signals_end_node_cleanly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setenv("PYTHONFAULTHANDLER", "1")
    random = Random(20260518)
    trees = write_trees(tmp_path / "trees", speaker=(3.0, SPEAKER))
    fork_server = ForkServer(one.module for one in everything(trees, tmp_path))
    request.addfinalizer(fork_server.close)
    problems: list[str] = []
    count = 0
    for batch in range(EARLY * TIMES):
        folder = tmp_path / f"early{batch}"
        folder.mkdir()
        components = everything(TREES, folder)
        if batch % 2:  # nothing publishes the simulated time
            components = [
                replace(one, parameters={**one.parameters, "use_sim_time": True})
                for one in components
            ]
        with running(components, folder, random, fork_server) as told:
            count += len(told)
            problems += watch(told, random, lambda: time.sleep(0.005))
    for batch in range(RUNNING):
        folder = tmp_path / f"running{batch}"
        folder.mkdir()
        components = [*everything(trees, folder), system.host(TREES)]
        with fresh_graph() as ros, running(components, folder, random, fork_server) as told:
            count += len(told)
            problems += in_a_run(ros, told, random)
    assert count == 100 + (TIMES - 1) * EARLY * len(everything(TREES, tmp_path))
    assert not problems, "\n".join([f"{len(problems)} of {count}", *problems])


COMMANDS = (
    ("up", "--no-voice", "--no-studio"),
    ("status",),
    ("trigger", "age=3"),
    ("check", str(TREES)),
    ("explain", "timeout"),
    ("--help",),
)
"""All kinds of loading."""


@pytest.mark.usefixtures("busy")
def test_ctrl_c_at_any_moment_prints_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    random = Random(7)
    problems = []
    for batch in range(8):
        outputs = [tmp_path / f"{batch}-{command[0]}" for command in COMMANDS]
        started = [
            started_silently(command, output)
            for command, output in zip(COMMANDS, outputs, strict=True)
        ]
        try:
            now = time.monotonic()
            due = {process: now + random.uniform(0.0, LATEST_S) for process in started}
            for process in sorted(started, key=due.__getitem__):
                time.sleep(max(0.0, due[process] - time.monotonic()))
                process.send_signal(signal.SIGINT)
            end = time.monotonic() + HANG_S
            while any(process.poll() is None for process in started):
                assert time.monotonic() < end
                time.sleep(0.01)
        finally:
            for process in started:
                process.kill()
                process.wait()
        for process, output in zip(started, outputs, strict=True):
            said = output.read_text()
            if process.returncode not in (0, 1, 130, -signal.SIGINT) or "Traceback" in said:
                problems.append(f"{output.name} {process.returncode}\n{said}")
    assert not problems, "\n".join(problems)


def started_silently(command: tuple[str, ...], output: Path) -> subprocess.Popen[bytes]:
    """Start a command that ignores Ctrl-C before its first line, which Python would handle."""
    with sigint_blocked(), output.open("wb") as file:
        return subprocess.Popen(
            [sys.executable, "-m", "bt_agents_tools.cli", *command],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def in_a_run(ros: Ros, told: list[Told], random: Random) -> list[str]:
    """Signal all processes once an agent runs."""
    runs = ros.collect(Run, "bt_agents/runs", qos.HISTORY)
    statuses: list[Any] = ros.collect(MarketStatus, "bt_agents/market", qos.FACT)
    scenes = ros.node.create_publisher(Scene, "bt_agents/scene", qos.EVENTS)
    ros.until(lambda: statuses and statuses[-1].agents > 0 and scenes.get_subscription_count())
    scenes.publish(scene_to_msg(scene("s1", age=3, familiarity=3, mood=3)))
    ros.until(lambda: any(run.event == Run.STARTED for run in runs))
    return watch(told, random, lambda: ros.executor.spin_once(timeout_sec=0.005))
