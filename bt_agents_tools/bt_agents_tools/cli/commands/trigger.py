# SPDX-License-Identifier: Apache-2.0
"""`bt-agents trigger`: a scene put on the market, and the decision about it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import Refused
from bt_agents_tools.cli.assignments import Assignments, assignments, columns
from bt_agents_tools.cli.connection import accepted, running_system
from bt_agents_tools.cli.decisions import admission, headline, names_of_scenes

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_DECIDE_LIMIT_S = 5.0
_PREEMPTION_LIMIT_S = 1.0
_END_LIMIT_S = 0.3

_NOT_TAKEN = ("BUSY", "QUEUE_FULL", "DUPLICATE", "SHUTTING_DOWN")


@click.command()
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--label", default="", help="Words for people.")
@click.option("--person/--no-person", default=True, help="Whether somebody is there.")
@click.option("--urgent", is_flag=True, help="Stop whoever runs, where new scenes preempt.")
def trigger(values: Assignments, label: str, person: bool, urgent: bool) -> None:
    """Put a scene on the market.

    For example: bt-agents trigger age=4.5 mood=2. What is not named is as measured, or missing.
    """
    with running_system() as observer:
        from bt_agents_tools.client import system

        auctions, ends = system.decisions(observer), system.scene_ends(observer)
        names, numbers = columns(values)
        answer = system.analyze(
            observer, names, numbers, label=label, person=person, urgent=urgent, announce=True
        )
        mine = accepted(answer, "the scene layer").scene.scene_id

        def rounds() -> list[Any]:
            return [auction for auction in auctions if auction.scene.scene_id == mine]

        def end() -> Any:
            return next((end for end in ends if end.scene_id == mine), None)

        def decided() -> bool:
            last = rounds()[-1:]
            return end() is not None or any(a.outcome != a.PREEMPTS for a in last)

        def waits() -> bool:
            return not rounds() and bool(observer.market.queued)

        observer.turn_until(lambda: decided() or waits(), _DECIDE_LIMIT_S)
        if waits():
            # It may still be asked about, or be refused.
            observer.turn_until(lambda: decided() or bool(rounds()), _PREEMPTION_LIMIT_S)
        known = observer.turn_until(decided, _DECIDE_LIMIT_S) if rounds() else decided()
        scene_names = names_of_scenes(auctions)
        if any(auction.outcome == auction.WAITS for auction in rounds()[-1:]):
            # There may be no room to wait.
            observer.turn_until(lambda: end() is not None, _END_LIMIT_S)
        for auction in rounds():
            click.echo(f"round {auction.round}: {headline(auction)}")
            click.echo(scene_names.in_words(auction.reason))
        if end() is not None and end().code in _NOT_TAKEN:
            raise Refused(end().code, scene_names.in_words(end().message))
        if not known:
            message = scene_names.in_words(observer.market.message)
            click.echo(
                f"waits in line: {_waiting_text(observer, urgent)}; {message}"
                if waits()
                else f"not decided yet, the market says: {message}"
            )


def _waiting_text(observer: Observer, urgent: bool) -> str:
    """Return how many scenes wait, and what an urgent one cannot expect."""
    mode, waiting = admission(observer)
    if urgent and mode not in ("", "preempt"):
        waiting += f" (urgent counts only where new scenes preempt, here they {mode})"
    return waiting
