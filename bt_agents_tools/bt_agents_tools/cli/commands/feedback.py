# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents feedback`: gives a person's feedback to an agent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import FeedbackKind
from bt_agents_tools.cli.assignments import Assignments, assignments, columns
from bt_agents_tools.cli.connection import FIND_LIMIT_S, accepted, connect

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer


@click.command()
@click.argument("kind", type=click.Choice(["positive", "negative", "direct", "set"]))
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--agent", default="", help="Agent; default: the one that runs, else the last one.")
@click.option("--reason", default="", help="Why, in words.")
def feedback(kind: str, values: Assignments, agent: str, reason: str) -> None:
    """Tell an agent how it did.

    For example: bt-agents feedback positive.

    Direct feedback names the wanted profile: bt-agents feedback direct age=5 mood=2. With set
    instead of direct the profile takes these values at once.
    """
    if kind in ("direct", "set") and not values:
        raise click.UsageError(
            f"{kind} feedback names the wanted values, for example: bt-agents feedback {kind} "
            "age=5 mood=2"
        )
    observer = connect()
    observer.spin_until(lambda: observer.profiles is not None, FIND_LIMIT_S)
    wanted = _wanted(observer, values) if kind in ("direct", "set") else columns(values)[1]
    answer = observer.ask(
        "feedback/give",
        agent=agent,
        kind=FeedbackKind[kind.upper()],
        values=wanted,
        source="command line",
        reason=reason,
    )
    answer = accepted(answer, "the feedback node")
    click.echo(f"{answer.message} (revision {answer.feedback.revision})")


def _wanted(observer: Observer, values: Assignments) -> list[float]:
    names = list(observer.profiles.parameters) if observer.profiles else []
    given = dict(values)
    unknown = [name for name in given if name not in names]
    if unknown:
        raise BtAgentsError(f"profiles have no '{unknown[0]}'; they have {', '.join(names)}")
    return [given.get(name, math.nan) for name in names]
