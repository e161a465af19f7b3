# SPDX-License-Identifier: Apache-2.0
"""Commands `bt-agents studio` for a browser, and `bt-agents watch` for terminals and programs."""

from __future__ import annotations

import os
import time
import uuid
import webbrowser
from collections.abc import Mapping
from pathlib import Path

import click

from bt_agents_core.state_folder import find_state
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros.signals import Interrupt, loading
from bt_agents_studio.access import SessionRole
from bt_agents_studio.feed import Feed
from bt_agents_studio.protocol import VERSION, Delta, Resume, Snapshot, encode
from bt_agents_studio.records import LogRecord
from bt_agents_studio.studio import Studio
from bt_agents_tools.cli.trees_choice import state_option, take_trees
from bt_agents_tools.launcher.supervisor import set_discovery

_PERIOD_S = 0.05
_FIND_S = 3.0
_PAST_S = 1.0
"""Time for receiving the past of each topic [s]."""


@click.command()
@click.argument("directory", required=False, default="")
@state_option
@click.option("--address", default="127.0.0.1", help="Address to listen on.", show_default=True)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port.  [default: 8770]")
@click.option(
    "--certificate",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Certificate for TLS, which any address other than this machine's needs.",
)
@click.option(
    "--key",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Key of the certificate, when it is a file of its own.",
)
@click.option(
    "--journal",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder of journals to look back into; by default the trees folder's own.",
)
@click.option("--open", "opens", is_flag=True, help="Open it in a browser.")
def studio(
    directory: str,
    state: str,
    address: str,
    port: int,
    certificate: Path | None,
    key: Path | None,
    journal: Path | None,
    opens: bool,
) -> None:
    """Show the running system of a trees DIRECTORY in a browser, until Ctrl-C."""
    trees = take_trees(directory)
    space = read_scene(trees / "scene.yaml").space
    found = find_state(trees, state)
    set_discovery(os.environ)
    with loading():
        import asyncio

        from bt_agents_studio.service import Address, serve

    def ready(addresses: Mapping[SessionRole, str]) -> None:
        click.echo(f"studio: {addresses[SessionRole.AUTHOR]}")
        click.echo(f"to write no files: {addresses[SessionRole.OPERATE]}")
        click.echo(f"to look on only: {addresses[SessionRole.VIEW]}")
        click.echo(f"to be the person: {addresses[SessionRole.PERSON]}")
        if opens:
            webbrowser.open(addresses[SessionRole.AUTHOR])

    served = serve(
        Address(host=address, port=port, certificate=certificate, key=key),
        space=space,
        journal=journal or found.journal,
        kept=found.path if found.path.is_dir() else None,
        ready=ready,
    )
    asyncio.run(served)


@click.command()
@click.argument("directory", required=False, default="")
@click.option("--json", "as_json", is_flag=True, help="Print the messages of the studio protocol.")
@click.option("--seconds", type=click.FloatRange(min=0), help="End after so long.")
def watch(directory: str, as_json: bool, seconds: float | None) -> None:
    """Print what happens in the running system of a trees DIRECTORY, until Ctrl-C.

    With --json it prints what a browser gets, one message a line: docs/studio.md.
    """
    trees = take_trees(directory)
    space = read_scene(trees / "scene.yaml").space
    set_discovery(os.environ)
    with loading():
        from bt_agents_studio.node import NodeThread
    interrupt = Interrupt()
    shown = Studio(uuid.uuid4().hex[:12], space=space)
    thread = NodeThread(shown, lambda: None)
    node = thread.start()
    node.watch(True)
    feed = Feed(shown.store, shown.history, shown.name)
    feed.take(Resume(version=VERSION, studio="", sequence=0))
    if as_json:
        click.echo(encode(shown.hello(SessionRole.VIEW, node.get_namespace())))
    began = time.monotonic()
    end = began + seconds if seconds is not None else float("inf")
    told = False
    lines: list[LogRecord] = []
    try:
        while not interrupt and time.monotonic() < end:
            time.sleep(_PERIOD_S)
            thread.handover.deliver(_PERIOD_S)
            shown.check_parts()
            if not told and time.monotonic() - began > _FIND_S:
                told = True
                if shown.store.get("market") is None:
                    click.echo("no system yet: start one with 'bt-agents up'", err=True)
            message = feed.next()
            if isinstance(message, Snapshot | Delta) and as_json:
                click.echo(encode(message))
            elif isinstance(message, Snapshot | Delta):
                lines += _log_records(message)
            if time.monotonic() - began > _PAST_S:
                _print_lines(lines)
    finally:
        thread.stop()
        _print_lines(lines)


def _log_records(message: Snapshot | Delta) -> list[LogRecord]:
    if isinstance(message, Snapshot):
        values = list(message.entries.get("log", {}).values())
    else:
        values = [value for collection, _, value in message.changes if collection == "log"]
    return [value for value in values if isinstance(value, LogRecord)]


def _print_lines(records: list[LogRecord]) -> None:
    """Print records by their times, and forget them."""
    for record in sorted(records, key=lambda one: one.at_s):
        moment = time.strftime("%H:%M:%S", time.localtime(record.at_s))
        who = f"{record.agent}: " if record.agent else ""
        click.echo(f"{moment} {record.kind:>8}  {who}{record.text}")
    records.clear()
