# SPDX-License-Identifier: Apache-2.0
"""Supervisor of the processes of a system: starts, restarts and ends them in order."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import printable
from bt_agents_ros.node_main import READY, SUPERVISED
from bt_agents_ros.signals import block_sigint

LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")

_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_FAST_DDS = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")

RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
LAST_DOMAIN = 232

FIRST_LIMIT_S = 1.2
"""Time for the components that are stopped first, before the others are stopped [s]."""

STOP_LIMIT_S = 5.0
"""Time for the others on a busy machine, before they are killed [s]."""

SILENCE_S = 10.0
"""Time without a heartbeat after which a component that had one counts as hung [s]."""

_NAMESPACE = re.compile(r"/?([A-Za-z]\w*/)*([A-Za-z]\w*)?", re.ASCII)

_STALL_S = 1.0
_POLL_S = 0.01
_FAILURE_LINES = 15
_RESTART_LINES = 3
_LOG_BYTES = 16_384
_LONGEST_LINE = 500
_FIRST_WAIT_S = 0.5
_LONGEST_WAIT_S = 30.0
_STEADY_LIFE_S = 60.0


@dataclass(frozen=True, kw_only=True)
class Component:
    """Process of the system.

    Attributes:
        name: For people, and of its log file.
        module: Python module that runs the node.
        parameters: ROS parameters by name; they override those of the file.
        stops_first: True when it is stopped before the others, which it needs for a clean end.
        restarts: True when it is started again if it ends after it was up.
    """

    name: str
    module: str
    parameters: Mapping[str, str | float | bool | int] = field(default_factory=dict)
    file: Path | None = None
    stops_first: bool = False
    restarts: bool = True

    def command(self) -> list[str]:
        """Return the command line of the process."""
        command = [sys.executable, "-m", "bt_agents_ros.node_main", self.module]
        command += ["--ros-args", "--disable-external-lib-logs"]
        namespace = os.environ.get("ROS_NAMESPACE", "").strip("/")
        command += ["-r", f"__ns:=/{namespace}"] if namespace else []
        command += ["--params-file", str(self.file)] if self.file else []
        for name, value in self.parameters.items():
            # JSON is YAML, too.
            command += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False)}"]
        return command


def set_local_discovery(environment: MutableMapping[str, str]) -> None:
    """Restrict discovery and traffic to this machine, unless the user has set it otherwise.

    With Fast DDS that is a whitelist of loopback addresses. Its range is then ``SUBNET``: with
    ``LOCALHOST`` ROS adds shared memory, which a process that dies can leave locked for others.

    Raises:
        BtAgentsError: The user has set a value that ROS does not accept.
    """
    domain = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not domain.isdecimal() or int(domain) > LAST_DOMAIN:
        raise BtAgentsError(
            f"ROS_DOMAIN_ID is '{domain}', expected a number from 0 to {LAST_DOMAIN}"
        )
    namespace = environment.get("ROS_NAMESPACE", "")
    if not _NAMESPACE.fullmatch(namespace):
        raise BtAgentsError(
            f"ROS_NAMESPACE is '{namespace}', expected words of letters, digits and '_' with '/' "
            "between, as in /robot1"
        )
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", RANGES[0])
    if reach not in RANGES:
        raise BtAgentsError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{reach}', expected one of {', '.join(RANGES)}"
        )
    if reach == "LOCALHOST" and environment.get("RMW_IMPLEMENTATION", "") in _FAST_DDS:
        profile = environment.setdefault(_PROFILE, str(LOOPBACK_PROFILE))
        reach = "SUBNET" if profile == str(LOOPBACK_PROFILE) else reach
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = reach


def discovery_text(environment: Mapping[str, str]) -> str:
    """Return the discovery range for people, after :func:`set_local_discovery`."""
    reach = environment["ROS_AUTOMATIC_DISCOVERY_RANGE"]
    local = reach == "LOCALHOST" or environment.get(_PROFILE) == str(LOOPBACK_PROFILE)
    return "this machine only" if local else f"discovery range {reach}"


class Backoff:
    """Exponential back-off between restarts, which begins anew after a long enough life."""

    def __init__(self) -> None:
        self._next_s = _FIRST_WAIT_S

    def next_wait(self, lived_s: float) -> float:
        """Return the time to wait before the next start of a process that lived so long [s]."""
        if lived_s >= _STEADY_LIFE_S:
            self._next_s = _FIRST_WAIT_S
        wait_s = self._next_s
        self._next_s = min(2 * wait_s, _LONGEST_WAIT_S)
        return wait_s


class LogFile:
    """Log file of a component, to which every start is appended; only its end is read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin = 0

    def open(self, start: int) -> BinaryIO:
        """Return the file for the output of a start of the process, the first being 1."""
        log = self.path.open("ab")
        if start > 1:
            log.write(f"--- start {start}, {time.strftime('%Y-%m-%d %H:%M:%S')}\n".encode())
            log.flush()
        self._begin = log.tell()
        return log

    def tail(self, lines: int) -> list[str]:
        """Return the last lines since the last start, however large the file is."""
        try:
            with self.path.open("rb") as log:
                size = log.seek(0, os.SEEK_END)
                log.seek(max(self._begin, size - _LOG_BYTES))
                text = log.read(_LOG_BYTES).decode(errors="replace")
        except OSError as error:
            return [f"(the log cannot be read: {error.strerror})"]
        return [printable(line[:_LONGEST_LINE]) for line in text.splitlines()[-lines:]]


