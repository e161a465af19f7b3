# SPDX-License-Identifier: Apache-2.0
"""`bt-agents strategy`: shows and switches the strategy of a running market."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_tools.cli.assignments import Assignments, assignments
from bt_agents_tools.cli.connection import running_system
from bt_agents_tools.cli.decisions import disagreements, heard_decisions
from bt_agents_tools.cli.wrap import print_line

if TYPE_CHECKING:
    from bt_agents_tools.client.market import Strategies

NO_SHADOW = "none"
_INDENT = 6
_SILENT = "the marketplace does not answer; look at 'bt-agents status'"


@click.command()
@click.argument("name", required=False, default="")
@click.argument("options", nargs=-1)
@click.option("--shadow", help="A second strategy that only scores; 'none' for none.")
@click.pass_context
def strategy(
    context: click.Context, name: str, options: tuple[str, ...], shadow: str | None
) -> None:
    """Show how bids are ranked, or rank them by NAME from the next round on.

    For example: bt-agents strategy softmax temperature=0.3. Without a NAME, options are those of
    the strategy in force.
    """
    if "=" in name:
        name, options = "", (name, *options)
    values = assignments(context, context.command.params[1], options)
    with running_system() as observer:
        from bt_agents_tools.client import market

        found = market.strategies(observer)
        if found is None:
            raise BtAgentsError(_SILENT)
        changes = _changes(found, name, values, shadow)
        if changes:
            refusal = market.set_parameters(observer, changes)
            if refusal is None:
                raise BtAgentsError(_SILENT)
            if refusal:
                raise BtAgentsError(refusal)
            found = market.strategies(observer) or found
        auctions = heard_decisions(observer)
        _show(found, auctions[-1] if auctions else None)


def _changes(
    found: Strategies, name: str, values: Assignments, shadow: str | None
) -> dict[str, str | float]:
    """Return the parameters to set.

    Raises:
        BtAgentsError: There is no such strategy or option.
    """
    changes: dict[str, str | float] = {}
    if name:
        changes["strategy"] = _known(name, found)
    if shadow is not None:
        changes["shadow_strategy"] = "" if shadow == NO_SHADOW else _known(shadow, found)
    about = name or found.current
    known = {option.name: option for option in found.options.get(about, ())}
    for option, value in values:
        if option not in known:
            hint = did_you_mean(option, sorted(known)) or "there are none"
            raise BtAgentsError(f"strategy '{about}' has no option '{option}'; {hint}")
        least, most = known[option].minimum, known[option].maximum
        if not least <= value <= most:
            raise BtAgentsError(f"{about}.{option}: {value:g}, expected {least:g} to {most:g}")
        changes[f"{about}.{option}"] = value
    return changes


def _known(name: str, found: Strategies) -> str:
    if name not in found.descriptions:
        words = did_you_mean(name, found.descriptions)
        raise BtAgentsError(
            f"no strategy '{name}'; {words}\nthere are {', '.join(found.descriptions)}"
        )
    return name


def _show(found: Strategies, last: Any) -> None:
    console = Console()
    for name, words in found.descriptions.items():
        mark = ">" if name == found.current else "~" if name == found.shadow else " "
        print_line(console, f"{mark} {name:<20} ", words, _INDENT)
        for option in found.options[name]:
            span = f"{option.minimum:g} to {option.maximum:g}"
            head = f"    {option.name} = {option.value:g}"
            print_line(console, f"{head}  ", f"{option.description} ({span})", _INDENT)
    click.echo(f"> ranks: {found.current}" + _shadow_words(found, last))


def _shadow_words(found: Strategies, last: Any) -> str:
    if not found.shadow:
        return ""
    words = f"; ~ only scores: {found.shadow}"
    if last is None or (last.strategy, last.shadow_strategy) != (found.current, found.shadow):
        return f"{words}, in no round yet"
    return f"{words}, {disagreements(last)}"
