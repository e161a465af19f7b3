# SPDX-License-Identifier: Apache-2.0
"""The processes of a running system: started together, watched, and ended within two seconds."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import bt_agents
from bt_agents.errors import BtAgentsError

LOOPBACK_PROFILE = Path(bt_agents.__file__).parent / "ros" / "loopback.xml"

RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
LAST_DOMAIN = 232

STOP_LIMIT_S = 1.7
"""How long a person who pressed Ctrl-C waits at most [s]."""

_FIRST_SHARE = 0.7
_LOOK_S = 0.01


@dataclass(frozen=True, kw_only=True)
class Component:
    """One process of the system.

    Attributes:
        name: For people, and of its log file.
        module: Python module that runs the node.
        parameters: ROS parameters by name.
        first: True is ended before the others, which it needs to end well.
    """

    name: str
    module: str
    parameters: Mapping[str, str | float | bool | int] = field(default_factory=dict)
    first: bool = False

    def command(self) -> list[str]:
        """Return the command line."""
        command = [sys.executable, "-m", self.module, "--ros-args", "--disable-external-lib-logs"]
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

    A whitelist of loopback addresses goes with the range ``LOCALHOST`` only.

    Raises:
        BtAgentsError: The user has set something that ROS does not know.
    """
    domain = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not domain.isdecimal() or int(domain) > LAST_DOMAIN:
        raise BtAgentsError(
            f"ROS_DOMAIN_ID is '{domain}', expected a number from 0 to {LAST_DOMAIN}"
        )
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", RANGES[0])
    if reach not in RANGES:
        raise BtAgentsError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{reach}', expected one of {', '.join(RANGES)}"
        )
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST":
        environment.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(LOOPBACK_PROFILE))


class Supervisor:
    """Starts components, each with its own log file, and ends them in order.

    Args:
        logs: Folder for the log files; made when absent.
    """

    def __init__(self, logs: Path) -> None:
        self._components: list[Component] = []
        self._logs = logs
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, *components: Component) -> None:
        """Start processes; they get their own session, so that a Ctrl-C reaches only us."""
        try:
            self._logs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BtAgentsError(
                f"no place for the logs: {self._logs} ({error.strerror}); set XDG_STATE_HOME to a "
                "folder that can be written"
            ) from None
        environment = {
            **os.environ,
            "BT_AGENTS_SUPERVISED": str(os.getpid()),
            "RCUTILS_COLORIZED_OUTPUT": "0",
            "PYTHONUNBUFFERED": "1",
        }
        for component in components:
            self._components.append(component)
            with self.log(component.name).open("wb") as log:
                self._processes[component.name] = subprocess.Popen(
                    component.command(),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    start_new_session=True,
                )

    def log(self, name: str) -> Path:
        """Return the log file of a component."""
        return self._logs / f"{name}.log"

    def dead(self) -> str:
        """Return which component ended by itself and its last words; empty when all are alive."""
        for name, process in self._processes.items():
            code = process.poll()
            if code is not None:
                words = self.log(name).read_text(errors="replace").splitlines()[-15:]
                return "\n".join([f"{name} ended with exit code {code}; its last words:", *words])
        return ""

    def stop(self, limit_s: float = STOP_LIMIT_S) -> list[str]:
        """End all processes; return the names of those that had to be killed.

        Args:
            limit_s: For all of them together [s]; a person who pressed Ctrl-C is not kept waiting.
        """
        start = time.monotonic()
        first = start + limit_s * _FIRST_SHARE
        self._end([c.name for c in self._components if c.first], first)
        stuck = self._end([c.name for c in self._components], start + limit_s)
        for name in stuck:
            self._processes[name].kill()
            self._processes[name].wait()
        return stuck

    def _end(self, names: Sequence[str], deadline: float) -> list[str]:
        processes = {name: self._processes[name] for name in names if name in self._processes}
        for process in processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        while any(p.poll() is None for p in processes.values()) and time.monotonic() < deadline:
            time.sleep(_LOOK_S)
        return [name for name, process in processes.items() if process.poll() is None]
