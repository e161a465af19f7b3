# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents security`: writes the SROS2 policy for DDS security."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.trees_choice import take_trees
from bt_agents_tools.security_policy import policy_xml


@click.command()
@click.argument("directory", required=False, default="")
@click.option("--output", "-o", type=click.Path(dir_okay=False, path_type=Path), required=True)
@click.option("--host", "hosts", multiple=True, default=("agents",), help="Name of each host.")
@click.option("--namespace", default="/", show_default=True, help="Of all nodes.")
def security(directory: str, output: Path, hosts: Sequence[str], namespace: str) -> None:
    """Write what each node and each role of the commands may use, for 'ros2 security'.

    DIRECTORY is the trees folder, whose sensors and skills are allowed too.
    """
    trees = take_trees(directory)
    with loading():
        from bt_agents_ros.installed import InstalledInterfaces
    folder = read_trees(trees, InstalledInterfaces())
    if folder.broken:
        click.echo(f"left out, so that their skills have no rights:\n{folder.report}", err=True)
    output.write_text(policy_xml(folder, hosts, namespace), encoding="utf-8")
    click.echo(str(output))
