# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents demo`: plays a scripted morning at an airport."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import click

from bt_agents_core.state_folder import find_state
from bt_agents_core.trees_folder import SHIPPED, NoTreesFolderError, find_trees
from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.run_system import (
    journal_components,
    journal_option,
    one_process_option,
    run_system,
    studio_plan,
)
from bt_agents_tools.cli.trees_choice import say_trees
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.domain_lock import reserve_domain

_MORNING = Path("scripts") / "airport_morning.yaml"


@click.command()
@click.option("--voice/--no-voice", default=True, help="Speak aloud when espeak-ng is installed.")
@click.option(
    "--script",
    type=click.Path(path_type=Path),
    help="Script of visits, instead of the morning at the airport.",
)
@click.option("--tags", help="Agents with these tags.  [default: airport; with --script, all]")
@click.option("--browser", is_flag=True, help="Be the visitor yourself, in a browser.")
@one_process_option
@journal_option
def demo(
    voice: bool,
    script: Path | None,
    tags: str | None,
    browser: bool,
    one_process: bool,
    journal: str | None,
) -> None:
    """Show a morning at an airport, in a minute; or the visits of another script, to its end.

    With --browser you are the visitor, until Ctrl-C. The exit code is 1 if a change of a visit had
    no effect.
    """
    if browser and script:
        raise click.UsageError("--browser and --script exclude each other: who is the visitor?")
    interrupt = Interrupt()
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    trees = _folder(script)
    say_trees(trees)
    if tags is None:
        tags = "" if script else "airport"
    script = script or trees / _MORNING
    with tempfile.TemporaryDirectory(prefix="bt-agents-demo-") as folder:
        state = find_state(trees)
        processes = [
            components.robot("auto" if voice and not browser else "off", needs_screen=browser),
            components.market(trees),
            components.scene_layer(trees),
            components.host(trees, tags),
            components.feedback(trees, ledger=str(Path(folder) / "ledger.sqlite")),
        ]
        if one_process:
            processes = [components.one_process(processes)]
        processes += journal_components(journal, state)
        if browser:
            recordings = Path(journal).resolve() if journal else state.journal
            plan = studio_plan(
                trees, Path(folder), recordings, browser_robot=True, opens=_has_display()
            )
            run_system("demo", processes, trees, tags, interrupt, studio=plan)
        else:
            visitors = components.visitors(trees, script)
            if not run_system("demo", processes, trees, tags, interrupt, visitors):
                sys.exit(1)


def _has_display() -> bool:
    """Return whether a browser would open a window; without one, some open in the terminal."""
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _folder(script: Path | None) -> Path:
    """Return the trees folder here if it has the needed files, else the installation's."""
    try:
        here = find_trees()
    except NoTreesFolderError:
        return find_trees(SHIPPED)
    return here if script or (here / _MORNING).is_file() else find_trees(SHIPPED)
