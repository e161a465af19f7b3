# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents record`: starts and ends recordings, and marks moments in them."""

from __future__ import annotations

from typing import Any

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.commands.tune import author_option
from bt_agents_tools.cli.connection import BUSY_LIMIT_S, accepted, connect

_notes = click.option("--notes", default="", help="Notes about the moment or the recording.")


@click.group()
def record() -> None:
    """Start, end and mark what the journal of a running system records."""


@record.command()
@click.argument("label", default="")
@_notes
@author_option
def start(label: str, notes: str, author: str) -> None:
    """Begin a new file under a LABEL; nothing may be recorded when it begins.

    For example: bt-agents record start "school class, morning".
    """
    _ask("START", label=label, notes=notes, author=author)


@record.command()
@author_option
def stop(author: str) -> None:
    """End the file that is written; nothing is recorded until the next start."""
    _ask("STOP", author=author)


@record.command()
@click.argument("label", default="")
@_notes
@author_option
def mark(label: str, notes: str, author: str) -> None:
    """Mark the moment now with a LABEL, so that it is found again."""
    _ask("BOOKMARK", label=label, notes=notes, author=author)


def _ask(action: str, **fields: Any) -> None:
    observer = connect()
    answer = observer.ask("journal/record", find_s=BUSY_LIMIT_S, action=action, **fields)
    if answer is None:
        raise BtAgentsError(
            "no journal runs, so nothing can be recorded; 'bt-agents up --journal' starts the "
            "system with one"
        )
    click.echo(accepted(answer, "the journal").message)
