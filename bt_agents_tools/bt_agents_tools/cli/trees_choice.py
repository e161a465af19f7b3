# SPDX-License-Identifier: Apache-2.0
"""Choice of a command's trees folder and state folder, with a note on standard error."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import StateFolder, find_state
from bt_agents_core.text import printable_line
from bt_agents_core.trees_folder import SHIPPED, NoTreesFolderError, find_trees

state_option = click.option(
    "--state",
    default="",
    metavar="DIR",
    help="What was learned, tuned and ordered; without it each trees folder has its own.",
)

journal_option = click.option(
    "--journal",
    type=click.Path(path_type=Path),
    help="Read it from this journal, or bag of 'ros2 bag record'.",
)


def take_trees(named: str = "", *, is_argument: bool = True) -> Path:
    """Return the trees folder that a command works on; print it if the user named none.

    Args:
        named: As for :func:`find_trees`.
        is_argument: Whether the command has an argument or option that names the folder.

    Raises:
        BtAgentsError: As in :func:`find_trees`; the message says how to choose a folder.
    """
    try:
        folder = find_trees(named)
    except NoTreesFolderError as error:
        near = error.near or SHIPPED
        if is_argument:
            what = " for the installation's folder" if near == SHIPPED else ""
            choose = f"name one, as in '{_named_as(near)}'{what}"
        else:
            choose = f"go there with 'cd {near}'" if error.near else "go to one with 'cd'"
        raise BtAgentsError(f"{error}; {choose}, or make one with 'bt-agents new NAME'") from None
    if named in ("", SHIPPED):
        say_trees(folder)
    return folder


def named_path(path: str | Path) -> Path:
    """Return the path of an argument, which may be the name of the shipped trees folder."""
    return take_trees(SHIPPED) if str(path) == SHIPPED else Path(path)


def say_trees(folder: Path) -> None:
    """Print which trees folder a command uses."""
    _say(f"trees folder: {folder.resolve()}")


def say_trees_of_system(folders: Iterable[str]) -> None:
    """Print the trees folders of the hosts of the running system."""
    known = sorted({printable_line(folder) for folder in folders if folder})
    if known:
        _say(f"trees folder of the system: {', '.join(known)}")


def kept_state(state: str = "") -> StateFolder:
    """Return and print the state folder of the trees folder here, or the named one.

    Raises:
        BtAgentsError: As in :func:`find_trees` and :func:`find_state`.
    """
    found = find_state(take_trees(is_argument=False), state)
    _say(f"kept in {found.path}")
    if found.note:
        _say(found.note)
    return found


def _say(text: str) -> None:
    """Print a note to standard error, unless a program reads the output."""
    context = click.get_current_context(silent=True)
    options = context.params if context is not None else {}
    if not (options.get("as_json") or options.get("as_csv") or options.get("form") == "json"):
        click.echo(text, err=True)


def _named_as(folder: str | Path) -> str:
    """Return how to name a trees folder for the current command."""
    context = click.get_current_context()
    options = {name for one in context.command.params for name in one.opts}
    return f"{context.command_path} {'… --dir ' if '--dir' in options else ''}{folder}"
