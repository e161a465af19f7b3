# SPDX-License-Identifier: Apache-2.0
"""`bt-agents check`: every problem of a trees folder, without ROS and without a robot."""

from __future__ import annotations

import sys

import click

from bt_agents.language.folder_reader import read_trees
from bt_agents.trees_folder import find_trees


@click.command()
@click.argument("directory", required=False, default="")
def check(directory: str) -> None:
    """Check scene, skills and agents of a trees DIRECTORY; exit code 1 when something is wrong."""
    folder = read_trees(find_trees(directory))
    for broken in folder.broken:
        click.echo(broken.error.report)
    for agent in folder.agents:
        click.echo(f"{agent.file}: {agent.name} is fine")
    sys.exit(1 if folder.broken else 0)
