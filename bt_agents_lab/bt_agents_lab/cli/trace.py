# SPDX-License-Identifier: Apache-2.0
"""`bt-agents trace`: shows what the tree of a run did, and the values that its nodes changed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import join_first, printable
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.decisions import tell_other_starts
from bt_agents_tools.cli.formatting import clock_text, values_text
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options
from bt_agents_tools.cli.trees_choice import journal_option, kept_state, state_option

with loading():
    from bt_agents_lab.cli.journal import damage_reported, newest_journal, printable_message
    from bt_agents_lab.recorder.reading import JournalReader

_TYPE = "bt_agents_interfaces/msg/TreeStatus"

_STATUSES = ("invalid", "running", "success", "failure")
"""Names of the constants of ``StatusChange.msg``, which a decoded message does not have."""


@click.command()
@click.argument("round_number", metavar="[ROUND]", required=False, type=int)
@state_option
@journal_option
@table_options
def trace(round_number: int | None, state: str, journal: Path | None, form: TableForm) -> None:
    """Show what the tree of the last run did, or of the run of a ROUND, element by element.

    It is read from the journal of the newest day.
    """
    files = [journal] if journal is not None else newest_journal(kept_state(state).journal)
    reader = JournalReader(files, os.environ.get("ROS_NAMESPACE", ""))
    with damage_reported():
        entries = reader.entries({_TYPE})
        sent = (entry.decode() for entry in entries)
        runs = [_Run(one.host_instance, one.epoch, one.round, one.agent) for one in sent]
        problems = [*reader.hints, *reader.problems]
        if lost := sum(entry.lost for entry in entries):
            problems.append(f"{lost} messages about trees are lost")
        for text in problems:
            click.echo(printable(text), err=True)
        found = [run for run in runs if round_number in (None, run.round)]
        if not found:
            raise BtAgentsError(_not_found(round_number, runs))
        tell_other_starts(round_number, (run.epoch for run in found))
        shown = found[-1]
        # A decoded message is large, so only those of one run are kept.
        rows = [
            _row(status, change, form)
            for entry, run in zip(entries, runs, strict=True)
            if run == shown
            for status in [printable_message(entry.decode())]
            for change in status.changes
        ]
    if not form.for_program:
        click.echo(printable(f"{shown.agent}, round {shown.round}"))
    print_table(_COLUMNS, rows, form)


class _Run(NamedTuple):
    host_instance: str
    epoch: str
    round: int
    agent: str


def _row(status: Any, change: Any, form: TableForm) -> Sequence[Any]:
    stamp = status.header.stamp
    values: object = values_text(change.values)
    if form is TableForm.JSON:
        values = {one.name: one.value for one in change.values}
    return (
        stamp.sec + stamp.nanosec * 1e-9,
        status.tick,
        dict(enumerate(_STATUSES)).get(change.status, f"unknown ({change.status})"),
        change.name,
        values,
        change.message,
        change.path,
    )


def _not_found(round_number: int | None, runs: Sequence[_Run]) -> str:
    if not runs:
        return "no run of a tree is in the journal; 'bt-agents up --journal' records them"
    known = join_first([str(number) for number in dict.fromkeys(run.round for run in runs)])
    return f"no run of round {round_number} is in the journal; there are rounds {known}"


def _time_of_day(at_s: float) -> str:
    milliseconds = int(at_s * 1000) % 1000
    return f"{clock_text(at_s)}.{milliseconds:03}"


_COLUMNS = (
    Column(key="time_s", title="time", text=_time_of_day),
    Column(key="tick", right=True),
    Column(key="status"),
    Column(key="node"),
    Column(key="values", title="changed"),
    Column(key="message"),
    Column(key="path"),
)
