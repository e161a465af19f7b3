# SPDX-License-Identifier: Apache-2.0
"""The processes of a running system: started together, kept alive, ended in order."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.node_main import READY, SUPERVISED
from bt_agents_ros.signals import block_sigint
from bt_agents_tools.launcher.backoff import Backoff
from bt_agents_tools.launcher.log_file import LogFile

LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")

_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_FAST_DDS = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")

RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
LAST_DOMAIN = 232

FIRST_LIMIT_S = 1.2
"""How long the others wait for those that end before them [s]."""

STOP_LIMIT_S = 5.0
"""How long a busy machine may need to end the others; what lives then is killed [s]."""

SILENCE_S = 10.0
"""A component that gives signs of life and then none for so long hangs, and is killed [s]."""

_NAMESPACE = re.compile(r"/?([A-Za-z]\w*/)*([A-Za-z]\w*)?", re.ASCII)

_GAP_S = 1.0
_LOOK_S = 0.01
_LAST_WORDS = 15
_FEW_WORDS = 3


@dataclass(frozen=True, kw_only=True)
class Component:
    """One process of the system.

    Attributes:
        name: For people, and of its log file.
        module: Python module that runs the node.
        parameters: ROS parameters by name; they win over those of the file.
        file: ROS parameter file; None for none.
        first: True is ended before the others, which it needs to end well.
        lasting: True is started again when it ends after it was up.
    """

    name: str
    module: str
    parameters: Mapping[str, str | float | bool | int] = field(default_factory=dict)
    file: Path | None = None
    first: bool = False
    lasting: bool = True

    def command(self) -> list[str]:
        """Return the command line."""
        command = [sys.executable, "-m", "bt_agents_ros.node_main", self.module]
        command += ["--ros-args", "--disable-external-lib-logs"]
        namespace = os.environ.get("ROS_NAMESPACE", "").strip("/")
        command += ["-r", f"__ns:=/{namespace}"] if namespace else []
        command += ["--params-file", str(self.file)] if self.file else []
        for name, value in self.parameters.items():
            command += ["-p", f"{name}:={_yaml(value)}"]
        return command


def _yaml(value: str | float | bool | int) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case float():
            return repr(value)
        case _:
            return str(value)


def keep_local(environment: MutableMapping[str, str]) -> None:
    """Set what keeps all traffic on this machine, unless the user has set it otherwise.

    With Fast DDS that is a whitelist of loopback addresses. Its range is then ``SUBNET``: with
    ``LOCALHOST`` ROS adds shared memory, in which the death of a process can leave others deaf.

    Raises:
        BtAgentsError: The user has set something that ROS does not know.
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


def reach_in_words(environment: Mapping[str, str]) -> str:
    """Return how far the traffic goes after :func:`keep_local`."""
    reach = environment["ROS_AUTOMATIC_DISCOVERY_RANGE"]
    local = reach == "LOCALHOST" or environment.get(_PROFILE) == str(LOOPBACK_PROFILE)
    return "this machine only" if local else f"discovery range {reach}"


@dataclass(eq=False)
class _Kept:
    """A component with its process, over all of its starts.

    Attributes:
        ready: Pipe on which the process says that it is up; -1 once that is known.
        been_up: Whether any start of it was up.
        began: When it was started last, on the clock of the supervisor [s].
        heard: When this start of it gave its last sign of life; None before the first.
        ended: When its end was noticed; None while it runs.
        due: When it is started again; None when it is not.
    """

    component: Component
    log: LogFile
    process: subprocess.Popen[bytes]
    ready: int
    began: float
    backoff: Backoff = field(default_factory=Backoff)
    starts: int = 1
    been_up: bool = False
    heard: float | None = None
    ended: float | None = None
    due: float | None = None

    def take_ready(self) -> bool:
        """Return whether the process says now that it is up."""
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
        """Listen no longer."""
        if self.ready >= 0:
            os.close(self.ready)
            self.ready = -1


