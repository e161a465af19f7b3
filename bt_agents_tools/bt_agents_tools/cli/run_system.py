# SPDX-License-Identifier: Apache-2.0
"""Runs of a whole system by a command: supervised processes, printed events, clean end."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.text import Text

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import StateFolder
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros.signals import Interrupt, loading
from bt_agents_tools.cli.event_printer import EventPrinter
from bt_agents_tools.cli.formatting import print_line
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import hold_domain
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.supervisor import (
    Component,
    Supervisor,
    discovery_text,
    set_local_discovery,
)

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_READY_LIMIT_S = 20.0
_POLL_S = 0.2
_INDENT = 4

journal_option = click.option(
    "--journal",
    is_flag=False,
    flag_value="",
    metavar="[FOLDER]",
    help="Record all messages in MCAP files by day, for bt-agents replay.",
)


def journal_components(folder: str | None, state: StateFolder) -> list[Component]:
    """Return the journal as components: none for None; an empty text means the state folder.

    Raises:
        BtAgentsError: The package that it needs is not installed.
    """
    if folder is None:
        return []
    if find_spec("mcap") is None:
        raise BtAgentsError(
            "a journal needs the package mcap; install it with pip install 'bt-agents[lab]'"
        )
    return [components.journal(Path(folder).resolve() if folder else state.journal)]


def run_system(
    command: str,
    processes: Sequence[Component],
    trees: Path,
    tags: str,
    interrupt: Interrupt,
    visitors: Component | None = None,
    logs: Path | None = None,
) -> None:
    """Run a system of processes until Ctrl-C, or until its visitors are done.

    Visitors are started when all is ready. Without ``logs`` these go to a new folder.
    """
    start = time.monotonic()
    set_local_discovery(os.environ)
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    hold_domain(int(domain), f"'bt-agents {command}' of {trees.resolve()} (process {os.getpid()})")
    with loading():
        from bt_agents_ros.installed import InstalledInterfaces
        from bt_agents_tools.client.observer import Observer, profiles_by_agent

    console = Console()
    folder = read_trees(trees, InstalledInterfaces()).tagged(tags)
    for broken in folder.broken:
        console.print("[yellow]left out, the other agents run:[/]")
        console.print(broken.error.report, markup=False, highlight=False, soft_wrap=True)
    if not folder.agents:
        raise BtAgentsError(f"there is no agent to run in {trees / 'agents'}")
    supervisor = Supervisor(logs or new_log_folder())
    printer = EventPrinter(console, folder.scene.space)
    observer = Observer(printer)
    observer.watch_heartbeats(supervisor.on_heartbeat)
    try:
        observer.spin_until(lambda: bool(interrupt) or observer.market is not None, 0.5)
        if observer.market is not None:
            raise BtAgentsError(
                f"a system already runs on ROS domain {domain}; end it, or set ROS_DOMAIN_ID to "
                "another number"
            )
        try:
            if not interrupt:
                supervisor.start(*processes)
            recorded = any(component.name == "journal" for component in processes)
            agents = len(folder.agents)
            _wait_until_ready(console, observer, supervisor, agents, interrupt, recorded)
            if not interrupt:
                printer.profiles(profiles_by_agent(observer.profiles))
                _print_ready(console, observer.cards.values(), time.monotonic() - start)
                _print_kept_orders(console, observer.market)
                _print_events(console, observer, supervisor, interrupt, visitors)
            if visitors is not None and not interrupt:
                printer.summary()
                console.print(f"done in {time.monotonic() - start:.0f} s")
        finally:
            killed = supervisor.stop()
    finally:
        observer.close()
    if interrupt:
        console.print("\nstopped")
    if killed:
        console.print(f"[yellow]had to be killed: {', '.join(killed)}[/]")


def _wait_until_ready(
    console: Console,
    observer: Observer,
    supervisor: Supervisor,
    agents: int,
    interrupt: Interrupt,
    recorded: bool,
) -> None:
    """Wait until all agents are registered, and recorded if the journal runs."""

    def ready() -> bool:
        ready = observer.ready(agents) and observer.services_ready()
        return ready and (observer.is_recorded() or not recorded)

    end = time.monotonic() + _READY_LIMIT_S
    while not (interrupt or ready()) and time.monotonic() < end:
        _poll_supervisor(console, supervisor)
        observer.spin_until(lambda: bool(interrupt) or ready(), _POLL_S)
    if not interrupt and not ready():
        logs = supervisor.log("agents").parent
        raise BtAgentsError(f"not ready after {_READY_LIMIT_S:g} s; the logs are in {logs}")


def _print_events(
    console: Console,
    observer: Observer,
    supervisor: Supervisor,
    interrupt: Interrupt,
    visitors: Component | None,
) -> None:
    """Print events until the visitors are done, however long that takes, or the user ends it."""
    if visitors is not None:
        supervisor.start(visitors)
    else:
        console.print(
            "in another terminal: [bold]bt-agents trigger age=4.5 mood=2[/]   (Ctrl-C ends this)",
            highlight=False,
        )
    while not (interrupt or observer.visits_done):
        _poll_supervisor(console, supervisor)
        observer.spin_until(lambda: bool(interrupt) or observer.visits_done, _POLL_S)


def _poll_supervisor(console: Console, supervisor: Supervisor) -> None:
    for line in supervisor.poll():
        style = "dim" if line.startswith(" ") else "yellow"
        indent = len(line) - len(line.lstrip())
        print_line(console, "", Text(line, style=style), indent + _INDENT)


def _print_kept_orders(console: Console, market: Any) -> None:
    """Print the pins and vetoes of an earlier start, which still hold."""
    if market.pinned:
        text = f"only {market.pinned} may bid, until 'bt-agents unpin'"
        print_line(console, "[yellow]still pinned[/] ", text, _INDENT)
    for agent in market.vetoed:
        text = f"{agent} may not bid, until 'bt-agents allow {agent}'"
        print_line(console, "[yellow]still vetoed[/] ", text, _INDENT)


def _print_ready(console: Console, cards: Iterable[Any], seconds: float) -> None:
    names = [agent.title for card in cards for agent in card.agents]
    text = (
        f"after {seconds:.1f} s: one robot, {len(names)} agents "
        f"({', '.join(names)}), ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}, "
        f"{discovery_text(os.environ)}"
    )
    print_line(console, "[green]ready[/] ", text, _INDENT)
