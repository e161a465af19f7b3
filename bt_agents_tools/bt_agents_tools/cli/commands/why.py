# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents why`: shows the reasons for a decision."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.optional_packages import journal_needs
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene_labels import SceneLabels
from bt_agents_core.text import join_first
from bt_agents_tools.cli.connection import NoSystemError, connect
from bt_agents_tools.cli.decisions import (
    SOON_S,
    end_text,
    has_run_ended,
    last_decisions,
    last_end_received,
    names_of_scenes,
    print_decision,
    show_decision,
    stop_texts,
    tell_other_starts,
)
from bt_agents_tools.cli.table import TableForm, table_options
from bt_agents_tools.cli.trees_choice import journal_option, kept_state, state_option


@click.command()
@click.argument("round_number", metavar="[ROUND]", required=False, type=int)
@state_option
@journal_option
@table_options
def why(round_number: int | None, state: str, journal: Path | None, form: TableForm) -> None:
    """Say why an agent won, last or in a ROUND.

    Without a running system it is read from the journal of the newest day, as with --state.
    """
    if state or journal is not None:
        _show_recorded(state, journal, round_number, form)
        return
    try:
        _show_running(round_number, form)
    except NoSystemError as error:
        click.echo(f"{error}; this is from the journal", err=True)
        _show_recorded(state, journal, round_number, form)


def _show_running(round_number: int | None, form: TableForm) -> None:
    observer = connect()
    ends = observer.received("bt_agents/scene_ends")
    auctions = last_decisions(observer)
    runs = observer.received("bt_agents/runs")
    observer.spin_until(lambda: last_end_received(observer, ends), SOON_S)
    found = _show(auctions, round_number, form)
    if form.for_program:
        return
    observer.spin_until(lambda: has_run_ended(runs, found), SOON_S)
    names = names_of_scenes(auctions)
    _print_stops(runs, found, names)
    for end in ends:
        if end.scene_id == found.scene.scene_id and end.code != RefusalCode.DUPLICATE:
            click.echo(f"the scene ended: {end_text(end, names)}")


def _show_recorded(
    state: str, journal: Path | None, round_number: int | None, form: TableForm
) -> None:
    try:
        # The journal is an optional extra.
        lab = import_module("bt_agents_lab.cli.journal")
    except ModuleNotFoundError as error:
        raise BtAgentsError(journal_needs(error.name)) from None
    files = [journal] if journal is not None else lab.newest_journal(kept_state(state).journal)
    rounds = lab.recorded_rounds(files)
    auctions = [one.auction for one in rounds]
    found = _show(auctions, round_number, form)
    if not form.for_program:
        runs = [run for one in rounds for run in one.run_events]
        _print_stops(runs, found, names_of_scenes(auctions))


def _print_stops(runs: Sequence[Any], auction: Any, names: SceneLabels) -> None:
    for text in stop_texts(runs, auction, names):
        click.echo(text)


def _show(auctions: Sequence[Any], round_number: int | None, form: TableForm) -> Any:
    """Print and return the decision of a round; without a number, of the last one."""
    found = [a for a in auctions if round_number is None or a.round == round_number]
    if not found:
        known = join_first([str(a.round) for a in auctions])
        which = "yet" if round_number is None else f"of round {round_number}"
        hint = f"there are rounds {known}" if known else "'bt-agents trigger' asks for one"
        raise BtAgentsError(f"no decision {which}; {hint}")
    tell_other_starts(round_number, (one.epoch for one in found))
    if form.for_program:
        print_decision(found[-1], form)
    else:
        show_decision(found[-1], names_of_scenes(auctions), form)
    return found[-1]
