# SPDX-License-Identifier: Apache-2.0
"""`bt-agents reload`, `versions` and `roll-back`: agents that change while the system runs."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from bt_agents_tools.cli.connection import accepted, connect, find_host, find_hosts

_NOW = "Do not wait for the end of a run: cancel it, with its clean-up."


@click.command()
@click.option("--now", is_flag=True, help=_NOW)
def reload(now: bool) -> None:
    """Look at the agents' files at once.

    Files that have changed are taken over by themselves; this says what has changed, what waits
    for the end of a run, and what is broken: then the exit code is 1.
    """
    fine = True
    with connect() as observer:
        from bt_agents_tools.client import reloading

        for host in find_hosts(observer):
            answer = reloading.reload_agents(observer, host, now)
            if answer is None:
                accepted(answer, f"the host {host}")
            click.echo(answer.message)
            fine = fine and answer.accepted
    sys.exit(0 if fine else 1)


@click.command()
@click.argument("agent")
def versions(agent: str) -> None:
    """List the good versions that an AGENT has had since its host was started."""
    with connect() as observer:
        from bt_agents_tools.client import reloading

        answer = reloading.list_versions(observer, find_host(observer, agent), agent)
        for version in accepted(answer, f"the host of {agent}").versions:
            click.echo(_line(version))


@click.command("roll-back")
@click.argument("agent")
@click.argument("version", required=False, type=click.IntRange(min=1), default=None)
@click.option("--now", is_flag=True, help=_NOW)
def roll_back(agent: str, version: int | None, now: bool) -> None:
    """Give an AGENT an earlier VERSION; without one, that before the current.

    Its file is written back, so that the robot does what the file says.
    """
    with connect() as observer:
        from bt_agents_tools.client import reloading

        host = find_host(observer, agent)
        answer = reloading.roll_back(observer, host, agent, version or 0, now)
        click.echo(accepted(answer, f"the host {host}").message)


def _line(version: Any) -> str:
    when = time.strftime("%H:%M:%S", time.localtime(version.stamp.sec))
    place = "in force" if version.current else "waits for the end of the run" * version.waiting
    change = f": {version.change}" if version.change else ""
    mark = "*" if version.current else "+" if version.waiting else " "
    return f"{mark} {version.version:>4}  {when}  {version.cause}{change}" + (
        f"  ({place})" if place else ""
    )
