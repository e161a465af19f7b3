# SPDX-License-Identifier: Apache-2.0
"""`bt-agents why`: the reason of a decision of the market."""

from __future__ import annotations

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.connection import running_system
from bt_agents_tools.cli.decisions import (
    decision_as_json,
    end_text,
    last_decisions,
    names_of_scenes,
    receive_last_end,
    show_decision,
)


@click.command()
@click.argument("round_number", metavar="[ROUND]", required=False, type=int)
@click.option("--json", "as_json", is_flag=True, help="The whole record of the decision, as JSON.")
def why(round_number: int | None, as_json: bool) -> None:
    """Say why an agent won, last or in a ROUND."""
    with running_system() as observer:
        from bt_agents_tools.client import system

        ends = system.scene_ends(observer)
        auctions = last_decisions(observer)
        receive_last_end(observer, ends)
        found = [a for a in auctions if round_number is None or a.round == round_number]
        if not found:
            rounds = ", ".join(str(a.round) for a in auctions)
            raise BtAgentsError(
                f"no decision {'yet' if round_number is None else f'of round {round_number}'}"
                + (
                    f"; there are rounds {rounds}"
                    if rounds
                    else "; 'bt-agents trigger' asks for one"
                )
            )
        if as_json:
            click.echo(decision_as_json(found[-1]))
            return
        names = names_of_scenes(auctions)
        show_decision(found[-1], names)
        for end in ends:
            if end.scene_id == found[-1].scene.scene_id and end.code != "DUPLICATE":
                click.echo(f"the scene ended: {end_text(end, names)}")
