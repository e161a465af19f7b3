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
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.liveness import LONGEST_PAUSE_S
from bt_agents_core.text import quote
from bt_agents_ros.fastdds_profile import PROFILE
from bt_agents_ros.node_main import NO_LOG_FILE, READY, READY_BYTES, RESTARTED, SUPERVISED
from bt_agents_ros.signals import sigint_blocked
from bt_agents_tools.launcher.fork_server import ForkedProcess, ForkServer
from bt_agents_tools.launcher.log_files import LogFile, make_log_folder
from bt_agents_tools.launcher.parameter_file import ParameterFile, UnknownByNode, unknown_in

LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")
LAN_PROFILE = Path(__file__).with_name("lan.xml")

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
ENCLAVE = "ROS_SECURITY_ENCLAVE_OVERRIDE"
_FAST_DDS = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")

RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
LAST_DOMAIN = 232

FIRST_LIMIT_S = 1.2
"""Time for the components that stop first, before the others are stopped [s]."""

STOP_LIMIT_S = 5.0
"""Time for the others to stop on a busy machine before they are killed [s]."""

SILENCE_S = 10.0
"""Time without a sign of life after which a component that gave one counts as hung [s]."""

_NAMESPACE = re.compile(r"/?([A-Za-z]\w*/)*([A-Za-z]\w*)?", re.ASCII)
_LONGEST_NAMESPACE = 100

_STALL_S = 1.0
_POLL_S = 0.01
_FAILURE_LINES = 15
_RESTART_LINES = 3
_FIRST_WAIT_S = 0.5
_LONGEST_WAIT_S = 30.0
_STEADY_LIFE_S = 10.0


@dataclass(frozen=True, kw_only=True)
class Component:
    """Process of the system.

    Attributes:
        name: Name for people and for its log file.
        node: Name of its node; empty for the node's default name.
        module: Python module that runs the node.
        parameters: ROS parameters by name; they override the file.
        stops_first: True if it stops before the others, because it needs them for a clean end.
        restarts: True if it is restarted when it ends after it was up.
        needed: False if the system continues without it, even if it was never up.
        arguments: Arguments of the module, before ROS arguments.
        descriptors: Open files of this process that it inherits under the same numbers.
        environment: Variables that only this process gets, such as a key.
        parts: Nodes that share the process, with their modules; empty for one node of its name.
        keeps_enclave: Whether it has the security enclave of the command, and not one of its name.
    """

    name: str
    module: str
    node: str = ""
    parameters: Mapping[str, str | float | bool | int] = field(default_factory=dict)
    file: ParameterFile | None = None
    stops_first: bool = False
    restarts: bool = True
    needed: bool = True
    arguments: tuple[str, ...] = ()
    descriptors: tuple[int, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict, repr=False)
    parts: Mapping[str, str] = field(default_factory=dict)
    keeps_enclave: bool = False

    @property
    def modules(self) -> tuple[str, ...]:
        """Modules that the process loads."""
        return (self.module, *self.parts.values())

    def command(self) -> list[str]:
        """Return the command line of the process."""
        command = [sys.executable, "-m", "bt_agents_ros.node_main", self.module]
        command += [*self.arguments, *NO_LOG_FILE]
        namespace = os.environ.get("ROS_NAMESPACE", "").strip("/")
        command += ["-r", f"__ns:=/{namespace}"] if namespace else []
        command += ["-r", f"__node:={self.node}"] if self.node else []
        command += ["--params-file", str(self.file.path)] if self.file else []
        for name, value in self.parameters.items():
            # JSON is also YAML.
            command += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False)}"]
        return command


