# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents check`: lists the problems of a trees folder, even without ROS."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import click

from bt_agents_core.diagnostic import Severity
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.file_watch import changes, poll
from bt_agents_core.trees_folder import enclosing_folder
from bt_agents_language.diagnostics.renderers import (
    as_annotation,
    as_json,
    as_text,
    count,
    wants_colour,
)
from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.files.folder_reader import SUFFIXES
from bt_agents_language.tools.folder_check import Checked, check_folder
from bt_agents_ros.signals import end_silently
from bt_agents_tools.cli.formatting import counted
from bt_agents_tools.cli.trees_choice import named_path, take_trees
from bt_agents_tools.rehearsal.suite import installed_types


@click.command()
@click.argument("paths", nargs=-1, metavar="[PATH]...")
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "json", "github"]),
    default="text",
    show_default=True,
    help="text for people, json for programs, github for annotations in a workflow.",
)
@click.option("--strict", is_flag=True, help="Warnings count as errors for the exit code.")
@click.option("--watch", is_flag=True, help="Check again whenever a file changes, until Ctrl-C.")
def check(paths: tuple[str, ...], form: str, strict: bool, watch: bool) -> None:
    """List every problem of a trees folder, or of some files in it.

    A PATH is a trees folder, or an agent, test, skills, library or script in one; without it, it
    is this folder, or the folder 'trees' here. Exit code 1 when there is an error; warnings alone
    are none. 'bt-agents explain CODE' tells more about a problem. ROS types are looked up where
    ROS is installed.
    """
    show = _SHOW[form]
    if not watch:
        checked = check_paths(paths, installed_types())
        show(checked)
        fails = count(checked.problems, Severity.ERROR) or (strict and checked.problems)
        sys.exit(1 if fails else 0)
    try:
        for _ in watched(paths, show, time.sleep):
            click.echo(time.strftime("— checked again at %H:%M:%S"), err=True)
    except KeyboardInterrupt:
        end_silently()


def check_paths(paths: Iterable[str], interfaces: Interfaces | None) -> Checked:
    """Return the problems of folders and files.

    Raises:
        BtAgentsError: A path is neither a trees folder nor a file that belongs in one.
    """
    wanted: dict[Path, list[Path] | None] = {}
    for path in map(named_path, paths):
        folder, part = _located(path)
        # A whole folder includes its parts.
        if part is None or wanted.get(folder, []) is None:
            wanted[folder] = None
        else:
            wanted[folder] = [*(wanted.get(folder) or []), part]
    if not wanted:
        wanted[take_trees()] = None
    found = []
    for folder, only in wanted.items():
        checked = check_folder(folder, interfaces, only)
        if only and not checked.files and not checked.unchecked:
            raise BtAgentsError(
                f"'{only[0]}' is not a file that the robot reads: in '{folder}' these are "
                "scene.yaml and the .yaml files of agents, skills, libraries, scripts and texts"
            )
        found.append(checked)
    return Checked(
        problems=tuple(problem for one in found for problem in one.problems),
        agents=tuple(agent for one in found for agent in one.agents),
        files=sum(one.files for one in found),
        unchecked=tuple(file for one in found for file in one.unchecked),
    )


def watched(
    paths: tuple[str, ...], show: Callable[[Checked], None], sleep: Callable[[float], None]
) -> Iterator[tuple[str, ...]]:
    """Check and show now and after each change; yield the files that changed.

    ``sleep`` waits for a number of seconds; it raises ``KeyboardInterrupt`` to end.
    """
    interfaces = installed_types()
    folders = {_located(named_path(path))[0] for path in paths} or {take_trees()}
    # Poll before the check, so that a change during the check is not missed.
    seen = changes(lambda: poll(folders, SUFFIXES), sleep)
    show(check_paths(paths, interfaces))
    for changed in seen:
        yield changed
        try:
            show(check_paths(paths, interfaces))
        except BtAgentsError as error:
            click.echo(f"error: {error}", err=True)


def summary(checked: Checked) -> str:
    """Return the result in one line: ``4 agents are fine, 1 warning``."""
    parts = []
    agents, fine = len(checked.agents), not count(checked.problems, Severity.ERROR)
    if agents:
        parts.append(f"{counted(agents, 'agent')} {'is' if agents == 1 else 'are'} fine")
    elif fine:
        files = checked.files
        parts.append(f"{counted(files, 'file')} {'is' if files == 1 else 'are'} fine")
    for severity in Severity:
        number = count(checked.problems, severity)
        if number:
            parts.append(counted(number, severity.value))
    if checked.unchecked:
        parts.append(
            f"{counted(len(checked.unchecked), 'file')} not checked: correct scene.yaml and the "
            "skills files first"
        )
    return ", ".join(parts)


def _located(path: Path) -> tuple[Path, Path | None]:
    """Return the trees folder of a path, and the part of the folder that the path selects."""
    if (path / "scene.yaml").is_file():
        return path, None
    if (path / "trees" / "scene.yaml").is_file():
        return path / "trees", None
    # A dangling link exists, and is a problem.
    if not os.path.lexists(path):
        raise BtAgentsError(f"there is no file or folder '{path}'; check the name")
    return enclosing_folder(path), path


def _show_text(checked: Checked) -> None:
    colour = wants_colour(sys.stdout, os.environ)
    if checked.problems:
        click.echo(as_text(checked.problems, colour), color=colour)
    click.echo(summary(checked))


def _show_json(checked: Checked) -> None:
    about = {"agents": checked.agents, "files": checked.files, "unchecked": checked.unchecked}
    click.echo(as_json(checked.problems, about))


def _show_annotations(checked: Checked) -> None:
    for problem in checked.problems:
        click.echo(as_annotation(problem))
    click.echo(summary(checked))


_SHOW: Mapping[str, Callable[[Checked], None]] = {
    "text": _show_text,
    "json": _show_json,
    "github": _show_annotations,
}
