# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents fleet`: learns together with other robots over a database."""

from __future__ import annotations

import os
from contextlib import closing

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import FLEET_SETTINGS, claim_state
from bt_agents_core.text import printable_line
from bt_agents_fleet.database import FleetDatabase, FleetError, RobotRow, checked_address
from bt_agents_fleet.fleet_settings import (
    STATUS_FILE,
    FleetSettings,
    checked_robot,
    read_settings,
    read_status,
    write_settings,
)
from bt_agents_ros.signals import Interrupt, loading
from bt_agents_tools.cli.formatting import counted, moment_text
from bt_agents_tools.cli.table import Column, TableForm, print_json, print_table, table_options
from bt_agents_tools.cli.trees_choice import kept_state, state_option, take_trees
from bt_agents_tools.launcher.supervisor import set_discovery


@click.group()
def fleet() -> None:
    """Learn together with other robots, over a PostgreSQL database.

    For example: bt-agents fleet join postgresql://robots@db.example/fleet --robot robot-07
    """


@fleet.command()
@click.argument("address")
@click.option("--robot", required=True, help="Unique name of this robot.")
@state_option
def join(address: str, robot: str, state: str) -> None:
    """Join the fleet of the database at ADDRESS, and create or update its tables.

    ADDRESS is a URI or options of libpq, which reads the password from ~/.pgpass or PGPASSWORD.
    Each agent's file says what it shares: learning: {share: everything}.
    """
    settings = FleetSettings(robot=checked_robot(robot), address=checked_address(address))
    kept = claim_state(take_trees(is_argument=False), state)
    with closing(_database(settings)) as database:
        database.join()
    file = write_settings(kept.path, settings)
    click.echo(f"joined as {settings.robot}; 'bt-agents fleet run' keeps {file.parent} up to date")


@fleet.command()
@click.option("--erase", is_flag=True, help="Remove what this robot has taught from the database.")
@click.option("--yes", is_flag=True, help="Do not ask.")
@state_option
def leave(erase: bool, yes: bool, state: str) -> None:
    """Leave the fleet; this robot keeps what it has learned from the others.

    The others keep what it has taught, also with --erase, which removes it from the database.
    """
    kept = kept_state(state)
    settings = read_settings(kept.path)
    if erase:
        if not yes:
            click.confirm(f"remove the steps of {settings.robot} from the database?", abort=True)
        with closing(_database(settings)) as database:
            database.erase()
    (kept.path / FLEET_SETTINGS).unlink()
    (kept.path / STATUS_FILE).unlink(missing_ok=True)
    click.echo(f"{settings.robot} has left the fleet")


@fleet.command()
@table_options
@state_option
def status(form: TableForm, state: str) -> None:
    """Show how far this robot is, and the robots of its fleet."""
    kept = kept_state(state)
    settings = read_settings(kept.path)
    here = read_status(kept.path)
    robots: list[RobotRow] = []
    problem = ""
    with closing(_database(settings)) as database:
        try:
            robots = database.robots()
        except FleetError as error:
            problem = str(error)
    if form is TableForm.JSON:
        fleet = [vars(one) for one in robots]
        print_json({"robot": settings.robot, "problem": problem, "here": here, "robots": fleet})
        return
    for line in (f"this robot: {settings.robot}", *_status_lines(here)):
        click.echo(line, err=form.for_program)
    if problem:
        raise BtAgentsError(f"the robots of the fleet are not known now: {problem}")
    columns = (
        Column(key="robot"),
        Column(key="steps", right=True),
        Column(key="position", title="up to row", right=True),
        Column(key="seen_s", title="seen", text=lambda s: f"{s:.0f} s ago", right=True),
    )
    rows = [(one.robot, one.steps, one.position, one.seen_s) for one in robots]
    print_table(columns, rows, form)


@fleet.command()
@state_option
def run(state: str) -> None:
    """Keep this robot's ledger and the database up to date, until Ctrl-C."""
    kept = kept_state(state)
    read_settings(kept.path)  # Report a robot that has not joined before loading ROS.
    set_discovery(os.environ)
    interrupt = Interrupt()
    with loading():
        from bt_agents_fleet.fleet_run import keep_up
    keep_up(kept.trees, kept.path, kept.ledger, click.echo, interrupt)


def _database(settings: FleetSettings) -> FleetDatabase:
    return FleetDatabase(settings.address, settings.robot)


def _status_lines(here: dict[str, object]) -> list[str]:
    if not here:
        return ["'bt-agents fleet run' was not here yet"]
    at = here.get("at")
    when = moment_text(at if isinstance(at, float) else 0)
    steps = here.get("taken")
    taken = counted(steps if isinstance(steps, int) else 0, "step")
    lines = [
        f"at {when}: {here.get('problem') or 'up to date'}",
        f"pushed up to row {here.get('pushed')} of {here.get('last')}; "
        f"{taken} of other robots taken in, {here.get('refused')} refused",
    ]
    aside = here.get("aside")
    for one in aside if isinstance(aside, list) else ():
        if isinstance(one, dict):
            lines.append(
                f"  {one.get('robot')}/{one.get('number')} {one.get('code')}: {one.get('reason')}"
            )
    return [printable_line(line) for line in lines]
