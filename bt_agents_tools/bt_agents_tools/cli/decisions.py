# SPDX-License-Identifier: Apache-2.0
"""Decisions of the market and ends of scenes, formatted for people and as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import click
from rich.markup import escape

from bt_agents_core.scene_labels import SceneLabels
from bt_agents_core.stop_cause import StopCause, StoppedBy, stopper
from bt_agents_core.text import printable
from bt_agents_tools.cli.connection import FIND_LIMIT_S
from bt_agents_tools.cli.formatting import code_text, fitted_console, print_line
from bt_agents_tools.cli.table import Column, TableForm, print_json, print_table
from marketplace_node.outcomes import AuctionOutcome, RunEventKind, RunOutcome

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

SOON_S = 0.3
"""Time for a message that follows immediately [s]."""

_INDENT = 4
_MAX_SHOWN = 30
"""Maximum number of bids and refusals to print; the JSON has all."""


def last_decisions(observer: Observer) -> list[Any]:
    """Return the last decisions of a running market."""
    auctions = observer.received("bt_agents/auctions")
    observer.spin_until(
        lambda: (auctions[-1].round if auctions else 0) >= observer.market.round, FIND_LIMIT_S
    )
    return auctions


def tell_other_starts(round_number: int | None, epochs: Iterable[str]) -> None:
    """Say on standard error if several starts of the market had the round that a user names."""
    starts = len(set(epochs))
    if round_number is not None and starts > 1:
        again = f"the market has started {starts} times with a round {round_number}"
        click.echo(f"{again}; this is the last", err=True)


def names_of_scenes(auctions: Iterable[Any]) -> SceneLabels:
    """Return the names of the scenes of some decisions."""
    names = SceneLabels()
    for auction in auctions:
        names.add(auction.scene)
    return names


def show_decision(
    auction: Any, names: SceneLabels | None = None, form: TableForm = TableForm.FITTED
) -> None:
    """Print a decision: the winner, every bid, and the reasons in plain sentences."""
    names = names or names_of_scenes([auction])
    label = f" ({auction.scene.label})" if auction.scene.label else ""
    title = f"preview{label}" if auction.preview else f"round {auction.round}{label}"
    click.echo(f"{title}: {headline(auction)}")
    console = fitted_console(form)
    for place, bid in enumerate(auction.ranking[:_MAX_SHOWN], start=1):
        print_line(console, f"  {place}. {escape(f'{bid.agent:<22}')} ", bid.calculation, _INDENT)
    _print_more(len(auction.ranking), "bids")
    for bid in auction.refused[:_MAX_SHOWN]:
        who = bid.agent or bid.host
        print_line(console, f"  –  {escape(f'{who:<22}')} ", bid.reason, _INDENT)
    _print_more(len(auction.refused), "that do not bid")
    for line in (auction.explanation or auction.reason).splitlines():
        print_line(console, "", names.with_names(line), _INDENT)


def _print_more(count: int, what: str) -> None:
    if count > _MAX_SHOWN:
        click.echo(f"  … and {count - _MAX_SHOWN} more {what}")


def headline(auction: Any) -> str:
    """Return the result of a decision as a short text."""
    if auction.outcome == AuctionOutcome.PREEMPTS:
        return "the run under way is stopped for it"
    if auction.outcome == AuctionOutcome.WAITS:
        return "it waits, the run under way goes on"
    if auction.preview and auction.winner:
        return f"{auction.winner} would win"
    return auction.winner or "nobody"


def last_end_received(observer: Observer, ends: list[Any]) -> bool:
    """Return whether these include the end of the market's last scene, if there was one."""
    finished = observer.market.finished_scene_id
    return not finished or any(end.scene_id == finished for end in ends)


def has_run_ended(runs: Iterable[Any], auction: Any) -> bool:
    """Return whether the run that a decision awards, if any, has ended."""
    key = (auction.epoch, auction.round, RunEventKind.ENDED)
    return not auction.winner or any((run.epoch, run.round, run.event) == key for run in runs)


def stop_texts(runs: Iterable[Any], auction: Any, names: SceneLabels) -> list[str]:
    """Return one text per agent about stopped runs of a round: by whom and why.

    Args:
        runs: Events of any runs, in order.
        auction: The decision of the round.
        names: Names of scenes that a reason may mention.
    """
    stops = {}
    for run in runs:
        is_of_round = (run.epoch, run.round) == (auction.epoch, auction.round)
        is_stop = run.stop_cause != StopCause.NOT_STOPPED or run.stopped_by or run.stop_reason
        if is_of_round and (run.event == RunEventKind.CANCELLING or is_stop):
            stops[run.agent] = run
    return [f"{agent} {_stop_text(run, names)}" for agent, run in stops.items()]


def _stop_text(run: Any, names: SceneLabels) -> str:
    did = "was stopped" if run.outcome == RunOutcome.CANCELLED else "was told to stop"
    by = StoppedBy.of(run.stopped_by)
    by_host = run.stop_cause == StopCause.BY_HOST
    cause = StopCause.BY_HOST if by_host else StopCause.BY_MARKET
    who = f" ({stopper(cause, by)})" if by or by_host else ""
    return f"{did}{who}: {names.with_names(run.stop_reason or run.message)}"


def end_text(end: Any, names: SceneLabels) -> str:
    """Return the end of a scene as text."""
    return f"{code_text(end.code)}: {names.with_names(end.message)}"


def admission_text(observer: Observer) -> tuple[str, str]:
    """Return the market's ``on_new_scene``, empty without an answer, and how many scenes wait."""
    waiting = observer.market.queued
    names = ["on_new_scene", "queue_limit"]
    answer = observer.ask("marketplace/get_parameters", names=names)
    if answer is None or len(answer.values) != len(names):
        return "", f"{waiting} wait"
    mode, limit = answer.values
    return printable(mode.string_value), f"{waiting} of {limit.integer_value} wait"


def disagreements(auction: Any) -> str:
    """Return as text the number of rounds where the shadow strategy had another winner."""
    return f"another winner in {auction.shadow_disagreements} of {auction.shadow_rounds} rounds"


def print_decision(auction: Any, form: TableForm) -> None:
    """Print a decision for a program: all fields as JSON, or a CSV line per bid."""
    if form is TableForm.JSON:
        print_json(as_plain_data(auction))
        return
    bids = [
        (place, bid.agent, bid.host, bid.distance, bid.score, bid.calculation)
        for place, bid in enumerate(auction.ranking, start=1)
    ]
    refused = [(None, bid.agent, bid.host, None, None, bid.reason) for bid in auction.refused]
    keys = ("place", "agent", "host", "distance", "score", "why")
    print_table([Column(key=key) for key in keys], [*bids, *refused], form)


def as_plain_data(value: Any) -> Any:
    """Return a message of a running system or a journal as dictionaries and lists."""
    if hasattr(value, "get_fields_and_field_types") or isinstance(value, SimpleNamespace):
        is_recorded = isinstance(value, SimpleNamespace)
        names = value.__slots__ if is_recorded else value.get_fields_and_field_types()
        return {name: as_plain_data(getattr(value, name)) for name in names}
    if isinstance(value, bool | int | float | str):
        return value
    return [as_plain_data(one) for one in value]
