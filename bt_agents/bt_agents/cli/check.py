# SPDX-License-Identifier: Apache-2.0
"""`bt-agents check`: every problem of a trees folder, without a robot and even without ROS."""

from __future__ import annotations

import sys

import click

from bt_agents.errors import BtAgentsError, ReadError
from bt_agents.language.folder_reader import read_trees
from bt_agents.language.interfaces import Interfaces
from bt_agents.language.script_reader import read_script
from bt_agents.trees_folder import find_trees


@click.command()
@click.argument("directory", required=False, default="")
def check(directory: str) -> None:
    """List every problem of a trees DIRECTORY.

    Exit code 1 when there is one. ROS types are looked up where ROS is installed.
    """
    if directory.endswith((".yaml", ".yml")):
        raise BtAgentsError(
            f"'{directory}' is a file; name the trees folder, whose scene and skills it needs"
        )
    folder = read_trees(find_trees(directory), _installed())
    reports = [broken.error.report for broken in folder.broken]
    for script in sorted((folder.folder / "scripts").glob("*.yaml")):
        try:
            read_script(script, folder.scene.space)
        except ReadError as error:
            reports.append(error.report)
    for agent in folder.agents:
        click.echo(f"{agent.file}: {agent.name} is fine")
    if not folder.agents:
        reports.append(f"there is no agent that works in {folder.folder / 'agents'}")
    for report in reports:
        click.echo(report)
    sys.exit(1 if reports else 0)


def _installed() -> Interfaces | None:
    """Return the installed ROS types; None without ROS, where types stay unchecked."""
    try:
        from bt_agents.ros.interfaces import InstalledInterfaces
    except ImportError:
        return None
    return InstalledInterfaces()
