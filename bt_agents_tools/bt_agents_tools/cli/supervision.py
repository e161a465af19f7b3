# SPDX-License-Identifier: Apache-2.0
"""Supervised processes at the terminal: their start, their log lines and their end."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.fleet_plan import FleetPlan
from bt_agents_tools.cli.formatting import INDENT, print_line
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import current_domain
from bt_agents_tools.launcher.process_report import UP_ON, ProcessReport
from bt_agents_tools.launcher.supervisor import Component, Supervisor, discovery_text

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

POLL_S = 0.2
"""Time between two checks of the processes [s]."""

_START_LIMIT_S = 20.0
_START_POLL_S = 0.02


class SupervisedSystem:
    """Processes of a system that a command runs, with their supervisor and their observer.

    The supervisor gets heartbeats and states of its nodes from the observer, which reports its
    processes to ``/diagnostics``.

    Args:
        processes: The processes, without those that start when they are ready.
        interrupt: Set when the user ends the command.
        fleet: Fleet whose lines are printed.
    """

    def __init__(
        self,
        processes: Sequence[Component],
        interrupt: Interrupt,
        *,
        console: Console,
        observer: Observer,
        supervisor: Supervisor,
        fleet: FleetPlan | None = None,
    ) -> None:
        self.processes = processes
        self.interrupt = interrupt
        self.console = console
        self.observer = observer
        self.supervisor = supervisor
        self._fleet = fleet
        beating = components.nodes_of(processes, components.BEATING)
        observer.watch_heartbeats(supervisor.on_heartbeat, beating)
        self._not_beating = components.nodes_of(processes) - beating
        managed = components.nodes_of(processes, components.MANAGED)
        observer.watch_states(supervisor.on_state, managed)
        report = ProcessReport(supervisor.processes, supervisor.unknown_parameters)
        observer.judge_health(f"{UP_ON}{socket.gethostname()}", report.parts)

    @contextmanager
    def ending(self) -> Iterator[None]:
        """End the processes at the end of this block, and say how it ended."""
        try:
            yield
        finally:
            killed = self.supervisor.stop()
        if self.interrupt:
            self.console.print("\nstopped")
        if killed:
            self.console.print(f"[yellow]had to be killed: {', '.join(killed)}[/]")

    def start(self, ready: Callable[[], bool]) -> None:
        """Start the processes, and wait until they are ready or the user interrupts.

        Raises:
            BtAgentsError: They are not ready in time.
        """
        if self.interrupt:
            return
        self.supervisor.start(*self.processes)
        # Checks are counted, so that a pause of the machine takes no time from the start.
        for _ in range(round(_START_LIMIT_S / _START_POLL_S)):
            if self.interrupt or ready():
                return
            self.poll()
            self.spin_until(ready, _START_POLL_S)
        if not self.interrupt and not ready():
            logs = self.supervisor.log("").parent
            raise BtAgentsError(f"not ready after {_START_LIMIT_S:g} s; the logs are in {logs}")

    def start_fleet(self) -> None:
        """Start the fleet, if there is one."""
        if self._fleet is not None:
            self.supervisor.start(self._fleet.component)

    def poll(self) -> None:
        """Restart and kill processes as needed, and print what happened since the last call."""
        # The middleware drops a node that hangs from the graph 20 s later.
        for name in self._not_beating & self.observer.nodes_there():
            self.supervisor.on_heartbeat(name)
        self.observer.publish_health()
        for line in self.supervisor.poll():
            style = "dim" if line.startswith(" ") else "yellow"
            indent = len(line) - len(line.lstrip())
            print_line(self.console, "", Text(line, style=style), indent + INDENT)
        if self._fleet is not None:
            self._fleet.print_lines(self.console)

    def spin_until(self, done: Callable[[], bool], limit_s: float) -> None:
        """Spin the observer until ``done()``, the user interrupts, or for a limited time."""
        self.observer.spin_until(lambda: bool(self.interrupt) or done(), limit_s, poll_s=POLL_S)

    def print_ready(self, what: str, begun_s: float) -> None:
        """Print that the system is ready, and the time since a steady time [s]."""
        text = (
            f"after {time.monotonic() - begun_s:.1f} s: {what}, ROS domain {current_domain()}, "
            f"{discovery_text(os.environ)}"
        )
        print_line(self.console, "[green]ready[/] ", text, INDENT)
