# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents visit`: sends the visitors of a script to a running system."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.script_reader import read_script
from bt_agents_robot.people import check_visitors
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.connection import connect, find_hosts
from bt_agents_tools.cli.decisions import SOON_S, end_text, names_of_scenes
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.supervisor import Supervisor

_POLL_S = 0.2


@click.command()
@click.argument("script", type=click.Path(path_type=Path))
def visit(script: Path) -> None:
    """Have the visitors of a SCRIPT come, one after the other, until its end.

    For example: bt-agents visit trees/scripts/airport_morning.yaml. The exit code is 1 if a change
    of a visit had no effect.
    """
    observer = connect()
    trees = Path(observer.cards[find_hosts(observer)[0]].trees)
    scene = read_scene(trees / "scene.yaml")
    check_visitors(scene, read_script(script, scene.space))
    visitors, done = observer.received("visitors/current"), observer.received("visitors/done")
    remarks = observer.received("visitors/remarks")
    ends = observer.received("bt_agents/scene_ends")
    auctions = observer.received("bt_agents/auctions")
    observer.spin_until(observer.is_visited, SOON_S)
    if observer.is_visited():
        raise BtAgentsError("visitors of a script are there already; wait until they are gone")
    came, ended, remarked = 0, len(ends), 0
    supervisor = Supervisor(new_log_folder())
    interrupt = Interrupt()
    try:
        supervisor.start(components.visitors(trees, script.resolve()))
        while not (interrupt or done):
            supervisor.poll()
            observer.spin_until(lambda: bool(interrupt or done), _POLL_S)
            for visitor in visitors[came:]:
                if visitor.data:  # empty for a visitor who leaves
                    click.echo(visitor.data)
            names = names_of_scenes(auctions)
            for end in ends[ended:]:
                click.echo(f"  {end_text(end, names)}")
            for remark in remarks[remarked:]:
                click.echo(f"  {remark.data}", err=True)
            came, ended, remarked = len(visitors), len(ends), len(remarks)
    finally:
        supervisor.stop()
    click.echo("stopped" if interrupt else "all visits are over")
    if remarks and not interrupt:
        sys.exit(1)