def set_discovery(environment: MutableMapping[str, str]) -> None:
    """Restrict discovery and traffic to this machine, unless the user has set a range.

    For Fast DDS this is a whitelist of loopback addresses with the range ``SUBNET``: with
    ``LOCALHOST``, ROS adds shared memory, which a dying process can leave locked for others. A
    user who sets ``SUBNET`` gets a profile for several machines.

    Raises:
        BtAgentsError: The user has set a value that ROS does not accept.
    """
    domain = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not domain.isdecimal() or int(domain) > LAST_DOMAIN:
        raise BtAgentsError(
            f"ROS_DOMAIN_ID is '{domain}', expected a number from 0 to {LAST_DOMAIN}"
        )
    namespace = environment.get("ROS_NAMESPACE", "")
    if len(namespace) > _LONGEST_NAMESPACE or not _NAMESPACE.fullmatch(namespace):
        raise BtAgentsError(
            f"ROS_NAMESPACE is {quote(namespace)}, expected words of letters, digits and '_' with "
            f"'/' between, as in /robot1, of {_LONGEST_NAMESPACE} characters at most"
        )
    if namespace.endswith("/"):  # which no node may have
        environment["ROS_NAMESPACE"] = namespace.rstrip("/")
    reach = environment.get(DISCOVERY_RANGE, RANGES[0])
    if reach == "OFF":
        raise BtAgentsError(
            f"{DISCOVERY_RANGE} is 'OFF': then no process of the system finds another; "
            "unset it, or set it to LOCALHOST, for this machine only"
        )
    if reach not in RANGES:
        raise BtAgentsError(f"{DISCOVERY_RANGE} is '{reach}', expected one of {', '.join(RANGES)}")
    if reach == "LOCALHOST" and environment.get("RMW_IMPLEMENTATION", "") in _FAST_DDS:
        profile = environment.setdefault(PROFILE, str(LOOPBACK_PROFILE))
        reach = "SUBNET" if profile == str(LOOPBACK_PROFILE) else reach
    elif reach == "SUBNET" and environment.get("RMW_IMPLEMENTATION", "") in _FAST_DDS:
        environment.setdefault(PROFILE, str(LAN_PROFILE))
    environment[DISCOVERY_RANGE] = reach


def discovery_text(environment: Mapping[str, str]) -> str:
    """Return the discovery range for people, after :func:`set_discovery`."""
    reach = environment[DISCOVERY_RANGE]
    if reach == "LOCALHOST" or environment.get(PROFILE) == str(LOOPBACK_PROFILE):
        return "this machine only"
    return "open to everybody on this network" if reach == "SUBNET" else f"discovery range {reach}"


class Backoff:
    """Exponential back-off between restarts of a process that repeatedly fails soon.

    After a long enough life, the first restart comes at once.
    """

    def __init__(self) -> None:
        self._next_s = _FIRST_WAIT_S

    def next_wait(self, lived_s: float) -> float:
        """Return the wait before the next start of a process, given how long it was up [s]."""
        if lived_s >= _STEADY_LIFE_S:
            self._next_s = _FIRST_WAIT_S
            return 0.0
        wait_s = self._next_s
        self._next_s = min(2 * wait_s, _LONGEST_WAIT_S)
        return wait_s


class ProcessState(StrEnum):
    """State of a supervised process.

    Attributes:
        STARTING: It runs, and has not reported yet that it is up.
        UP: It is up.
        INACTIVE: It is up, and was told to leave the system temporarily.
        ENDED: It has ended; it starts again if that is planned.
    """

    STARTING = "starting"
    UP = "up"
    INACTIVE = "inactive"
    ENDED = "ended"


@dataclass(frozen=True, kw_only=True)
class SupervisedProcess:
    """Current process of a component.

    Attributes:
        name: Name of the component.
        pid: Its id; the id of the last start if it has ended.
        since: Time since which it is in this state, on the supervisor's clock [s].
        restarts: How often it was started again.
        last_exit: How it ended last, in words; empty if it never has.
        log: Its log file.
    """

    name: str
    pid: int
    state: ProcessState
    since: float
    restarts: int
    last_exit: str
    log: LogFile


