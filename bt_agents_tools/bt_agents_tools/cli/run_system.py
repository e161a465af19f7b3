# SPDX-License-Identifier: Apache-2.0
"""Runs of a whole system by a command: supervised processes, printed events, clean shutdown."""

from __future__ import annotations

import json
import os
import time
import webbrowser
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from socket import socket
from typing import Any

import click
from rich.console import Console

from bt_agents.host.reload.host_card_diff import problem_text
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.listening import STUDIO_PORTS, listen
from bt_agents_core.optional_packages import journal_needs
from bt_agents_core.state_folder import STUDIO_ADDRESSES, StateFolder
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.aside_output import printing_aside
from bt_agents_tools.cli.connection import new_observer
from bt_agents_tools.cli.event_printer import EventPrinter
from bt_agents_tools.cli.fleet_plan import FleetPlan
from bt_agents_tools.cli.formatting import INDENT, counted, print_line
from bt_agents_tools.cli.run_parts import hold_parts, read_agents
from bt_agents_tools.cli.supervision import POLL_S, SupervisedSystem
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import current_domain
from bt_agents_tools.launcher.fork_server import ForkServer
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.supervisor import Component, Supervisor, set_discovery

_LOOK_S = 0.5
"""Time from the start of discovery until another market would have been heard [s]."""

_LEAST_LOOK_S = 0.1
"""Time to take the messages that arrived while the trees were read [s]."""

one_process_option = click.option(
    "--one-process",
    is_flag=True,
    help="Run all nodes in one process, for a small robot: less memory and time, no isolation.",
)

journal_option = click.option(
    "--journal",
    is_flag=False,
    flag_value="",
    metavar="[FOLDER]",
    help="Record all messages in MCAP files by day, for bt-agents replay.",
)


def journal_components(folder: str | None, state: StateFolder) -> list[Component]:
    """Return the components of the journal: none for None; an empty text means the state folder.

    Raises:
        BtAgentsError: A package that it needs is not installed.
    """
    if folder is None:
        return []
    if find_spec("mcap") is None:
        raise BtAgentsError(journal_needs("mcap"))
    return [components.journal(Path(folder).resolve() if folder else state.journal)]


@dataclass(frozen=True, kw_only=True)
class StudioPlan:
    """Studio that starts when the system is ready.

    Attributes:
        component: Its process.
        addresses: The process stores the addresses of its roles in this file.
        listening: Socket that it serves; the socket outlives the process.
        asks_person: Whether to print the address for the person, too.
        opens: Whether to open it in a browser.
    """

    component: Component
    addresses: Path
    listening: socket
    asks_person: bool = False
    opens: bool = False


def studio_plan(
    trees: Path, state: Path, journal: Path, *, browser_robot: bool, opens: bool = False
) -> StudioPlan | None:
    """Return the studio of a system; None, after a line that says why, if it cannot run here.

    Args:
        trees: The trees folder.
        state: Folder for its sessions and addresses.
        journal: Folder of the recordings.
        browser_robot: The robot appears in the browser, so the studio is required.
        opens: See :class:`StudioPlan`.

    Raises:
        BtAgentsError: It is required, and cannot run.
    """
    try:
        if find_spec("aiohttp") is None:
            raise BtAgentsError("it needs the package aiohttp; pip install aiohttp gets it")
        listening = listen("127.0.0.1", STUDIO_PORTS)
    except BtAgentsError as error:
        if browser_robot:
            raise
        click.echo(f"no studio: {error}", err=True)
        return None
    addresses = state / STUDIO_ADDRESSES
    addresses.unlink(missing_ok=True)
    return StudioPlan(
        component=components.studio(trees, state, journal, listening.fileno()),
        addresses=addresses,
        listening=listening,
        asks_person=browser_robot,
        opens=opens,
    )


