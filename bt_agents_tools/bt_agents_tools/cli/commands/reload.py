# SPDX-License-Identifier: Apache-2.0
"""Commands for the versions of agents: `bt-agents reload`, `versions` and `roll-back`."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from bt_agents_tools.cli.connection import accepted, connect, find_host, find_hosts
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options

_now = click.option(
    "--now", is_flag=True, help="Do not wait for the end of a run: cancel it, with its clean-up."
)


@click.command()
@_now
def reload(now: bool) -> None:
    """Look at the agents' files at once.

    Files that have changed are taken over by themselves; this says what has changed, what waits
    for the end of a run, and what is broken: then the exit code is 1.
    """
    is_accepted = True
    with connect() as observer:
        for host in find_hosts(observer):
            answer = observer.ask(f"{host}/reload", limit_s=_limit_s(), now=now)
            if answer is None:
                accepted(answer, f"the host {host}")
            click.echo(answer.message)
            is_accepted = is_accepted and answer.accepted
    sys.exit(0 if is_accepted else 1)


@click.command()
@click.argument("agent")
@table_options
def versions(agent: str, form: TableForm) -> None:
    """List the good versions that an AGENT has had since its host was started."""
    with connect() as observer:
        answer = observer.ask(f"{find_host(observer, agent)}/versions", agent=agent)
        found = accepted(answer, f"the host of {agent}").versions
    if form.for_program:
        columns = [Column(key=key) for key in _KEYS]
        print_table(columns, [_cells(version) for version in found], form)
        return
    for version in found:
        click.echo(_line(version))


@click.command("roll-back")
@click.argument("agent")
@click.argument("version", required=False, type=click.IntRange(min=1), default=None)
@_now
def roll_back(agent: str, version: int | None, now: bool) -> None:
    """Give an AGENT an earlier VERSION; without one, that before the current.

    Of a file that is broken it is the one in force. The file is written back, so that the robot
    does what the file says.
    """
    with connect() as observer:
        host = find_host(observer, agent)
        answer = observer.ask(
            f"{host}/roll_back", limit_s=_limit_s(), agent=agent, version=version or 0, now=now
        )
        click.echo(accepted(answer, f"the host {host}").message)


_KEYS = ("version", "time_s", "cause", "change", "current", "waiting")


def _cells(version: Any) -> tuple[object, ...]:
    stamp = version.stamp.sec + version.stamp.nanosec * 1e-9
    changed = (version.cause, version.change)
    return (version.version, stamp, *changed, version.current, version.waiting)


def _limit_s() -> float:
    """Return the longest time for an answer that waits for files to be read [s]."""
    from bt_agents.host.reload.reload_service import ANSWER_LIMIT_S

    return ANSWER_LIMIT_S + 2.0


def _line(version: Any) -> str:
    read_at = time.strftime("%H:%M:%S", time.localtime(version.stamp.sec))
    place = "in force" if version.current else "waits for the end of the run" * version.waiting
    change = f": {version.change}" if version.change else ""
    mark = "*" if version.current else "+" if version.waiting else " "
    return f"{mark} {version.version:>4}  {read_at}  {version.cause}{change}" + (
        f"  ({place})" if place else ""
    )
