# SPDX-License-Identifier: Apache-2.0
"""The commands that speak to a running system: trigger, sense, cancel, status, why, feedback."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from bt_agents.cli.supervisor import keep_local
from bt_agents.errors import BtAgentsError, Refused

if TYPE_CHECKING:
    from bt_agents.ros.observer import Observer

_FIND_LIMIT_S = 3.0
_DECIDE_LIMIT_S = 5.0

_STATES = ("idle", "bidding", "awarding", "running", "cancelling", "collecting feedback")


Assignments = tuple[tuple[str, float], ...]


def _assignments(
    _context: click.Context, _parameter: click.Parameter, words: tuple[str, ...]
) -> Assignments:
    """Return ``name=number`` arguments as names and numbers."""
    assignments = []
    for word in words:
        name, equals, number = word.partition("=")
        try:
            assignments.append((name, float(number if equals and name else "")))
        except ValueError:
            raise click.BadParameter(
                f"'{word}' is not of the form name=number, for example age=4.5"
            ) from None
    return tuple(assignments)


@contextmanager
def _system() -> Iterator[Observer]:
    """Join the ROS graph of a running system."""
    keep_local(os.environ)
    from bt_agents.ros.observer import Observer

    observer = Observer()
    try:
        observer.turn_until(lambda: observer.market is not None, _FIND_LIMIT_S)
        if observer.market is None:
            raise BtAgentsError(
                f"no running system on ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}; start "
                "one with 'bt-agents up', or set ROS_DOMAIN_ID to its domain"
            )
        yield observer
    finally:
        observer.close()


def _accepted(answer: Any, who: str) -> Any:
    if answer is None:
        raise BtAgentsError(f"{who} does not answer; look at 'bt-agents status'")
    if not answer.accepted:
        raise Refused(getattr(answer, "code", "") or "REFUSED", answer.message)
    return answer


@click.command()
@click.argument("values", nargs=-1, callback=_assignments)
@click.option("--label", default="", help="Words for people.")
@click.option("--person/--no-person", default=True, help="Whether somebody is there.")
def trigger(values: Assignments, label: str, person: bool) -> None:
    """Put a scene on the market.

    For example: bt-agents trigger age=4.5 mood=2. What is not named is as measured, or missing.
    """
    with _system() as observer:
        from bt_agents.ros import client

        auctions = client.decisions(observer)
        names, numbers = _columns(values)
        answer = client.analyze(
            observer, names, numbers, label=label, person=person, announce=True
        )
        answer = _accepted(answer, "the scene layer")
        mine = answer.scene.scene_id

        def decided() -> bool:
            return any(auction.scene.scene_id == mine for auction in auctions)

        if observer.turn_until(decided, _DECIDE_LIMIT_S):
            auction = next(a for a in auctions if a.scene.scene_id == mine)
            click.echo(f"round {auction.round}: {auction.winner or 'nobody'}")
            click.echo(auction.reason)
        else:
            click.echo(f"not decided yet, the market says: {observer.market.message}")


@click.command()
@click.argument("values", nargs=-1, required=True, callback=_assignments)
@click.option("--person/--no-person", default=None, help="Whether somebody is there.")
def sense(values: Assignments, person: bool | None) -> None:
    """Change the live scene of a run.

    For example: bt-agents sense mood=1.5.
    """
    with _system() as observer:
        from bt_agents.ros import client

        names, numbers = _columns(values)
        answer = client.analyze(observer, names, numbers, person=person, announce=False)
        click.echo(_accepted(answer, "the scene layer").message)


@click.command()
@click.option("--reason", default="the operator stopped it", help="Why, in words.")
def cancel(reason: str) -> None:
    """Stop the running agent."""
    with _system() as observer:
        from bt_agents.ros import client

        answer = client.cancel_run(observer, reason)
        click.echo(_accepted(answer, "the marketplace").message)


@click.command()
def status() -> None:
    """Show what runs, all agents, and every problem."""
    with _system() as observer:
        observer.turn_until(lambda: bool(observer.cards), _FIND_LIMIT_S)
        market = observer.market
        click.echo(f"market    {_STATES[market.state]}: {market.message}")
        click.echo(
            f"          round {market.round}, {market.queued} scenes waiting, "
            f"{market.hosts} hosts, {market.agents} agents"
        )
        for host, card in sorted(observer.cards.items()):
            click.echo(f"host      {host}")
            for agent in card.agents:
                profile = _row(card.parameters, agent.current)
                click.echo(f"  {agent.name:<22} {profile}  (revision {agent.revision})")
            for problem in card.problems:
                click.echo(f"  problem: {problem}")


@click.command()
@click.argument("round_number", metavar="[ROUND]", required=False, type=int)
def why(round_number: int | None) -> None:
    """Say why an agent won, last or in a ROUND."""
    with _system() as observer:
        from bt_agents.ros import client

        auctions = client.decisions(observer)
        observer.turn_until(
            lambda: (auctions[-1].round if auctions else 0) >= observer.market.round,
            _FIND_LIMIT_S,
        )
        found = [a for a in auctions if round_number is None or a.round == round_number]
        if not found:
            kept = ", ".join(str(a.round) for a in auctions)
            raise BtAgentsError(
                f"no decision {'yet' if round_number is None else f'of round {round_number}'}"
                + (f"; there are rounds {kept}" if kept else "; 'bt-agents trigger' asks for one")
            )
        _explain(found[-1])


def _explain(auction: Any) -> None:
    values = ", ".join(
        f"{v.name} {'missing' if math.isnan(v.value) else format(v.value, 'g')}"
        for v in auction.scene.values
    )
    label = f" ({auction.scene.label})" if auction.scene.label else ""
    click.echo(f"round {auction.round}{label}: {values}")
    for bid in auction.ranking:
        click.echo(f"  {bid.agent:<22} {bid.calculation}")
    for bid in auction.refused:
        click.echo(f"  {bid.agent:<22} {bid.reason}")
    click.echo(auction.reason)


@click.command()
@click.argument("kind", type=click.Choice(["positive", "negative", "direct"]))
@click.argument("values", nargs=-1, callback=_assignments)
@click.option("--agent", default="", help="Whose; default: who runs, else who ran last.")
@click.option("--reason", default="", help="Why, in words.")
def feedback(kind: str, values: Assignments, agent: str, reason: str) -> None:
    """Tell an agent how it did.

    For example: bt-agents feedback positive.

    Direct feedback names the wanted profile: bt-agents feedback direct age=5 mood=2.
    """
    with _system() as observer:
        from bt_agents.ros import client

        observer.turn_until(lambda: observer.profiles is not None, _FIND_LIMIT_S)
        wanted = _wanted(observer, values) if kind == "direct" else _columns(values)[1]
        answer = client.give_feedback(observer, agent, kind, wanted, reason)
        answer = _accepted(answer, "the feedback node")
        click.echo(f"{answer.message} (revision {answer.feedback.revision})")


def _columns(values: Assignments) -> tuple[list[str], list[float]]:
    return [name for name, _ in values], [value for _, value in values]


def _wanted(observer: Observer, values: Assignments) -> list[float]:
    names = list(observer.profiles.parameters) if observer.profiles else []
    given = dict(values)
    unknown = [name for name in given if name not in names]
    if unknown:
        raise BtAgentsError(f"no scene parameter '{unknown[0]}'; there are {', '.join(names)}")
    return [given.get(name, math.nan) for name in names]


def _row(names: Any, values: Any) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in zip(names, values, strict=True))
