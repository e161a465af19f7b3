# SPDX-License-Identifier: Apache-2.0
"""Parts of a system that run on one of several machines."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_ros.signals import Interrupt, loading
from bt_agents_ros.system_topics import NODES
from bt_agents_tools.cli.aside_output import printing_aside
from bt_agents_tools.cli.connection import new_observer
from bt_agents_tools.cli.fleet_plan import FleetPlan
from bt_agents_tools.cli.formatting import INDENT, counted, print_line
from bt_agents_tools.cli.supervision import POLL_S, SupervisedSystem
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import current_domain, hold_domain
from bt_agents_tools.launcher.fork_server import ForkServer
from bt_agents_tools.launcher.network import open_to_network, prolong_requests
from bt_agents_tools.launcher.supervisor import Component, Supervisor, set_discovery

if TYPE_CHECKING:
    from pathlib import Path

    from bt_agents_language.files.folder_reader import Trees

PARTS = {
    "market": "marketplace",
    "scene": "scene_layer",
    "agents": components.HOST,
    "feedback": "feedback",
    "robot": "robot",
}
"""Part of a system, for people → name of its component."""

_LOOK_S = 0.5
_LONGEST_NAME = 60


def lan_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options for a system on several machines."""
    slow = click.option(
        "--slow-network",
        type=click.FloatRange(1.0, 20.0),
        default=1.0,
        metavar="FACTOR",
        help="Wait this much longer for other machines; the same on each, as 4 for 300 ms.",
    )
    lan = click.option(
        "--lan", is_flag=True, help="Work with other machines; everybody on the network is let in."
    )
    return lan(slow(command))


def join_network(lan: bool, slow_network: float) -> None:
    """Set the ROS environment according to the options of :func:`lan_options`.

    Raises:
        BtAgentsError: As in :func:`set_discovery`.
    """
    if lan:
        open_to_network(os.environ)
    else:
        set_discovery(os.environ)
    prolong_requests(os.environ, slow_network)


def named_parts(text: str) -> frozenset[str]:
    """Return the parts that an option names, such as ``market,scene``; all for an empty text.

    Raises:
        click.UsageError: There is no such part.
    """
    if not text:
        return frozenset(PARTS)
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in PARTS:
            text = (
                f"--only names '{name}', which is not a part of a system; expected some of "
                f"{', '.join(PARTS)}, with commas between; {did_you_mean(name, list(PARTS))}"
            )
            raise click.UsageError(text.rstrip("; "))
    return frozenset(names)


def read_agents(trees: Path, tags: str) -> Trees:
    """Return the agents with one of some tags; report broken files on standard error.

    Raises:
        BtAgentsError: There is none.
    """
    with loading():
        from bt_agents_language.files.folder_reader import read_trees
        from bt_agents_ros.installed import InstalledInterfaces

    folder = read_trees(trees, InstalledInterfaces()).tagged(tags)
    if folder.broken:
        click.echo(f"left out, the other agents run:\n{folder.report}", err=True)
    if not folder.agents:
        raise BtAgentsError(f"there is no agent to run in {trees / 'agents'}")
    return folder


def host_name(named: str) -> str:
    """Return the name of a host, which by default is made from its machine's name.

    Raises:
        click.UsageError: ROS does not accept it as the name of a node.
    """
    if not named:
        machine = re.sub(r"\W+", "_", socket.gethostname(), flags=re.ASCII).strip("_").lower()
        return f"{components.HOST}_{machine}"[:_LONGEST_NAME]
    if not re.fullmatch(r"[A-Za-z]\w*", named, re.ASCII) or len(named) > _LONGEST_NAME:
        raise click.UsageError(
            f"--name is '{named[:_LONGEST_NAME]}', expected letters, digits and '_', a letter "
            f"first, {_LONGEST_NAME} characters at most"
        )
    if named in NODES:
        raise click.UsageError(f"--name is '{named}', the name of another part; take another one")
    return named


def hold_parts(names: Sequence[str], who: str) -> None:
    """Make this process the only one on this machine that runs these components on its domain.

    Raises:
        BtAgentsError: Another process runs one of them.
    """
    if PARTS["market"] in names:
        hold_domain(current_domain(), who)
    for name in names:
        hold_domain(current_domain(), who, name)


@printing_aside()
def run_parts(
    command: str,
    parts: Sequence[Component],
    interrupt: Interrupt,
    logs: Path,
    fleet: FleetPlan | None = None,
) -> None:
    """Run parts of a system until Ctrl-C; other parts may come and go meanwhile.

    The fleet starts when they are ready. The ROS environment must be set.

    Raises:
        BtAgentsError: A part already runs on the domain, or does not start.
    """
    begun_s = time.monotonic()
    names = [part.name for part in parts]
    hold_parts(names, f"'bt-agents {command}' (process {os.getpid()})")
    with closing(ForkServer(module for part in parts for module in part.modules)) as fork_server:
        supervisor = Supervisor(logs, fork_server=fork_server)
        system = SupervisedSystem(
            parts,
            interrupt,
            console=Console(),
            observer=new_observer(),
            supervisor=supervisor,
            fleet=fleet,
        )
        with system.ending():
            _check_free(system, names)
            system.start(lambda: all(map(supervisor.has_been_up, names)))
            if not interrupt:
                system.print_ready(f"{', '.join(names)} on {socket.gethostname()}", begun_s)
            _tell_market(system)


def _check_free(system: SupervisedSystem, names: Sequence[str]) -> None:
    """Check that no part runs already, elsewhere or under another user.

    Raises:
        BtAgentsError: A part runs already.
    """
    system.spin_until(lambda: not system.observer.nodes_there().isdisjoint(names), _LOOK_S)
    taken = sorted(system.observer.nodes_there().intersection(names))
    if taken and not system.interrupt:
        raise BtAgentsError(
            f"{taken[0]} already runs on ROS domain {current_domain()}, perhaps on another "
            "machine; end it there, leave it out here, or set ROS_DOMAIN_ID to another number"
        )


def _tell_market(system: SupervisedSystem) -> None:
    """Print what the market has and refuses at each change, until the user ends it."""
    system.spin_until(lambda: system.observer.market is not None, _LOOK_S)
    told: list[str] = []
    if not system.interrupt:
        system.start_fleet()
    while not system.interrupt:
        system.poll()
        lines = ["none so far: waiting for it"]
        if (market := system.observer.market) is not None:
            lines = [f"{counted(market.hosts, 'host')}, {counted(market.agents, 'agent')}"]
            lines += [f"refuses {host}" for host in market.refused_hosts]
        for line in lines if lines != told else ():
            print_line(system.console, "[bold]market[/] ", line, INDENT)
        told = lines
        system.spin_until(lambda: False, POLL_S)
