# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents roll-back`: an earlier version of an agent."""

from __future__ import annotations

import click

from bt_agents_tools.cli.commands.reload import NOW_HELP
from bt_agents_tools.cli.connection import accepted, connect, find_host


@click.command("roll-back")
@click.argument("agent")
@click.argument("version", required=False, type=click.IntRange(min=1), default=None)
@click.option("--now", is_flag=True, help=NOW_HELP)
def roll_back(agent: str, version: int | None, now: bool) -> None:
    """Give an AGENT an earlier VERSION; without one, that before the current.

    Its file is written back, so that the robot does what the file says.
    """
    with connect() as observer:
        from bt_agents_tools.client import reloading

        host = find_host(observer, agent)
        answer = reloading.roll_back(observer, host, agent, version or 0, now)
        click.echo(accepted(answer, f"the host {host}").message)