@dataclass(eq=False)
class _Supervised:
    """Component with its process, over all of its starts; times are those of the supervisor [s].

    Attributes:
        ready: Pipe on which the process reports that it is up; -1 once that is known.
        started_at: Time of the last start.
        been_up: True once any start of it was up.
        last_heartbeat: Time of the last heartbeat of this start; None before the first.
        ended_at: Time at which its end was noticed; None while it runs.
        restart_at: Time of the next start; None when none is planned.
    """

    component: Component
    log: LogFile
    process: subprocess.Popen[bytes]
    ready: int
    started_at: float
    backoff: Backoff = field(default_factory=Backoff)
    starts: int = 1
    been_up: bool = False
    last_heartbeat: float | None = None
    ended_at: float | None = None
    restart_at: float | None = None

    def poll_ready(self) -> bool:
        """Return True once, when the process reports that it is up."""
        if self.ready < 0:
            return False
        try:
            up = bool(os.read(self.ready, 8))
        except BlockingIOError:
            return False
        self.close()
        self.been_up = self.been_up or up
        return up

    def close(self) -> None:
        """Close the pipe."""
        if self.ready >= 0:
            os.close(self.ready)
            self.ready = -1


class Supervisor:
    """Parent of all components, each with its own log file in a folder that it makes."""

    def __init__(self, logs: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._logs = logs
        self._clock = clock
        self._components: dict[str, _Supervised] = {}
        self._last_poll = clock()

    def start(self, *components: Component) -> None:
        """Start processes, each in its own session, so that a Ctrl-C reaches only this process."""
        try:
            self._logs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BtAgentsError(
                f"no place for the logs: {self._logs} ({error.strerror}); set XDG_STATE_HOME to a "
                "folder that can be written"
            ) from None
        for component in components:
            log = LogFile(self.log(component.name))
            process, ready = spawn(component, log, 1)
            started = _Supervised(component, log, process, ready, self._clock())
            self._components[component.name] = started

    def log(self, name: str) -> Path:
        """Return the path of a component's log file."""
        return self._logs / f"{name}.log"

    def failure(self) -> str:
        """Return which component ended by itself, with the end of its log; empty for none."""
        for one in self._components.values():
            code = one.process.poll()
            if code is not None:
                return _failure_text(one, code)
        return ""

    def on_heartbeat(self, name: str) -> None:
        """Handle a heartbeat of a component; from then on its silence counts as a hang."""
        one = self._components.get(name)
        # A late one of an earlier start may come while the next start is being loaded.
        if one is None or one.restart_at is not None or one.ended_at is not None:
            return
        one.poll_ready()
        if one.been_up:
            one.last_heartbeat = self._clock()

    def poll(self) -> list[str]:
        """Kill what hangs and restart what has ended when its time has come; never blocks.

        Returns:
            Events since the last call, in lines for a terminal.

        Raises:
            BtAgentsError: A component has ended that was never up, or that does not restart.
        """
        events: list[str] = []
        now = self._clock()
        stalled = now - self._last_poll > _STALL_S
        self._last_poll = now
        for one in self._components.values():
            if stalled and one.last_heartbeat is not None:
                # This process was suspended, and has handled no heartbeat meanwhile.
                one.last_heartbeat = now
            events += self._poll_one(one)
        return events

    def _poll_one(self, one: _Supervised) -> list[str]:
        events: list[str] = []
        now = self._clock()
        name = one.component.name
        # Polled first: what the process wrote before its end is in the pipe then.
        code = one.process.poll() if one.restart_at is None else None
        if one.poll_ready() and one.ended_at is not None:
            events.append(f"{name} is back after {now - one.ended_at:.1f} s")
            one.ended_at = None
        if code is not None:
            events += self._schedule_restart(one, code, now)
        elif one.restart_at is not None:
            events += self._restart(one, now) if now >= one.restart_at else []
        elif one.last_heartbeat is not None and now - one.last_heartbeat >= SILENCE_S:
            silence_s = now - one.last_heartbeat
            events.append(f"{name} hangs (no heartbeat for {silence_s:.0f} s): killing it")
            one.last_heartbeat = None
            one.process.kill()
        return events

    def _schedule_restart(self, one: _Supervised, code: int, now: float) -> list[str]:
        if not (one.been_up and one.component.restarts):
            raise BtAgentsError(_failure_text(one, code))
        one.close()
        one.last_heartbeat = None
        one.ended_at = one.ended_at if one.ended_at is not None else now
        wait_s = one.backoff.next_wait(now - one.started_at)
        one.restart_at = now + wait_s
        name = one.component.name
        text = f"{name} {_end_text(code)}: starting it again in {wait_s:g} s (log: {one.log.path})"
        return [text, *(f"  {name}: {line}" for line in one.log.tail(_RESTART_LINES))]

    def _restart(self, one: _Supervised, now: float) -> list[str]:
        one.starts += 1
        one.started_at = now
        try:
            one.process, one.ready = spawn(one.component, one.log, one.starts)
        except OSError as error:
            wait_s = one.backoff.next_wait(0.0)
            one.restart_at = now + wait_s
            text = f"cannot be started ({error}): trying again in {wait_s:g} s"
            return [f"{one.component.name} {text}"]
        one.restart_at = None
        return []

    def stop(self) -> list[str]:
        """End all processes, in order; return the names of those that had to be killed."""
        first = [one for one in self._components.values() if one.component.stops_first]
        self._stop(first, FIRST_LIMIT_S)
        stuck = self._stop(list(self._components.values()), STOP_LIMIT_S)
        for one in stuck:
            one.process.kill()
            one.process.wait()
        for one in self._components.values():
            one.close()
        return [one.component.name for one in stuck]

    def kill(self) -> None:
        """End all processes at once, which leave nothing behind that is worth the time."""
        for one in self._components.values():
            one.process.kill()

    def _stop(self, components: Sequence[_Supervised], limit_s: float) -> list[_Supervised]:
        deadline = self._clock() + limit_s
        processes = [one.process for one in components]
        for process in processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        while any(p.poll() is None for p in processes) and self._clock() < deadline:
            time.sleep(_POLL_S)
        return [one for one in components if one.process.poll() is None]


def spawn(component: Component, log: LogFile, start: int) -> tuple[subprocess.Popen[bytes], int]:
    """Start a process; return it with the pipe on which it reports that it is up."""
    ready, write_end = os.pipe()
    os.set_blocking(ready, False)
    environment = {
        **os.environ,
        SUPERVISED: str(os.getpid()),
        READY: str(write_end),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }
    signal_mask = block_sigint()
    try:
        with log.open(start) as file:
            process = subprocess.Popen(
                component.command(),
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
                pass_fds=(write_end,),
            )
    except OSError:
        os.close(ready)
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, signal_mask)
        os.close(write_end)
    return process, ready


def _failure_text(one: _Supervised, code: int) -> str:
    tail = one.log.tail(_FAILURE_LINES)
    return "\n".join([f"{one.component.name} {_end_text(code)}; the end of its log:", *tail])


def _end_text(code: int) -> str:
    if code < 0:
        return f"ended (killed by signal {-code})"
    return f"ended with exit code {code}"