@dataclass(eq=False)
class _Supervised:
    """Component with its process over all of its starts; times are on the supervisor's clock [s].

    Attributes:
        ready: The process reports on this pipe that it is up; -1 after the report.
        since: Time of the last change of its state.
        up_at: Time when the last start was up; None while it is not.
        been_up: True once any of its starts was up.
        last_heartbeat: Time of the last heartbeat of this start; None before the first.
        inactive: Its nodes that were told to leave the system temporarily.
        ended_at: Time when the supervisor noticed its end; None while it runs.
        restart_at: Time of the next start; None if none is planned.
        last_exit: How it ended last, in words; empty if it never has.
        unknown: What its nodes reported of their parameters; None before the first report.
    """

    component: Component
    log: LogFile
    process: subprocess.Popen[bytes] | ForkedProcess
    ready: int
    since: float
    up_at: float | None = None
    backoff: Backoff = field(default_factory=Backoff)
    starts: int = 1
    been_up: bool = False
    last_heartbeat: float | None = None
    inactive: set[str] = field(default_factory=set)
    ended_at: float | None = None
    restart_at: float | None = None
    last_exit: str = ""
    unknown: UnknownByNode | None = None

    @property
    def state(self) -> ProcessState:
        """Its state as far as the supervisor has noticed."""
        if self.restart_at is not None:
            return ProcessState.ENDED
        if self.up_at is None:
            return ProcessState.STARTING
        return ProcessState.INACTIVE if self.inactive else ProcessState.UP

    def poll_ready(self, now: float) -> bool:
        """Return True once, after the process reports that it is up."""
        if self.ready < 0:
            return False
        try:
            report = os.read(self.ready, READY_BYTES)
        except BlockingIOError:
            return False
        self.close()
        if report:
            self.been_up, self.up_at, self.since = True, now, now
            # Incomplete if the kernel has given the pipe less room than usual.
            with suppress(ValueError):
                self.unknown = json.loads(report)
        return bool(report)

    def close(self) -> None:
        """Close the pipe."""
        if self.ready >= 0:
            os.close(self.ready)
            self.ready = -1


