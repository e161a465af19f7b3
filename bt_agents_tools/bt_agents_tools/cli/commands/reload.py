# SPDX-License-Identifier: Apache-2.0
"""Commands for the versions of agents: `bt-agents reload`, `versions` and `roll-back`."""

from __future__ import annotations

import sys

import click

from bt_agents_tools.cli.connection import accepted, connect, find_hosts


@click.command()
@click.option(
    "--now", is_flag=True, help="Do not wait for the end of a run: cancel it, with its clean-up."
)
def reload(now: bool) -> None:
    """Look at the agents' files at once.

    Changed files are taken over by themselves. This command lists changes, changes that wait for
    the end of a run, and broken files; with a broken file, the exit code is 1.
    """
    is_accepted = True
    observer = connect()
    for host in find_hosts(observer):
        answer = observer.ask(f"{host}/reload", limit_s=_limit_s(), now=now)
        if answer is None:
            accepted(answer, f"the host {host}")
        click.echo(answer.message)
        is_accepted = is_accepted and answer.accepted
    sys.exit(0 if is_accepted else 1)


def _limit_s() -> float:
    """Return the longest time for an answer that waits for files to be read [s]."""
    from bt_agents.host.reload.reload_service import ANSWER_LIMIT_S

    return ANSWER_LIMIT_S + 2.0
