# SPDX-License-Identifier: Apache-2.0
"""Commands of operators to the market: pin, unpin, veto, allow, award, preview and cancel."""

from __future__ import annotations

import uuid
from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_tools.cli.assignments import Assignments, assignments
from bt_agents_tools.cli.connection import FIND_LIMIT_S, accepted, connect
from bt_agents_tools.cli.decisions import (
    last_decisions,
    names_of_scenes,
    print_decision,
    show_decision,
)
from bt_agents_tools.cli.table import TableForm, table_options

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_reason = click.option("--reason", default="", help="Why, in words.")
_person = click.option(
    "--person/--no-person", default=None, help="Whether a person is there; default: as before."
)


@click.command()
@click.argument("agent")
@_reason
def pin(agent: str, reason: str) -> None:
    """Let only AGENT bid, until it is unpinned."""
    _operate("PIN", agent=agent, reason=reason)


@click.command()
@_reason
def unpin(reason: str) -> None:
    """Let all agents bid again."""
    _operate("UNPIN", reason=reason)


@click.command()
@click.argument("agent")
@_reason
def veto(agent: str, reason: str) -> None:
    """Exclude AGENT from bidding, and stop its run."""
    _operate("VETO", agent=agent, reason=reason)


@click.command()
@click.argument("agent")
@_reason
def allow(agent: str, reason: str) -> None:
    """Let AGENT bid again after a veto."""
    _operate("ALLOW", agent=agent, reason=reason)


@click.command()
@click.argument("agent")
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--label", default="", help="Name of the scene for people.")
@_person
@_reason
def award(agent: str, values: Assignments, label: str, person: bool | None, reason: str) -> None:
    """Give AGENT the run for a scene, even if another agent is nearer.

    Without values it is the last scene. With values, all others come from the last scene; if
    it lacks one, it is missing, as scene.yaml says.
    """
    observer = connect()
    given, names = {}, names_of_scenes(last_decisions(observer))
    if values or label or person is not None:
        scene_id = f"award-{uuid.uuid4().hex[:8]}"
        given["scene"] = _scene(observer, values, scene_id, person, label)
        names.add(given["scene"])
    answer = observer.ask(
        "marketplace/operate", action="AWARD", agent=agent, reason=reason, **given
    )
    click.echo(names.with_names(accepted(answer, "the marketplace").message))


@click.command()
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--strategy", default="", help="Strategy to use instead of the one in force.")
@_person
@table_options
def preview(values: Assignments, strategy: str, person: bool | None, form: TableForm) -> None:
    """Show which agent would win, without running it.

    For example: bt-agents preview age=4 mood=2 --strategy ucb. Other values come from the live
    scene of a run; without a run from the last scene, with what the person has told since; else
    from scene.yaml.
    """
    observer = connect()
    given = {}
    if values or person is not None or last_decisions(observer):
        given["scene"] = _scene(observer, values, "preview", person, "")
    answer = observer.ask("marketplace/preview", strategy=strategy, **given)
    decision = accepted(answer, "the marketplace").auction
    if form.for_program:
        print_decision(decision, form)
    else:
        show_decision(decision, form=form)


@click.command()
@click.option("--reason", default="the operator stopped it", help="Why, in words.")
@click.option("--next", "next_", is_flag=True, help="Continue with the next waiting scene.")
def cancel(reason: str, next_: bool) -> None:
    """Stop the running agent, and forget the scenes that wait."""
    observer = connect()
    only = observer.market.round if next_ else 0
    answer = observer.ask(
        "marketplace/cancel", reason=reason, by=int(StoppedBy.OPERATOR), round=only
    )
    click.echo(accepted(answer, "the marketplace").message)


def _operate(action: str, **fields: Any) -> None:
    observer = connect()
    answer = observer.ask("marketplace/operate", action=action, **fields)
    click.echo(accepted(answer, "the marketplace").message)


def _scene(
    observer: Observer, values: Assignments, scene_id: str, person: bool | None, label: str
) -> Any:
    """Return the scene of another round with changed values of known parameters."""
    from bt_agents_tools.client import market

    auctions = last_decisions(observer)
    answer = observer.ask("scene_layer/analyze", find_s=FIND_LIMIT_S)
    present = answer.scene if answer is not None and answer.accepted else None
    last = market.next_scene(auctions[-1].scene if auctions else None, present)
    known = last if last is not None else present
    names = [value.name for value in known.values] if known is not None else []
    if not values and last is not None:
        label = label or last.label
    unknown = next((name for name, _ in values if name not in names), None)
    if unknown is not None:
        hint = did_you_mean(unknown, names) or "no node says which there are"
        raise BtAgentsError(f"no scene parameter '{unknown}'; {hint}")
    return market.scene_of(
        observer.node, names, dict(values), last, scene_id=scene_id, person=person, label=label
    )
