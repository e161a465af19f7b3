# SPDX-License-Identifier: Apache-2.0
"""`bt-agents demo` and `bt-agents up`: the whole system as supervised processes."""

from __future__ import annotations

import math
import os
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.text import Text

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.paths import journal_folder, state_folder
from bt_agents_core.trees_folder import find_trees
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_ros.signals import Interrupt, loading
from bt_agents_tools.cli.event_printer import EventPrinter
from bt_agents_tools.cli.formatting import print_line
from bt_agents_tools.launcher import components as system
from bt_agents_tools.launcher.domain_lock import hold_domain, reserve_domain
from bt_agents_tools.launcher.supervisor import (
    Component,
    Supervisor,
    discovery_text,
    set_local_discovery,
)

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_DEMO_LIMIT_S = 55.0
_READY_LIMIT_S = 20.0
_LOOK_S = 0.2
_INDENT = 4
_NEIGHBOUR_S = 0.5


_journal = click.option(
    "--journal",
    is_flag=False,
    flag_value="",
    metavar="[FOLDER]",
    help="Record all messages in MCAP files by day, for bt-agents replay.",
)


@click.command()
@click.option("--voice/--no-voice", default=True, help="Speak aloud when espeak-ng is installed.")
@click.option(
    "--script",
    type=click.Path(path_type=Path),
    help="Another list of visits than the morning at the airport.",
)
@click.option("--tags", default="airport", show_default=True, help="Agents with these tags.")
@_journal
def demo(voice: bool, script: Path | None, tags: str, journal: str | None) -> None:
    """Show a morning at an airport, in a minute."""
    interrupt = Interrupt()
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    trees = find_trees()
    script = script or trees / "scripts" / "airport_morning.yaml"
    with tempfile.TemporaryDirectory(prefix="bt-agents-demo-") as folder:
        components = [
            system.robot(pace=1.0, voice="auto" if voice else "off"),
            system.market(trees),
            system.scene_layer(trees),
            system.host(trees, tags),
            system.feedback(trees, ledger=str(Path(folder) / "ledger.sqlite")),
            *_journals(journal),
        ]
        visitors = system.visitors(trees, script, pace=1.0)
        sys.exit(_run("demo", components, trees, tags, interrupt, visitors))


@click.command()
@click.argument("directory", required=False, default="")
@click.option("--robot/--no-robot", default=True, help="Start the simulated robot.")
@click.option("--tags", default="", help="Only agents with one of these tags, as in a,b.")
@click.option("--bindings", default="", help="Robot whose bindings of skills are preferred.")
@click.option("--voice/--no-voice", default=True, help="Speak aloud when espeak-ng is installed.")
@click.option("--ledger", default="", help="File of the learned profiles.")
@click.option("--memory", default="", help="File in which measurements of known persons stay.")
@click.option(
    "--on-new-scene",
    type=click.Choice(["queue", "reject", "preempt"]),
    help="What becomes of a scene that comes during a run.  [default: queue]",
)
@click.option("--strategy", default="", help="How bids are ranked; see 'bt-agents strategy'.")
@click.option(
    "--selector",
    default="",
    metavar="URL",
    help="Have a language model rank bids: a server that speaks OpenAI's protocol.",
)
@click.option("--model", default="", help="Name of the model of the selector.")
@click.option(
    "--key-variable",
    default="",
    help="Environment variable with the key of that server.",
)
@click.option(
    "--params",
    type=click.Path(exists=True, dir_okay=False, resolve_path=True, path_type=Path),
    help="ROS parameter file for all nodes; what 'up' sets by itself wins.",
)
@_journal
def up(
    directory: str,
    robot: bool,
    tags: str,
    bindings: str,
    voice: bool,
    ledger: str,
    memory: str,
    on_new_scene: str | None,
    strategy: str,
    selector: str,
    model: str,
    key_variable: str,
    params: Path | None,
    journal: str | None,
) -> None:
    """Keep the agents of a trees DIRECTORY running.

    In another terminal: bt-agents trigger age=4.5 mood=2, sense, cancel, status, why, feedback.
    """
    profiles = ledger or str(state_folder() / "ledger.sqlite")
    if memory and Path(memory).resolve() == Path(profiles).resolve():
        raise click.UsageError("--memory names the ledger; it needs a file of its own")
    interrupt = Interrupt()
    trees = find_trees(directory)
    logs = system.new_log_folder()
    components = [
        system.market(
            trees,
            on_new_scene or "",
            strategy or ("external" if selector else ""),
            orders=str(logs / "orders.json"),
        ),
        system.scene_layer(trees, memory=memory),
        system.host(trees, tags, bindings, str(state_folder() / "tunings.jsonl")),
        system.feedback(trees, ledger=profiles),
    ]
    if bool(selector) != bool(model):
        raise click.UsageError("--selector and --model go together: the server, and its model")
    if selector:
        components.append(system.selector(trees, selector, model, key_variable))
        if strategy not in ("", "external"):
            click.echo(f"{strategy} ranks; 'bt-agents strategy external' has the selector asked")
    if robot:
        components.append(system.robot(pace=1.0, voice="auto" if voice else "off"))
    components += _journals(journal)
    components = [replace(component, file=params) for component in components]
    sys.exit(_run("up", components, trees, tags, interrupt, logs=logs))