class Supervisor:
    """Parent of all components, each with its own log file in a folder that it makes.

    Its owner holds the lock of the ROS domain, and has found no other system on the graph.

    Args:
        logs: The folder.
        clock: Steady time [s].
        fork_server: Forks the processes; its owner closes it. Without one, each process loads its
            modules itself.
    """

    def __init__(
        self,
        logs: Path,
        clock: Callable[[], float] = time.monotonic,
        fork_server: ForkServer | None = None,
    ) -> None:
        self._logs = logs
        self._clock = clock
        self._fork_server = fork_server
        self._components: dict[str, _Supervised] = {}
        self._reports: list[UnknownByNode | None] = []
        self._unknown: dict[str, str] = {}
        self._events: list[str] = []
        self._last_poll = clock()

    def start(self, *components: Component) -> None:
        """Start processes in their own sessions, so that a Ctrl-C reaches only this process.

        Raises:
            BtAgentsError: There is no place for the logs.
        """
        try:
            make_log_folder(self._logs)
        except OSError as error:
            raise BtAgentsError(
                f"no place for the logs: {self._logs} ({error.strerror}); set XDG_STATE_HOME to a "
                "folder that can be written"
            ) from None
        for component in components:
            log = LogFile(self.log(component.name))
            process, ready = spawn(component, log, 1, self._fork_server)
            started = _Supervised(component, log, process, ready, self._clock())
            self._components[component.name] = started

    def log(self, name: str) -> Path:
        """Return the path of a component's log file."""
        return self._logs / f"{name}.log"

    def has_been_up(self, name: str) -> bool:
        """Return whether a component was up at least once."""
        one = self._components.get(name)
        return one is not None and one.been_up

    def processes(self) -> tuple[SupervisedProcess, ...]:
        """Return all processes as they were at the last poll, in the order of first starts."""
        return tuple(
            SupervisedProcess(
                name=name,
                pid=one.process.pid,
                state=one.state,
                since=one.since,
                restarts=one.starts - 1,
                last_exit=one.last_exit,
                log=one.log,
            )
            for name, one in self._components.items()
        )

    def unknown_parameters(self) -> Mapping[str, str]:
        """Return the parameters of files that no node has, as in :func:`unknown_in`.

        There are none until all processes that get a file were up.
        """
        return self._unknown

    def failure(self) -> str:
        """Return the component that ended by itself, with the end of its log; empty for none."""
        for one in self._components.values():
            code = one.process.poll()
            if code is not None:
                return _failure_text(one, code)
        return ""

    def on_heartbeat(self, name: str) -> None:
        """Handle a heartbeat of a node; from then on, silence of its process counts as a hang."""
        one = self._with(name)
        if one is None or name in one.inactive:
            return
        one.poll_ready(self._clock())
        if one.been_up:
            one.last_heartbeat = self._clock()

    def on_state(self, name: str, state: str) -> None:
        """Handle a requested state of a managed node; an inactive node has no heartbeat."""
        one = self._with(name)
        if one is None:
            return
        one.since = self._clock()
        if state == "active":
            if name in one.inactive:
                self._events.append(f"{name} is active again")
            one.inactive.discard(name)
        else:
            # Only an error leads there, such as a parameter that the node refuses as it activates.
            cause = "has failed" if state == "unconfigured" else "was told to leave"
            self._events.append(f"{name} {cause}: it is {state}")
            one.inactive.add(name)
            one.last_heartbeat = None

    def _with(self, node: str) -> _Supervised | None:
        """Return the component with a node, unless its message comes from an earlier start."""
        one = self._components.get(node)
        if one is None:
            every = self._components.values()
            one = next((each for each in every if node in each.component.parts), None)
        if one is None or one.restart_at is not None or one.ended_at is not None:
            return None
        return one

    def poll(self) -> list[str]:
        """Kill hanging processes and restart ended ones when they are due; never block.

        It also rotates log files that are too large.

        Returns:
            Events since the last call, as lines for a terminal.

        Raises:
            BtAgentsError: A component has ended that is needed and was never up, that does not
            restart, or that found soon after its first start that it must not run here.
        """
        events, self._events = self._events, []
        now = self._clock()
        pause_s = now - self._last_poll
        self._last_poll = now
        for one in self._components.values():
            if pause_s > _STALL_S and one.last_heartbeat is not None:
                # This process was paused, and did not handle heartbeats meanwhile. After a long
                # pause it may never receive messages of a healthy process again.
                one.last_heartbeat = now if pause_s <= LONGEST_PAUSE_S else None
            one.log.rotate()
            events += self._poll_one(one)
        return events + self._judge_parameters()

    def _judge_parameters(self) -> list[str]:
        """Return the sentences about further parameters that no node has, if reports changed."""
        reports = [one.unknown for one in self._components.values() if one.component.file]
        if reports == self._reports:
            return []
        self._reports = reports
        unknown: dict[str, Mapping[str, str] | None] = {}
        for report in reports:
            if report is None:
                return []
            unknown |= report
        before, self._unknown = self._unknown, {}
        files = filter(None, (one.component.file for one in self._components.values()))
        for file in {file.path: file for file in files}.values():
            self._unknown |= unknown_in(file, unknown)
        return [text for key, text in self._unknown.items() if before.get(key) != text]

    def _poll_one(self, one: _Supervised) -> list[str]:
        events: list[str] = []
        now = self._clock()
        name = one.component.name
        # Poll first: then the pipe has everything that the process wrote before its end.
        code = one.process.poll() if one.restart_at is None else None
        if one.poll_ready(now) and one.ended_at is not None:
            events.append(f"{name} is back after {now - one.ended_at:.1f} s")
            one.ended_at = None
        if code is not None:
            events += self._schedule_restart(one, code, now)
        if one.restart_at is not None:
            events += self._restart(one, now) if now >= one.restart_at else []
        elif one.last_heartbeat is not None and now - one.last_heartbeat >= SILENCE_S:
            silence_s = now - one.last_heartbeat
            events.append(f"{name} hangs (not heard for {silence_s:.0f} s): killing it")
            one.last_heartbeat = None
            one.process.kill()
        return events

    def _schedule_restart(self, one: _Supervised, code: int, now: float) -> list[str]:
        lived_s = 0.0 if one.up_at is None else now - one.up_at
        is_refused = code == os.EX_CONFIG and one.starts == 1 and lived_s < _STEADY_LIFE_S
        never_up = one.component.needed and not one.been_up
        if never_up or is_refused or not one.component.restarts:
            raise BtAgentsError(_failure_text(one, code))
        one.close()
        one.last_heartbeat = None
        one.last_exit = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        one.inactive.clear()
        one.ended_at = one.ended_at if one.ended_at is not None else now
        wait_s = one.backoff.next_wait(lived_s)
        one.since, one.restart_at = now, now + wait_s
        name = one.component.name
        when = f"in {wait_s:g} s" if wait_s else "at once"
        text = f"{name} {_end_text(code)}: starting it again {when} (log: {one.log.path})"
        return [text, *(f"  {name}: {line}" for line in one.log.tail(_RESTART_LINES))]

    def _restart(self, one: _Supervised, now: float) -> list[str]:
        one.starts += 1
        one.up_at = None
        try:
            one.process, one.ready = spawn(one.component, one.log, one.starts, self._fork_server)
        except OSError as error:
            wait_s = one.backoff.next_wait(0.0)
            one.restart_at = now + wait_s
            text = f"cannot be started ({error}): trying again in {wait_s:g} s"
            return [f"{one.component.name} {text}"]
        one.since, one.restart_at = now, None
        return []

    def stop(self) -> list[str]:
        """End all processes in order; return the names of those that had to be killed."""
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
        """Kill all processes at once, when a clean end is not worth the time."""
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