class Supervisor:
    """Starts components, each with its own log file, keeps them alive, and ends them in order.

    Args:
        logs: Folder for the log files; made when absent.
        clock: Steady seconds.
    """

    def __init__(self, logs: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._logs = logs
        self._clock = clock
        self._kept: dict[str, _Kept] = {}
        self._looked = clock()

    def start(self, *components: Component) -> None:
        """Start processes; they get their own session, so that a Ctrl-C reaches only us."""
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
            self._kept[component.name] = _Kept(component, log, process, ready, self._clock())

    def log(self, name: str) -> Path:
        """Return the log file of a component."""
        return self._logs / f"{name}.log"

    def dead(self) -> str:
        """Return which component ended by itself and its last words; empty when all are alive."""
        for kept in self._kept.values():
            code = kept.process.poll()
            if code is not None:
                return _last_words(kept, code)
        return ""

    def hear(self, name: str) -> None:
        """Take a sign of life of a component, which is expected to give more of them."""
        kept = self._kept.get(name)
        # One of an earlier start may come late, while the next one is still being loaded.
        if kept is None or kept.due is not None or kept.ended is not None:
            return
        kept.take_ready()
        if kept.been_up:
            kept.heard = self._clock()

    def keep_alive(self) -> list[str]:
        """Kill what hangs, start again what has ended and whose time has come; never waits.

        Returns:
            What has happened since the last call, in lines for a terminal.

        Raises:
            BtAgentsError: A component has ended that has never been up, or that is not to last.
        """
        told: list[str] = []
        now = self._clock()
        held_up = now - self._looked > _GAP_S
        self._looked = now
        for kept in self._kept.values():
            if held_up and kept.heard is not None:
                # Nobody has listened meanwhile.
                kept.heard = now
            told += self._keep(kept)
        return told

    def _keep(self, kept: _Kept) -> list[str]:
        told: list[str] = []
        now = self._clock()
        name = kept.component.name
        # Asked first: what it has said before its end is in the pipe then.
        code = kept.process.poll() if kept.due is None else None
        if kept.take_ready() and kept.ended is not None:
            told.append(f"{name} is back after {now - kept.ended:.1f} s")
            kept.ended = None
        if code is not None:
            told += self._mourn(kept, code, now)
        elif kept.due is not None:
            told += self._start_again(kept, now) if now >= kept.due else []
        elif kept.heard is not None and now - kept.heard >= SILENCE_S:
            told.append(f"{name} hangs (no sign of life for {now - kept.heard:.0f} s): killing it")
            kept.heard = None
            kept.process.kill()
        return told

    def _mourn(self, kept: _Kept, code: int, now: float) -> list[str]:
        if not (kept.been_up and kept.component.lasting):
            raise BtAgentsError(_last_words(kept, code))
        kept.close()
        kept.heard = None
        kept.ended = kept.ended if kept.ended is not None else now
        wait_s = kept.backoff.ended(now - kept.began)
        kept.due = now + wait_s
        name = kept.component.name
        words = [f"  {name}: {line}" for line in kept.log.last_words(_FEW_WORDS)]
        return [
            f"{name} {_how(code)}: starting it again in {wait_s:g} s (log: {kept.log.path})",
            *words,
        ]

    def _start_again(self, kept: _Kept, now: float) -> list[str]:
        kept.starts += 1
        kept.began = now
        try:
            kept.process, kept.ready = spawn(kept.component, kept.log, kept.starts)
        except OSError as error:
            wait_s = kept.backoff.ended(0.0)
            kept.due = now + wait_s
            name = kept.component.name
            return [f"{name} cannot be started ({error}): trying again in {wait_s:g} s"]
        kept.due = None
        return []

    def stop(self) -> list[str]:
        """End all processes, in order; return the names of those that had to be killed."""
        self._end([k for k in self._kept.values() if k.component.first], FIRST_LIMIT_S)
        stuck = self._end(list(self._kept.values()), STOP_LIMIT_S)
        for kept in stuck:
            kept.process.kill()
            kept.process.wait()
        for kept in self._kept.values():
            kept.close()
        return [kept.component.name for kept in stuck]

    def _end(self, kept: Sequence[_Kept], limit_s: float) -> list[_Kept]:
        deadline = self._clock() + limit_s
        processes = [k.process for k in kept]
        for process in processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        while any(p.poll() is None for p in processes) and self._clock() < deadline:
            time.sleep(_LOOK_S)
        return [k for k in kept if k.process.poll() is None]


def spawn(component: Component, log: LogFile, start: int) -> tuple[subprocess.Popen[bytes], int]:
    """Start a process; return it with the pipe on which it says that it is up."""
    ready, says_ready = os.pipe()
    os.set_blocking(ready, False)
    environment = {
        **os.environ,
        SUPERVISED: str(os.getpid()),
        READY: str(says_ready),
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
                pass_fds=(says_ready,),
            )
    except OSError:
        os.close(ready)
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, signal_mask)
        os.close(says_ready)
    return process, ready


def _last_words(kept: _Kept, code: int) -> str:
    words = kept.log.last_words(_LAST_WORDS)
    return "\n".join([f"{kept.component.name} {_how(code)}; its last words:", *words])


def _how(code: int) -> str:
    """Return how a process ended, in words."""
    if code < 0:
        return f"ended (killed by signal {-code})"
    return f"ended with exit code {code}"