def _journals(folder: str | None) -> list[Component]:
    """Return the journal that is asked for, if any.

    Raises:
        BtAgentsError: What it needs is not installed.
    """
    if folder is None:
        return []
    if find_spec("mcap") is None:
        raise BtAgentsError(
            "a journal needs the package mcap; install it with pip install 'bt-agents[lab]'"
        )
    return [system.journal(Path(folder).resolve() if folder else journal_folder())]


def _run(
    command: str,
    components: Sequence[Component],
    trees: Path,
    tags: str,
    interrupt: Interrupt,
    visitors: Component | None = None,
    logs: Path | None = None,
) -> int:
    """Run a system until it is told to stop, or until the visitors are done.

    Args:
        command: Its name.
        components: Its processes.
        trees: Its trees folder.
        tags: Only agents with one of these tags.
        interrupt: Tells when somebody wants an end.
        visitors: Started when all is ready; None for none.
        logs: Folder for the logs; None for a new one.
    """
    start = time.monotonic()
    set_local_discovery(os.environ)
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    hold_domain(int(domain), f"'bt-agents {command}' of {trees.resolve()} (process {os.getpid()})")
    with loading():
        from bt_agents_ros.installed import InstalledInterfaces
        from bt_agents_tools.client import observer as graph

    console = Console()
    folder = read_trees(trees, InstalledInterfaces()).tagged(tags)
    _show_broken(console, folder)
    if not folder.agents:
        raise BtAgentsError(f"there is no agent to run in {trees / 'agents'}")
    supervisor = Supervisor(logs or system.new_log_folder())
    story = EventPrinter(console, folder.scene.space)
    observer = graph.Observer(story)
    observer.watch_heartbeats(supervisor.on_heartbeat)
    try:
        observer.spin_until(lambda: bool(interrupt) or observer.market is not None, _NEIGHBOUR_S)
        if observer.market is not None:
            raise BtAgentsError(
                f"a system already runs on ROS domain {domain}; end it, or set ROS_DOMAIN_ID to "
                "another number"
            )
        try:
            if not interrupt:
                supervisor.start(*components)
            kept = any(component.name == "journal" for component in components)
            _get_ready(console, observer, supervisor, len(folder.agents), interrupt, kept)
            if not interrupt:
                story.profiles(graph.profiles_by_agent(observer.profiles))
                _welcome(console, observer.cards.values(), time.monotonic() - start)
                _follow(console, observer, supervisor, interrupt, visitors, start)
            if visitors is not None and not interrupt:
                story.summary()
                console.print(f"done in {time.monotonic() - start:.0f} s")
        finally:
            killed = supervisor.stop()
    finally:
        observer.close()
    if interrupt:
        console.print("\nstopped")
    if killed:
        console.print(f"[yellow]had to be killed: {', '.join(killed)}[/]")
    return 0


def _get_ready(
    console: Console,
    observer: Observer,
    supervisor: Supervisor,
    agents: int,
    interrupt: Interrupt,
    kept: bool,
) -> None:
    """Wait until all agents are registered, and recorded if a journal is kept.

    Raises:
        BtAgentsError: A process cannot start, or it takes too long.
    """

    def ready() -> bool:
        ready = observer.ready(agents) and observer.services_ready()
        return ready and (observer.is_recorded() or not kept)

    end = time.monotonic() + _READY_LIMIT_S
    while not (interrupt or ready()) and time.monotonic() < end:
        _keep_alive(console, supervisor)
        observer.spin_until(lambda: bool(interrupt) or ready(), _LOOK_S)
    if not interrupt and not ready():
        logs = supervisor.log("agents").parent
        raise BtAgentsError(f"not ready after {_READY_LIMIT_S:g} s; the logs are in {logs}")


def _follow(
    console: Console,
    observer: Observer,
    supervisor: Supervisor,
    interrupt: Interrupt,
    visitors: Component | None,
    start: float,
) -> None:
    """Tell what happens, until the visitors are done or the user ends it.

    Raises:
        BtAgentsError: The visitors have ended by themselves, or take too long.
    """
    limit = math.inf
    if visitors is not None:
        limit = start + _DEMO_LIMIT_S
        supervisor.start(visitors)
    else:
        console.print(
            "in another terminal: [bold]bt-agents trigger age=4.5 mood=2[/]   (Ctrl-C ends this)",
            highlight=False,
        )
    while not (interrupt or observer.visits_done):
        _keep_alive(console, supervisor)
        if time.monotonic() > limit:
            raise BtAgentsError(f"the demo did not end within {_DEMO_LIMIT_S:g} s")
        observer.spin_until(lambda: bool(interrupt) or observer.visits_done, _LOOK_S)


def _keep_alive(console: Console, supervisor: Supervisor) -> None:
    for line in supervisor.poll():
        style = "dim" if line.startswith(" ") else "yellow"
        indent = len(line) - len(line.lstrip())
        print_line(console, "", Text(line, style=style), indent + _INDENT)


def _show_broken(console: Console, folder: Trees) -> None:
    for broken in folder.broken:
        console.print("[yellow]left out, the other agents run:[/]")
        console.print(broken.error.report, markup=False, highlight=False, soft_wrap=True)


def _welcome(console: Console, cards: Iterable[Any], seconds: float) -> None:
    names = [agent.title for card in cards for agent in card.agents]
    words = (
        f"after {seconds:.1f} s: one robot, {len(names)} agents "
        f"({', '.join(names)}), ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}, "
        f"{discovery_text(os.environ)}"
    )
    print_line(console, "[green]ready[/] ", words, _INDENT)
