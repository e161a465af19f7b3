# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents preset`: manages named sets of values that are applied together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.commands.tune import ask_host, user
from bt_agents_tools.cli.connection import connect, find_host, find_hosts
from bt_agents_tools.cli.formatting import counted
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer


@click.group(invoke_without_command=True)
@click.pass_context
@table_options
def preset(context: click.Context, form: TableForm) -> None:
    """Keep values under a name, such as "morning", and apply them together.

    Without a command it lists the presets.
    """
    if context.invoked_subcommand is None:
        observer = connect()
        found = list(_presets(observer))
        if form.for_program:
            columns = [Column(key=key) for key in ("preset", "values", "agents")]
            print_table(columns, [_counts(one) for one in found], form)
            return
        if not found:
            click.echo("no preset yet; 'bt-agents preset save NAME' makes one")
        for one in found:
            name, values, agents = _counts(one)
            click.echo(f"{name:<24} {counted(values, 'value')}, {counted(agents, 'agent')}")


@preset.command()
@click.argument("name")
@click.argument("agents", nargs=-1, metavar="[AGENT]...")
@click.option("--replace", is_flag=True, help="Do not ask before a preset is overwritten.")
def save(name: str, agents: tuple[str, ...], replace: bool) -> None:
    """Keep the tunables and learning rates of AGENTs, or of all, under a NAME."""
    observer = connect()
    values = sum(len(one.names) for one in _presets(observer) if one.name == name)
    if values and not replace:
        what = f"preset '{name}' has {counted(values, 'value')} already"
        click.confirm(f"{what}; replace it? (--replace does not ask)", abort=True)
    by_host: dict[str, list[str]] = {}
    for agent in agents:
        by_host.setdefault(find_host(observer, agent), []).append(agent)
    for host, named in (by_host or {host: [] for host in find_hosts(observer)}).items():
        ask_host(observer, host, "SAVE", preset=name, agents=named)


@preset.command()
@click.argument("name")
@click.option("--reason", default="", help="Why, in words.")
@click.option("--author", default=user, show_default="you", help="Who makes the change.")
def apply(name: str, reason: str, author: str) -> None:
    """Give the values of the preset NAME, all or none."""
    observer = connect()
    for host in _hosts_with(observer, name):
        ask_host(observer, host, "APPLY", preset=name, reason=reason, author=author)


@preset.command()
@click.argument("name")
def forget(name: str) -> None:
    """Remove the preset NAME."""
    observer = connect()
    for host in _hosts_with(observer, name):
        ask_host(observer, host, "FORGET", preset=name)


@preset.command()
@click.argument("name")
@table_options
def show(name: str, form: TableForm) -> None:
    """Show the values of the preset NAME."""
    observer = connect()
    found = [one for one in _presets(observer) if one.name == name]
    if not found:
        raise BtAgentsError(f"no preset '{name}'; 'bt-agents preset' lists them")
    rows = [pair for one in found for pair in zip(one.names, one.values, strict=True)]
    if form.for_program:
        print_table([Column(key="name"), Column(key="value")], rows, form)
        return
    for key, value in rows:
        click.echo(f"{key:<40} {value}")


def _counts(one: Any) -> tuple[str, int, int]:
    """Return the name of a preset with the numbers of its values and agents."""
    return one.name, len(one.names), len({name.partition(".")[0] for name in one.names})


def _presets(observer: Observer) -> Iterable[Any]:
    from bt_agents_tools.client import tuning

    return [one for host in find_hosts(observer) for one in tuning.tunings(observer, host).presets]


def _hosts_with(observer: Observer, name: str) -> list[str]:
    """Return the hosts that have a preset; all if none has, so that their answers say so."""
    from bt_agents_tools.client import tuning

    every = find_hosts(observer)
    found = [
        host
        for host in every
        if len(every) > 1
        and any(one.name == name for one in tuning.tunings(observer, host).presets)
    ]
    return found or every
