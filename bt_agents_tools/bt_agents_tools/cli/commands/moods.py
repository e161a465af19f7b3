# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents moods`: shows the mood of the person during each node of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import click
from rich.table import Table
from rich.text import Text

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import DIGITS, format_known
from bt_agents_tools.cli.connection import FIND_LIMIT_S, connect
from bt_agents_tools.cli.decisions import SOON_S
from bt_agents_tools.cli.formatting import clock_text, fitted_console, node_names, values_text
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options


@click.command()
@click.argument("agent", required=False, default="")
@click.option("--round", "round_number", type=int, default=0, help="Of this round.")
@table_options
def moods(agent: str, round_number: int, form: TableForm) -> None:
    """Show how the mood went in the last run of an AGENT, node by node.

    Without an AGENT it is the last run of all.
    """
    observer = connect()
    traces = observer.received("bt_agents/mood_traces")
    observer.spin_until(lambda: bool(observer.cards), FIND_LIMIT_S)
    trees = [observer.received(f"{host}/trees") for host in observer.cards]

    def found() -> list[Any]:
        return [
            trace
            for trace in traces
            if agent in ("", trace.agent) and round_number in (0, trace.round)
        ]

    observer.spin_until(lambda: bool(found()), FIND_LIMIT_S)
    observer.spin_until(lambda: False, SOON_S)
    if not found():
        raise BtAgentsError(_not_found(agent, round_number, traces))
    trace = found()[-1]
    observer.spin_until(lambda: bool(node_names(trees, trace.agent)), FIND_LIMIT_S)
    if form.for_program:
        names = node_names(trees, trace.agent)
        rows = [
            (
                *(trace.agent, trace.round, names.get(leaf), leaf, seconds, mean, change),
                _changed(trace, leaf, form),
            )
            for leaf, seconds, mean, change in _by_leaf(trace)
        ]
        print_table([Column(key=key) for key in _KEYS], rows, form)
        return
    when = clock_text(trace.header.stamp.sec)
    who = f" with {trace.person_id}" if trace.person_id else ""
    click.echo(f"{trace.agent}, round {trace.round}, ended {when}{who}")
    fitted_console().print(mood_table(trace, node_names(trees, trace.agent)))


_KEYS = ("agent", "round", "node", "path", "time_s", "mood", "change", "values")


def _by_leaf(trace: Any) -> Iterator[tuple[str, float, float, float]]:
    """Return the path of each node, its time, and the mean and the change of the mood in it."""
    return zip(trace.leaves, trace.seconds, trace.mean, trace.change, strict=True)


def _changed(trace: Any, leaf: str, form: TableForm = TableForm.FITTED) -> object:
    """Return the values that a node has changed last."""
    changed = [one for one in trace.values if one.path == leaf]
    if form is TableForm.JSON:
        return {one.name: one.value for one in changed}
    return values_text(changed)


def _not_found(agent: str, round_number: int, traces: list[Any]) -> str:
    whose = f" of {agent}" if agent else ""
    where = f" in round {round_number}" if round_number else ""
    kept = ", ".join(f"{trace.agent} (round {trace.round})" for trace in traces)
    hint = f"moods are kept of {kept}" if kept else "a run has to end first"
    return f"no run{whose}{where} is known; {hint}"


def mood_table(trace: Any, names: dict[str, str]) -> Table:
    """Return the table of a ``MoodTrace``, with the known names of nodes by path."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("node", overflow="fold")
    for heading in ("time", "mood", "change"):
        table.add_column(heading, justify="right", overflow="fold")
    table.add_column("changed", overflow="fold")
    table.add_column("path", style="dim", overflow="fold")
    for leaf, seconds, mean, change in _by_leaf(trace):
        table.add_row(
            Text(names.get(leaf, "?")),
            f"{seconds:.1f} s",
            format_known(mean),
            _change(change),
            Text(str(_changed(trace, leaf))),
            Text(leaf),
        )
    return table


def _change(value: float) -> Text:
    if math.isnan(value) or value == 0.0:
        return Text(format_known(value))
    return Text(f"{value:+.{DIGITS}g}", style="green" if value > 0 else "red")
