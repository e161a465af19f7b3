# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents keep`: writes tuned values back into the agents' files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bt_agents_tools.cli.connection import connect, find_host, find_hosts
from bt_agents_tools.client.file_edits import FileEdit, compare_tests, edits_of

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer


@click.command()
@click.argument("agents", nargs=-1, metavar="[AGENT]...")
@click.option("--profile", is_flag=True, help="Keep the learned profiles too.")
@click.option("--dry-run", is_flag=True, help="Show the changes without making them.")
@click.option("--yes", is_flag=True, help="Write without asking, even if tests then fail.")
def keep(agents: tuple[str, ...], profile: bool, dry_run: bool, yes: bool) -> None:
    """Write tuned values of AGENTs, or of all, into their files as the new defaults.

    Only those values change in the files; comments, order and quotes stay. tick_rate belongs to
    no agent and is not kept. Before that the agents' tests are run with the new values; when one
    fails that passed, you are asked.
    """
    observer = connect()
    edits = [
        edit
        for host in sorted({find_host(observer, a) for a in agents} or find_hosts(observer))
        for edit in _edits(observer, host, agents, profile)
    ]
    if not edits:
        click.echo("nothing to keep: everything stands as the files say")
        return
    for edit in edits if dry_run else ():
        click.echo(edit.diff, nl=False)
    tests = compare_tests(edits)
    for line in tests.lines:
        click.echo(line)
    if dry_run:
        return
    if tests.breaks and not yes:
        click.confirm("write it all the same? (--yes does not ask)", abort=True)
    for edit in edits:
        edit.write()
        for change in edit.changes:
            click.echo(f"{change}  in {edit.path}")


def _edits(observer: Observer, host: str, agents: Sequence[str], profile: bool) -> list[FileEdit]:
    from bt_agents_tools.client import tuning

    states = tuning.parameters(observer, host, agents)
    return edits_of(host, Path(observer.cards[host].trees), states, profile=profile)
