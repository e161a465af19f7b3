# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents sense`: changed values of the live scene of a run."""

from __future__ import annotations

import click

from bt_agents_tools.cli.assignments import Assignments, assignments, columns
from bt_agents_tools.cli.connection import accepted, connect


@click.command()
@click.argument("values", nargs=-1, required=True, callback=assignments)
@click.option("--person/--no-person", default=None, help="Whether somebody is there.")
def sense(values: Assignments, person: bool | None) -> None:
    """Change the live scene of a run.

    For example: bt-agents sense mood=1.5.
    """
    with connect() as observer:
        from bt_agents_tools.client import system

        names, numbers = columns(values)
        answer = system.analyze(observer, names, numbers, person=person, announce=False)
        click.echo(accepted(answer, "the scene layer").message)
