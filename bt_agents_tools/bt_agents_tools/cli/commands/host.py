# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents host`: runs the agents of a trees folder for a system elsewhere."""

from __future__ import annotations

from dataclasses import replace

import click

from bt_agents_core.state_folder import claim_state
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.params_file import params_option
from bt_agents_tools.cli.run_parts import (
    host_name,
    join_network,
    lan_options,
    read_agents,
    run_parts,
)
from bt_agents_tools.cli.trees_choice import state_option, take_trees
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.parameter_file import ParameterFile


@click.command()
@click.argument("directory", required=False, default="")
@click.option("--name", default="", help="Name of the host; default: the name of the machine.")
@click.option("--tags", default="", help="Only agents with one of these tags, as in a,b.")
@click.option(
    "--language", default="", help="Language of the texts; by default the language of scene.yaml."
)
@click.option(
    "--bindings", default="", help="Robots whose bindings of skills are preferred: ros4hri,nav2."
)
@state_option
@params_option
@lan_options
def host(
    directory: str,
    name: str,
    tags: str,
    language: str,
    bindings: str,
    state: str,
    params: ParameterFile | None,
    lan: bool,
    slow_network: float,
) -> None:
    """Add the agents of a trees DIRECTORY to a system, which may run on another machine.

    They join when its market is there, and leave with Ctrl-C.
    """
    interrupt = Interrupt()
    named = host_name(name)
    trees = take_trees(directory)
    read_agents(trees, tags)
    kept = claim_state(trees, state)
    click.echo(f"kept in {kept.path}", err=True)
    logs = new_log_folder(state)
    join_network(lan, slow_network)
    part = components.host(
        trees, tags, bindings, str(kept.tunings), language, str(kept.open_goals), named
    )
    part = components.on_slow_network(replace(part, file=params), slow_network)
    run_parts("host", [part], interrupt, logs)
