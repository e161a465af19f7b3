# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents reload`: immediate reload of changed files of agents."""

from __future__ import annotations

import sys

import click

from bt_agents_tools.cli.connection import accepted, connect, find_hosts

NOW_HELP = "Do not wait for the end of a run: cancel it, with its clean-up."


@click.command()
@click.option("--now", is_flag=True, help=NOW_HELP)
def reload(now: bool) -> None:
    """Look at the agents' files at once.

    Files that have changed are taken over by themselves; this says what has changed, what waits
    for the end of a run, and what is broken: then the exit code is 1.
    """
    is_accepted = True
    with connect() as observer:
        from bt_agents_tools.client import reloading

        for host in find_hosts(observer):
            answer = reloading.reload_agents(observer, host, now)
            if answer is None:
                accepted(answer, f"the host {host}")
            click.echo(answer.message)
            is_accepted = is_accepted and answer.accepted
    sys.exit(0 if is_accepted else 1)