def spawn(
    component: Component, log: LogFile, start: int, fork_server: ForkServer | None = None
) -> tuple[subprocess.Popen[bytes] | ForkedProcess, int]:
    """Start a process; return it and its pipe for reporting that it is up."""
    ready, write_end = os.pipe()
    os.set_blocking(ready, False)
    environment = {
        **os.environ,
        **component.environment,
        SUPERVISED: str(os.getpid()),
        READY: str(write_end),
        **({RESTARTED: "yes"} if component.restarts else {}),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }
    of_command = environment.get(ENCLAVE, "")
    if of_command and not component.keeps_enclave:
        # ROS prefers it to any argument, and nodes may do what the command may not.
        environment[ENCLAVE] = f"{of_command.rpartition('/')[0]}/{component.name}"
    try:
        with log.open(start) as file:
            process = launch(
                component.command(),
                environment,
                file.fileno(),
                (write_end, *component.descriptors),
                fork_server,
            )
    except OSError:
        os.close(ready)
        raise
    finally:
        os.close(write_end)
    return process, ready


def launch(
    command: Sequence[str],
    environment: Mapping[str, str],
    output: int,
    descriptors: Sequence[int],
    fork_server: ForkServer | None,
) -> subprocess.Popen[bytes] | ForkedProcess:
    """Start a process in its own session: forked, or directly without a working fork server.

    Args:
        command: See :meth:`ForkServer.start`, also for the next ones.
        environment: Its environment.
        output: Descriptor of its standard output and error.
        descriptors: Other descriptors that it inherits.
        fork_server: Server that has loaded its modules.
    """
    if fork_server is not None:
        with suppress(OSError):
            return fork_server.start(command, environment, output, descriptors)
    with sigint_blocked():
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
            pass_fds=descriptors,
        )


def _failure_text(one: _Supervised, code: int) -> str:
    tail = one.log.tail(_FAILURE_LINES)
    return "\n".join([f"{one.component.name} {_end_text(code)}; the end of its log:", *tail])


def _end_text(code: int) -> str:
    if code < 0:
        return f"ended (killed by signal {-code})"
    return f"ended with exit code {code}"
