# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents strategy`: shows and switches the strategies of a running market."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_tools.cli.assignments import assignments
from bt_agents_tools.cli.connection import connect
from bt_agents_tools.cli.decisions import disagreements, last_decisions
from bt_agents_tools.cli.formatting import print_line
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options

if TYPE_CHECKING:
    from bt_agents_tools.client.strategies import Strategies

_INDENT = 6


@click.command()
@click.argument("name", required=False, default="")
@click.argument("options", nargs=-1)
@click.option("--shadow", help="A second strategy that only scores; 'none' for none.")
@table_options
@click.pass_context
def strategy(
    context: click.Context,
    name: str,
    options: tuple[str, ...],
    shadow: str | None,
    form: TableForm,
) -> None:
    """Show how bids are ranked, or rank them by NAME from the next round on.

    For example: bt-agents strategy softmax temperature=0.3. Without a NAME, options are those of
    the strategy in force.
    """
    if "=" in name:
        name, options = "", (name, *options)
    values = assignments(context, context.command.params[1], options)
    observer = connect()
    from bt_agents_tools.client import market
    from bt_agents_tools.client.strategies import changed_parameters

    found = market.strategies(observer)
    observing = "" if shadow == "none" else shadow
    changes = changed_parameters(found, name, values, observing)
    if changes:
        market.set_parameters(observer, changes)
        found = market.strategies(observer)
    if form.for_program:
        print_table([Column(key=key) for key in _KEYS], list(_rows(found)), form)
        return
    auctions = last_decisions(observer)
    last = auctions[-1] if auctions else None
    if not changes:
        _show(found)
    elif name or shadow is None:
        click.echo(_with_options(found))
    click.echo(_ranking_text(found, last))


_KEYS = ("strategy", "ranks", "scores", "option", "value", "minimum", "maximum", "description")


def _rows(found: Strategies) -> Iterator[tuple[object, ...]]:
    """Yield a row for each strategy and for each of its options."""
    for name, description in found.descriptions.items():
        place = (name, name == found.current, name == found.shadow)
        yield (*place, None, None, None, None, description)
        for key, one in found.options[name].items():
            yield (*place, key, one.value, one.minimum, one.maximum, one.description)


def _show(found: Strategies) -> None:
    console = Console()
    for name, description in found.descriptions.items():
        mark = ">" if name == found.current else "~" if name == found.shadow else " "
        print_line(console, f"{mark} {escape(f'{name:<20}')} ", description, _INDENT)
        for key, option in found.options[name].items():
            span = f"{option.minimum:g} to {option.maximum:g}"
            head = f"    {escape(key)} = {option.value:g}"
            print_line(console, f"{head}  ", f"{option.description} ({span})", _INDENT)


def _with_options(found: Strategies) -> str:
    """Return the strategy in force with its options, as text."""
    options = found.options[found.current].items()
    values = ", ".join(f"{key} = {option.value:g}" for key, option in options)
    text = f"from the next round on: {found.descriptions[found.current]}"
    return f"{text} ({values})" if values else text


def _ranking_text(found: Strategies, last: Any) -> str:
    """Return the ranking and the shadow strategy, with their disagreements so far, as text."""
    text = f"> ranks: {found.current}"
    if found.shadow:
        by = (found.current, found.shadow)
        counted = last is not None and (last.strategy, last.shadow_strategy) == by
        rounds = disagreements(last) if counted else "in no round yet"
        text += f"; ~ only scores: {found.shadow}, {rounds}"
    return text
