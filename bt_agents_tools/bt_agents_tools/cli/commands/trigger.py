# SPDX-License-Identifier: Apache-2.0
"""Commands for the scene: `bt-agents trigger` puts one on the market, `sense` changes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import RefusedElsewhere
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_tools.cli.assignments import Assignments, assignments, columns
from bt_agents_tools.cli.connection import accepted, connect
from bt_agents_tools.cli.decisions import SOON_S, admission_text, headline, names_of_scenes

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_DECIDE_LIMIT_S = 5.0
_REFUSED = (RefusalCode.BUSY, RefusalCode.QUEUE_FULL, RefusalCode.SHUTTING_DOWN)


@click.command()
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--label", default="", help="Words for people.")
@click.option("--person/--no-person", default=True, help="Whether a person is there.")
@click.option(
    "--name", default="", help="Name of the person (person.name); each use counts as a visit."
)
@click.option("--urgent", is_flag=True, help="Stop the running agent, where new scenes preempt.")
def trigger(values: Assignments, label: str, person: bool, name: str, urgent: bool) -> None:
    """Put a scene on the market.

    For example: bt-agents trigger age=4.5 mood=2. Other values are as measured, or missing.
    """
    observer = connect()
    auctions = observer.received("bt_agents/auctions")
    ends = observer.received("bt_agents/scene_ends")
    answer = _analyze(
        observer, values, person, label=label, name=name, urgent=urgent, announce=True
    )
    mine = answer.scene.scene_id
    if answer.kept:
        click.echo(answer.message)

    def rounds() -> list[Any]:
        return [auction for auction in auctions if auction.scene.scene_id == mine]

    def end() -> Any:
        # A resent scene was taken before.
        mine_ended = (one for one in ends if one.scene_id == mine)
        return next((one for one in mine_ended if one.code != RefusalCode.DUPLICATE), None)

    def decided() -> bool:
        last = rounds()[-1:]
        return end() is not None or any(a.outcome != a.PREEMPTS for a in last)

    def waits() -> bool:
        return not rounds() and bool(observer.market.queued)

    observer.spin_until(lambda: decided() or waits(), _DECIDE_LIMIT_S)
    if waits():
        # A preemption round or a refusal may still follow.
        observer.spin_until(lambda: decided() or bool(rounds()), 1.0)
    known = observer.spin_until(decided, _DECIDE_LIMIT_S) if rounds() else decided()
    scene_names = names_of_scenes(auctions)
    if any(auction.outcome == auction.WAITS for auction in rounds()[-1:]):
        # The queue may be full.
        observer.spin_until(lambda: end() is not None, SOON_S)
    for auction in rounds():
        click.echo(f"round {auction.round}: {headline(auction)}")
        click.echo(scene_names.with_names(auction.reason))
    if end() is not None and end().code in _REFUSED:
        raise RefusedElsewhere(end().code, scene_names.with_names(end().message))
    if not known:
        state = scene_names.with_names(observer.market.message)
        click.echo(
            f"waits in line: {_queue_text(observer, urgent)}; {state}"
            if waits()
            else f"not decided yet, the market says: {state}"
        )
    elif end() is None and observer.market.awaited_hosts:
        click.echo(f"waits in line: {scene_names.with_names(observer.market.message)}")


@click.command()
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--person/--no-person", default=None, help="Whether a person is there.")
def sense(values: Assignments, person: bool | None) -> None:
    """Change the live scene of a run.

    For example: bt-agents sense mood=1.5, or bt-agents sense --no-person.
    """
    if not values and person is None:
        raise click.UsageError(
            "nothing is sensed; name a value, such as mood=1.5, or write --person or --no-person"
        )
    observer = connect()
    click.echo(_analyze(observer, values, person).message)


def _analyze(observer: Observer, values: Assignments, person: bool | None, **fields: Any) -> Any:
    presence = {None: "AS_MEASURED", True: "PRESENT", False: "ABSENT"}[person]
    names, numbers = columns(values)
    answer = observer.ask(
        "scene_layer/analyze", names=names, values=numbers, person=presence, **fields
    )
    return accepted(answer, "the scene layer")


def _queue_text(observer: Observer, urgent: bool) -> str:
    """Return the number of waiting scenes, and a remark if urgency has no effect."""
    mode, waiting = admission_text(observer)
    if urgent and mode not in ("", "preempt"):
        waiting += f" (urgent counts only where new scenes preempt, here they {mode})"
    return waiting
