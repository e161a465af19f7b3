# SPDX-License-Identifier: Apache-2.0
"""Decisions of the market formatted for people, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from bt_agents_core.scene import finite_or_none
from bt_agents_tools.cli.connection import FIND_LIMIT_S
from bt_agents_tools.cli.scene_labels import SceneLabels
from bt_agents_tools.cli.wrap import print_line

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_INDENT = 4
_MOST = 30
"""Bids that are shown, and refusals; the JSON has all."""


def heard_decisions(observer: Observer) -> list[Any]:
    """Return the last decisions of a running market."""
    from bt_agents_tools.client import system

    auctions = system.decisions(observer)
    observer.turn_until(
        lambda: (auctions[-1].round if auctions else 0) >= observer.market.round, FIND_LIMIT_S
    )
    return auctions


def names_of_scenes(auctions: Iterable[Any]) -> SceneLabels:
    """Return what people call the scenes of some decisions."""
    names = SceneLabels()
    for auction in auctions:
        names.take(auction.scene)
    return names


def show_decision(auction: Any, names: SceneLabels | None = None) -> None:
    """Print a decision: who won, every bid, and why in plain sentences."""
    names = names or names_of_scenes([auction])
    label = f" ({auction.scene.label})" if auction.scene.label else ""
    title = f"preview{label}" if auction.preview else f"round {auction.round}{label}"
    click.echo(f"{title}: {headline(auction)}")
    console = Console()
    for place, bid in enumerate(auction.ranking[:_MOST], start=1):
        print_line(console, f"  {place}. {bid.agent:<22} ", bid.calculation, _INDENT)
    _tell_more(len(auction.ranking), "bids")
    for bid in auction.refused[:_MOST]:
        who = bid.agent or bid.host
        print_line(console, f"  –  {who:<22} ", bid.reason, _INDENT)
    _tell_more(len(auction.refused), "that do not bid")
    for line in (auction.explanation or auction.reason).splitlines():
        print_line(console, "", names.in_words(line), _INDENT)


def _tell_more(count: int, what: str) -> None:
    if count > _MOST:
        click.echo(f"  … and {count - _MOST} more {what}")


def headline(auction: Any) -> str:
    """Return what a decision comes to, in a few words."""
    if auction.outcome == auction.PREEMPTS:
        return "the run under way is stopped for it"
    if auction.outcome == auction.WAITS:
        return "it waits, the run under way goes on"
    if auction.preview and auction.winner:
        return f"{auction.winner} would win"
    return auction.winner or "nobody"


def disagreements(auction: Any) -> str:
    """Return in how many rounds so far the shadow strategy had another winner, in words."""
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
