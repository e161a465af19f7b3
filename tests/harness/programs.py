# SPDX-License-Identifier: Apache-2.0
"""Processes of the command line, whose output a test waits for."""

from __future__ import annotations

import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HANG_S = 60.0


BT_AGENTS = ("-m", "bt_agents_tools.cli")


def environment_of(state: Path) -> dict[str, str]:
    """Return the environment of programs with a state folder of their own."""
    own = {"XDG_STATE_HOME": str(state), "PYTHONUNBUFFERED": "1", "COLUMNS": "120"}
    return {**os.environ, **own}


class Program:
    """One ``bt-agents`` process, whose output a test waits for.

    Args:
        arguments: Arguments of the program.
        environment: Its whole environment.
        folder: Working directory.
        before: Command that executes the program, such as ``nsenter``.
        program: Another Python program.
    """

    def __init__(
        self,
        arguments: tuple[str, ...],
        environment: dict[str, str],
        folder: Path = ROOT,
        *,
        before: tuple[str, ...] = (),
        program: tuple[str, ...] = BT_AGENTS,
    ) -> None:
        self._seen: list[str] = []
        self._lines: queue.Queue[str] = queue.Queue()
        self._is_read = threading.Event()
        self._is_read.set()
        self.process = subprocess.Popen(
            [*before, sys.executable, *program, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
            cwd=folder,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            # pytest shows it if the test fails.
            print(line, end="")
            self._lines.put(line)
            self._is_read.wait()

    def leave_unread(self) -> None:
        """Read no more lines, as a terminal does after Ctrl-S."""
        self._is_read.clear()

    def read_on(self) -> None:
        """Read the lines again."""
        self._is_read.set()

    @property
    def output(self) -> str:
        """All lines so far."""
        return "".join(self._seen)

    def _next(self, limit_s: float) -> str:
        line = self._lines.get(timeout=max(0.0, limit_s))
        self._seen.append(line)
        return line

    def until(self, pattern: str, limit_s: float = HANG_S) -> str:
        """Read lines until one matches; return it."""
        end = time.monotonic() + limit_s
        while True:
            try:
                line = self._next(end - time.monotonic())
            except queue.Empty:
                pytest.fail(f"no line '{pattern}' within {limit_s} s in:\n{self.output}")
            if re.search(pattern, line):
                return line

    def seen(self, limit_s: float) -> str:
        """Read the lines of the next seconds; return all lines so far."""
        end = time.monotonic() + limit_s
        with suppress(queue.Empty):
            while True:
                self._next(end - time.monotonic())
        return self.output

    def new_lines(self) -> list[str]:
        """Return the lines since the last look; all lines so far may be many."""
        before = len(self._seen)
        self.seen(0.0)
        return self._seen[before:]

    def wait(self, limit_s: float = HANG_S) -> int:
        """Wait for the end; return the exit code."""
        try:
            code = self.process.wait(limit_s)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still running after {limit_s} s; its output:\n{self.output}")
        self.close()
        self.new_lines()
        return code

    def kill(self) -> None:
        """Kill the process and its children."""
        for pid in [*children(self.process.pid), self.process.pid]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
        self.close()

    def close(self) -> None:
        """Read the remaining output after the end of the process."""
        self._reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()

    def stop(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Send a signal; return the exit code and how long the process took to end [s]."""
        start = time.monotonic()
        self.process.send_signal(number)
        code = self.wait(20.0)
        return code, time.monotonic() - start


Start = Callable[..., Program]
Ask = Callable[..., str]


def wait_for(is_so: Callable[[], object]) -> None:
    """Wait until a condition outside the program holds."""
    end = time.monotonic() + HANG_S
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.05)


def output_of(command: Sequence[str], limit_s: float, **environment: str) -> str:
    """Return the output of a program, which must end in time, and well.

    One that takes too long is interrupted, so that it ends the processes that it has started.
    """
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            said, _ = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
            said, _ = process.communicate(timeout=HANG_S)
            pytest.fail(f"still running after {limit_s} s; its output:\n{said}")
        finally:
            process.kill()
    assert process.returncode == 0, said
    return said


def printed_by(program: str) -> list[str]:
    """Return the lines that a Python program prints in a process of its own."""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def children(pid: int) -> list[int]:
    """Return the pids of all direct children of a process."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(stat.parent.name))
    return found


def nodes(pid: int) -> list[tuple[str, int]]:
    """Return module and pid of the children of a process that run a node."""
    found = []
    for child in children(pid):
        with suppress(OSError):
            words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
            if "bt_agents_ros.node_main" in words:
                found.append((words[words.index("bt_agents_ros.node_main") + 1], child))
    return found


def node_of(pid: int, module: str) -> int:
    """Return the pid of the only child of a process that runs a module."""
    [found] = [child for name, child in nodes(pid) if name == module]
    return found


def alive(pid: int) -> bool:
    """Return whether a process exists and is not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
