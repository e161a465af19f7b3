# SPDX-License-Identifier: Apache-2.0
"""Supervised processes at the terminal: their log lines and their start."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.formatting import print_line
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.process_report import UP_ON, ProcessReport
from bt_agents_tools.launcher.supervisor import Component, Supervisor

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

POLL_S = 0.2
"""Time between two checks of the processes [s]."""

INDENT = 4

_START_LIMIT_S = 20.0


def watch(observer: Observer, supervisor: Supervisor, processes: Sequence[Component]) -> None:
    """Connect a supervisor to the heartbeats and states of its nodes, and report its processes."""
    beating = components.nodes_of(processes, components.BEATING)
    observer.watch_heartbeats(supervisor.on_heartbeat, beating)
    managed = components.nodes_of(processes, components.MANAGED)
    observer.watch_states(supervisor.on_state, managed)
    report = ProcessReport(supervisor.processes, supervisor.unknown_parameters)
    observer.judge_health(f"{UP_ON}{socket.gethostname()}", report.parts)


@contextmanager
def stopping(
    console: Console, observer: Observer, supervisor: Supervisor, interrupt: Interrupt
) -> Iterator[None]:
    """End the processes at the end of this block, close the observer, and say how it ended."""
    try:
        try:
            yield
        finally:
            killed = supervisor.stop()
    finally:
        observer.close()
    if interrupt:
        console.print("\nstopped")
    if killed:
        console.print(f"[yellow]had to be killed: {', '.join(killed)}[/]")


def print_supervised(console: Console, observer: Observer, supervisor: Supervisor) -> None:
    """Restart and kill processes as needed; report them, and print the events since the last call.

    The report goes to ``/diagnostics``.
    """
    events = supervisor.poll()
    observer.publish_health()
    for line in events:
        style = "dim" if line.startswith(" ") else "yellow"
        indent = len(line) - len(line.lstrip())
        print_line(console, "", Text(line, style=style), indent + INDENT)


def wait_until_ready(
    console: Console,
    observer: Observer,
    supervisor: Supervisor,
    interrupt: Interrupt,
    ready: Callable[[], bool],
) -> None:
    """Wait until the started processes are ready, or the user interrupts.

    Raises:
        BtAgentsError: They are not ready in time.
    """
    # Checks are counted, so that a pause of the machine takes no time from the start.
    for _ in range(round(_START_LIMIT_S / POLL_S)):
        if interrupt or ready():
            break
        print_supervised(console, observer, supervisor)
        observer.spin_until(lambda: bool(interrupt) or ready(), POLL_S)
    if not interrupt and not ready():
        logs = supervisor.log("").parent
        raise BtAgentsError(f"not ready after {_START_LIMIT_S:g} s; the logs are in {logs}")
