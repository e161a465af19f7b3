# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents why`: the reasons of a decision."""

from __future__ import annotations

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.connection import connect
from bt_agents_tools.cli.decisions import (
    SOON_S,
    end_text,
    last_decisions,
    last_end_received,
    names_of_scenes,
    print_decision,
    show_decision,
)
from bt_agents_tools.cli.table import TableForm, table_options


@click.command()
@click.argument("round_number", metavar="[ROUND]", required=False, type=int)
@table_options
def why(round_number: int | None, form: TableForm) -> None:
    """Say why an agent won, last or in a ROUND."""
    with connect() as observer:
        ends = observer.received("scene_ends")
        auctions = last_decisions(observer)
        observer.spin_until(lambda: last_end_received(observer, ends), SOON_S)
        found = [a for a in auctions if round_number is None or a.round == round_number]
        if not found:
            known = ", ".join(str(a.round) for a in auctions)
            which = "yet" if round_number is None else f"of round {round_number}"
            hint = f"there are rounds {known}" if known else "'bt-agents trigger' asks for one"
            raise BtAgentsError(f"no decision {which}; {hint}")
        if form in (TableForm.JSON, TableForm.CSV):
            print_decision(found[-1], form)
            return
        names = names_of_scenes(auctions)
        show_decision(found[-1], names, form)
        for end in ends:
            if end.scene_id == found[-1].scene.scene_id and end.code != "DUPLICATE":
                click.echo(f"the scene ended: {end_text(end, names)}")
