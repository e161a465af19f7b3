# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents trigger`: a scene on the market, and its decision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import Refused
from bt_agents_tools.cli.assignments import Assignments, assignments, columns
from bt_agents_tools.cli.connection import accepted, connect
from bt_agents_tools.cli.decisions import SOON_S, admission_text, headline, names_of_scenes

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_DECIDE_LIMIT_S = 5.0
_PREEMPTION_LIMIT_S = 1.0
_REFUSED = ("BUSY", "QUEUE_FULL", "DUPLICATE", "SHUTTING_DOWN")


@click.command()
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--label", default="", help="Words for people.")
@click.option("--person/--no-person", default=True, help="Whether somebody is there.")
@click.option("--urgent", is_flag=True, help="Stop whoever runs, where new scenes preempt.")
def trigger(values: Assignments, label: str, person: bool, urgent: bool) -> None:
    """Put a scene on the market.

    For example: bt-agents trigger age=4.5 mood=2. What is not named is as measured, or missing.
    """
    with connect() as observer:
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

        observer.spin_until(lambda: decided() or waits(), _DECIDE_LIMIT_S)
        if waits():
            # A preemption round may still come, or a refusal.
            observer.spin_until(lambda: decided() or bool(rounds()), _PREEMPTION_LIMIT_S)
        known = observer.spin_until(decided, _DECIDE_LIMIT_S) if rounds() else decided()
        scene_names = names_of_scenes(auctions)
        if any(auction.outcome == auction.WAITS for auction in rounds()[-1:]):
            # The queue may be full.
            observer.spin_until(lambda: end() is not None, SOON_S)
        for auction in rounds():
            click.echo(f"round {auction.round}: {headline(auction)}")
            click.echo(scene_names.with_names(auction.reason))
        if end() is not None and end().code in _REFUSED:
            raise Refused(end().code, scene_names.with_names(end().message))
        if not known:
            state = scene_names.with_names(observer.market.message)
            click.echo(
                f"waits in line: {_queue_text(observer, urgent)}; {state}"
                if waits()
                else f"not decided yet, the market says: {state}"
            )


def _queue_text(observer: Observer, urgent: bool) -> str:
    """Return how many scenes wait, and a remark when urgency has no effect."""
    mode, waiting = admission_text(observer)
    if urgent and mode not in ("", "preempt"):
        waiting += f" (urgent counts only where new scenes preempt, here they {mode})"
    return waiting
