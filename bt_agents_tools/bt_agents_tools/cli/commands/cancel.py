# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents cancel`: end of the run under way, and of the scenes that wait."""

from __future__ import annotations

import click

from bt_agents_tools.cli.connection import accepted, connect


@click.command()
@click.option("--reason", default="the operator stopped it", help="Why, in words.")
@click.option("--next", "next_", is_flag=True, help="Go on with the next scene that waits.")
def cancel(reason: str, next_: bool) -> None:
    """Stop the running agent, and forget the scenes that wait."""
    with connect() as observer:
        from bt_agents_tools.client import system

        answer = system.cancel_run(observer, reason, observer.market.round if next_ else 0)
        click.echo(accepted(answer, "the marketplace").message)
