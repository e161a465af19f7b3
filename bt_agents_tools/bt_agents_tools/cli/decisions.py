# SPDX-License-Identifier: Apache-2.0
"""Decisions of the market and ends of scenes, formatted for people, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from bt_agents_core.scene import finite_or_none
from bt_agents_tools.cli.connection import FIND_LIMIT_S
from bt_agents_tools.cli.constants import code_words
from bt_agents_tools.cli.scene_names import SceneNames
from bt_agents_tools.cli.wrap import print_line

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_INDENT = 4
_MAX_SHOWN = 30
"""Bids and refusals that are printed; the JSON has all."""

_END_LIMIT_S = 0.3


def last_decisions(observer: Observer) -> list[Any]:
    """Return the last decisions of a running market."""
    from bt_agents_tools.client import system

    auctions = system.decisions(observer)
    observer.turn_until(
        lambda: (auctions[-1].round if auctions else 0) >= observer.market.round, FIND_LIMIT_S
    )
    return auctions


def names_of_scenes(auctions: Iterable[Any]) -> SceneNames:
    """Return the names of the scenes of some decisions."""
    names = SceneNames()
    for auction in auctions:
        names.take(auction.scene)
    return names


def receive_last_end(observer: Observer, ends: Sequence[Any]) -> None:
    """Wait until the end of the last interaction is among the ``ends``, if there was one.

    Args:
        observer: In the graph of the system.
        ends: The list that ``scene_ends`` fills.
    """
    observer.turn_until(
        lambda: observer.market.finished_scene_id in ("", *(end.scene_id for end in ends)),
        _END_LIMIT_S,
    )


def end_text(end: Any, names: SceneNames) -> str:
    """Return how a scene ended, with the names of scenes."""
    return f"{code_words(end.code)}: {names.in_words(end.message)}"


def admission(observer: Observer) -> tuple[str, str]:
    """Return the mode for new scenes, empty without an answer, and how many wait as text."""
    from bt_agents_tools.client import system

    waiting = observer.market.queued
    settings = system.new_scenes(observer)
    if settings is None:
        return "", f"{waiting} wait"
    mode, limit = settings
    return mode, f"{waiting} of {limit} wait"


def show_decision(auction: Any, names: SceneNames | None = None) -> None:
    """Print a decision: who won, every bid, and why in plain sentences."""
    names = names or names_of_scenes([auction])
    label = f" ({auction.scene.label})" if auction.scene.label else ""
    title = f"preview{label}" if auction.preview else f"round {auction.round}{label}"
    click.echo(f"{title}: {headline(auction)}")
    console = Console()
    for place, bid in enumerate(auction.ranking[:_MAX_SHOWN], start=1):
        print_line(console, f"  {place}. {bid.agent:<22} ", bid.calculation, _INDENT)
    _print_more(len(auction.ranking), "bids")
    for bid in auction.refused[:_MAX_SHOWN]:
        who = bid.agent or bid.host
        print_line(console, f"  –  {who:<22} ", bid.reason, _INDENT)
    _print_more(len(auction.refused), "that do not bid")
    for line in (auction.explanation or auction.reason).splitlines():
        print_line(console, "", names.in_words(line), _INDENT)


def _print_more(count: int, what: str) -> None:
    if count > _MAX_SHOWN:
        click.echo(f"  … and {count - _MAX_SHOWN} more {what}")


def headline(auction: Any) -> str:
    """Return the result of a decision as a short text."""
    if auction.outcome == auction.PREEMPTS:
        return "the run under way is stopped for it"
    if auction.outcome == auction.WAITS:
        return "it waits, the run under way goes on"
    if auction.preview and auction.winner:
        return f"{auction.winner} would win"
    return auction.winner or "nobody"


def disagreements(auction: Any) -> str:
    """Return as text in how many rounds so far the shadow strategy had another winner."""
    return f"another winner in {auction.shadow_disagreements} of {auction.shadow_rounds} rounds"


def decision_as_json(auction: Any) -> str:
    """Return a decision as JSON with the fields of the message; NaN becomes null."""
    return json.dumps(_plain(auction), ensure_ascii=False, indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, float):
        return finite_or_none(value)
    if isinstance(value, bool | int | str):
        return value
    return [_plain(one) for one in value]