@printing_aside()
def run_system(
    command: str,
    processes: Sequence[Component],
    trees: Path,
    tags: str,
    interrupt: Interrupt,
    visitors: Component | None = None,
    logs: Path | None = None,
    studio: StudioPlan | None = None,
    fleet: FleetPlan | None = None,
) -> bool:
    """Run a system of processes until Ctrl-C, or until its visitors are done.

    Visitors, the studio and the fleet start when everything is ready. Without ``logs``, log files
    go to a new folder.

    Returns:
        False if a change of a visit had no effect.
    """
    begun_s = time.monotonic()
    set_discovery(os.environ)
    who = f"'bt-agents {command}' of {trees.resolve()} (process {os.getpid()})"
    hold_parts([name for one in processes for name in one.parts or (one.name,)], who)
    modules = [one for component in processes for one in component.modules]
    with (
        closing(studio.listening) if studio is not None else nullcontext(),
        # It loads the modules of the nodes while this process loads its own.
        closing(ForkServer(modules)) as fork_server,
    ):
        console = Console()
        # Its discovery goes on while the trees are read.
        observer = new_observer()
        looks_until_s = time.monotonic() + _LOOK_S
        system = SupervisedSystem(
            processes,
            interrupt,
            console=console,
            observer=observer,
            supervisor=Supervisor(logs or new_log_folder(), fork_server=fork_server),
            fleet=fleet,
        )
        with system.ending():
            folder = read_agents(trees, tags)
            printer = EventPrinter(console, folder.scene.space)
            observer.notify(printer, is_new_robot="bt_agents_robot.robot" in modules)
            look_s = max(_LEAST_LOOK_S, looks_until_s - time.monotonic())
            system.spin_until(lambda: observer.market is not None, look_s)
            if observer.market is not None:
                raise BtAgentsError(
                    f"a system already runs on ROS domain {current_domain()}; end it, or set "
                    "ROS_DOMAIN_ID to another number"
                )
            system.start(lambda: _is_ready(system, len(folder.agents)))
            if not interrupt:
                from bt_agents_tools.client.observer import profiles_by_agent

                printer.profiles(profiles_by_agent(observer.profiles))
                names = [agent.title for card in observer.cards.values() for agent in card.agents]
                agents = f"{counted(len(names), 'agent')} ({', '.join(names)})"
                system.print_ready(f"one robot, {agents}", begun_s)
                _print_problems(console, observer.cards.values())
                _print_kept_orders(console, observer.market)
                _print_events(system, visitors, studio)
            if visitors is not None and not interrupt:
                printer.summary()
                console.print(f"done in {time.monotonic() - begun_s:.0f} s")
    return visitors is None or bool(interrupt) or not printer.remarks


def _is_ready(system: SupervisedSystem, agents: int) -> bool:
    """Return whether all agents are registered, topics discovered, and any journal records."""
    observer, processes = system.observer, system.processes
    recorded = any(component.name == "journal" for component in processes)
    heard = ("bt_agents/scene", "agents/status", "bt_agents/feedback")
    ready = observer.ready(agents) and observer.services_ready()
    return ready and (observer.is_recorded() or not recorded) and all(map(observer.hears, heard))


def _print_events(
    system: SupervisedSystem, visitors: Component | None, studio: StudioPlan | None
) -> None:
    """Print events until the visitors of this command are done or the user ends it.

    Visitors that another command started do not end it.
    """

    def done() -> bool:
        return visitors is not None and system.observer.visits_done

    if visitors is not None:
        system.supervisor.start(visitors)
    else:
        system.console.print(
            "in another terminal: [bold]bt-agents trigger age=4.5 mood=2[/]   (Ctrl-C ends this)",
            highlight=False,
        )
    if studio is not None:
        system.supervisor.start(studio.component)
    system.start_fleet()
    while not (system.interrupt or done()):
        system.poll()
        if studio is not None and system.supervisor.has_been_up(studio.component.name):
            _tell_addresses(system.console, studio)
            studio = None
        system.spin_until(done, POLL_S)


def _tell_addresses(console: Console, studio: StudioPlan) -> None:
    try:
        found = json.loads(studio.addresses.read_text(encoding="utf-8"))
        told: Mapping[str, str] = {role: str(found[role]) for role in ("author", "person")}
    except (KeyError, OSError, TypeError, ValueError) as error:
        console.print(f"the addresses of the studio cannot be read: {error}", markup=False)
        return
    lines = [("studio", told["author"])]
    if studio.asks_person:
        lines.append(("to be the person", told["person"]))
    for name, address in lines:
        console.print(f"[bold]{name}:[/] {address}", highlight=False, soft_wrap=True)
    if studio.opens:
        # Both pages have the same role, because a browser has one session at a time.
        page, _, token = told["author"].partition("#")
        for name in ("market", "person"):
            webbrowser.open(f"{page}{name}#{token}")


def _print_kept_orders(console: Console, market: Any) -> None:
    """Print the pins and vetoes of an earlier start that still hold."""
    if market.pinned:
        text = f"only {market.pinned} may bid, until 'bt-agents unpin'"
        print_line(console, "[yellow]still pinned[/] ", text, INDENT)
    for agent in market.vetoed:
        text = f"{agent} may not bid, until 'bt-agents allow {agent}'"
        print_line(console, "[yellow]still vetoed[/] ", text, INDENT)


def _print_problems(console: Console, cards: Iterable[Any]) -> None:
    """Print the problems of hosts outside the files, which have been printed already."""
    for card in cards:
        for problem in card.problems:
            if not problem.file:
                print_line(console, "[yellow]problem[/] ", problem_text(problem), INDENT)
