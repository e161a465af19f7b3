# SPDX-License-Identifier: Apache-2.0
"""Machines on one network, each in its own namespace; no traffic leaves them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

import machine_probe
import network_switch
from bt_agents_ros.fastdds_profile import PROFILE
from bt_agents_tools.launcher.supervisor import LAN_PROFILE
from programs import Program
from skipped_tests import NAMESPACES

DOMAIN = "64"
SERVER_PORT = "11811"
"""Port of the discovery server."""

_SLEEP = ("unshare", "--net", "--uts", "sh", "-c")


def address_of(number: int) -> str:
    """Return the address of a machine by its position among the names, from 1."""
    return f"10.64.0.{number}"


def reason_against() -> str:
    """Return why this machine cannot create others; empty if it can."""
    for tool in ("unshare", "nsenter", "ip"):
        if shutil.which(tool) is None:
            return f"{tool} is not installed"
    if not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        return "/dev/net/tun cannot be opened"
    tried = subprocess.run([*_SLEEP, "true"], capture_output=True, text=True, check=False)
    return tried.stderr.strip()


class Machine:
    """A network namespace with a host name, kept alive by a sleeping process."""

    def __init__(
        self, name: str, address: str, folder: Path, environment: Mapping[str, str]
    ) -> None:
        self.name = name
        self.address = address
        folder = folder / name
        runtime = folder / "run"
        runtime.mkdir(parents=True, mode=0o700)
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("FASTRTPS", "ROS_"))}
        self.environment = {
            **kept,
            "ROS_DOMAIN_ID": DOMAIN,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            "XDG_RUNTIME_DIR": str(runtime),
            "XDG_STATE_HOME": str(folder / "state"),
            "PYTHONUNBUFFERED": "1",
            "COLUMNS": "120",
            **environment,
        }
        self.keeper = subprocess.Popen(
            [*_SLEEP, f"hostname {name} && ip link set lo up && echo up && exec sleep 1000"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.keeper.stdout is not None
        assert self.keeper.stdout.readline() == "up\n"

    @property
    def inside(self) -> tuple[str, ...]:
        """Prefix of a command line that runs on this machine."""
        return ("nsenter", "--target", str(self.keeper.pid), "--net", "--uts")


class Network:
    """Machines connected by a switch; their programs are killed by pid at the end.

    Args:
        folder: Contains a folder for each machine.
        names: Host names; the addresses are 10.64.0.1 and so on.
        environment: Variables that all machines have in addition to the usual ones.

    Raises:
        pytest.skip.Exception: This machine cannot create others.
    """

    def __init__(
        self, folder: Path, names: Sequence[str], environment: Mapping[str, str] | None = None
    ) -> None:
        reason = reason_against()
        if reason:
            pytest.skip(f"{NAMESPACES}: {reason}")
        self._names = list(names)
        self._programs: list[Program] = []
        self._servers: list[subprocess.Popen[bytes]] = []
        self._settings = dict(network_switch.SETTINGS)
        self.machines = {
            name: Machine(name, address_of(number), folder, environment or {})
            for number, name in enumerate(names, start=1)
        }
        arguments = [
            word for one in self.machines.values() for word in (str(one.keeper.pid), one.address)
        ]
        self._switch = subprocess.Popen(
            [sys.executable, network_switch.__file__, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._switch.stdout is not None
        assert self._switch.stdout.readline() == "ready\n"

    def set(self, **settings: object) -> None:
        """Set delay and loss, the unplugged cables, and whether multicast passes."""
        self._settings |= settings
        out = [self._names.index(name) for name in self._settings["out"]]
        assert self._switch.stdin is not None
        assert self._switch.stdout is not None
        self._switch.stdin.write(json.dumps({**self._settings, "out": out}) + "\n")
        self._switch.stdin.flush()
        assert self._switch.stdout.readline() == "set\n"

    def start(self, machine: str, *arguments: str) -> Program:
        """Start ``bt-agents`` on a machine."""
        one = self.machines[machine]
        self._programs.append(Program(arguments, one.environment, before=one.inside))
        return self._programs[-1]

    def serve_discovery(self, machine: str) -> None:
        """Start a discovery server on a machine."""
        one = self.machines[machine]
        server = Path(sys.prefix) / "bin" / "fast-discovery-server"
        # Wheels keep the libraries of a program where only Python finds them.
        libraries = [Path(sys.prefix) / "lib", *Path(sysconfig.get_path("purelib")).glob("*.libs")]
        environment = {**one.environment, "LD_LIBRARY_PATH": ":".join(map(str, libraries))}
        command = [*one.inside, str(server), "-i", "0", "-l", one.address, "-p", SERVER_PORT]
        self._servers.append(subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL))

    def listen(self, machine: str) -> Program:
        """Start a probe on a machine, which prints the messages that it receives there."""
        one = self.machines[machine]
        environment = {**one.environment, PROFILE: str(LAN_PROFILE)}
        program = Program((), environment, before=one.inside, program=(machine_probe.__file__,))
        self._programs.append(program)
        program.until("listening")
        return program

    def ask(self, machine: str, *arguments: str) -> str:
        """Run a command on a machine to its end; return its output."""
        program = self.start(machine, *arguments)
        assert program.wait() == 0, program.output
        return program.output

    def close(self) -> None:
        """Kill every program, the switch and the machines."""
        for program in self._programs:
            program.kill()
        keepers = [one.keeper for one in self.machines.values()]
        for helper in (*self._servers, self._switch, *keepers):
            with helper:
                helper.kill()
