# SPDX-License-Identifier: Apache-2.0
"""Which files of the journal a command reads, and what they hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import click
from rich.console import Console

from bt_agents.cli.system import journal_folder
from bt_agents.errors import BtAgentsError
from bt_agents_lab.journal.reading import JournalReader
from bt_agents_lab.replay.story import Story, tell
from marketplace_node.strategies.plugins import add_installed

Command = TypeVar("Command", bound=Callable[..., object])


def files_argument(command: Command) -> Command:
    """Add the argument FILES to a command."""
    files = click.argument("files", nargs=-1, type=click.Path(path_type=Path))
    return files(command)


def read_story(files: Sequence[Path]) -> Story:
    """Return what some files hold.

    Args:
        files: Files, or folders of the journal; none takes the newest file of the usual folder.

    Raises:
        BtAgentsError: There is no file, or one cannot be read at all.
    """
    reader = JournalReader(chosen(files))
    story = tell(reader.entries())
    story.problems[:0] = [*add_installed(), *reader.problems]
    if not story.counts:
        words = "; ".join(story.problems) or "it is empty"
        raise BtAgentsError(f"nothing can be read of the journal: {words}")
    return story


def chosen(files: Sequence[Path]) -> list[Path]:
    """Return the files that are meant; see :func:`read_story`."""
    if not files:
        found = sorted(journal_folder().glob("*.mcap"))
        if not found:
            raise BtAgentsError(
                f"there is no journal in {journal_folder()}; 'bt-agents up --journal' keeps one, "
                "or name a file"
            )
        return found[-1:]
    paths: list[Path] = []
    for path in files:
        inside = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if not inside:
            raise BtAgentsError(f"there is no journal in the folder {path}")
        paths += inside
    return paths


def show_problems(console: Console, story: Story) -> None:
    """Print what cannot be read and what is lost."""
    for words in story.problems:
        console.print(f"[yellow]{words}[/]", highlight=False, soft_wrap=True)
    for topic, number in sorted(story.lost.items()):
        console.print(
            f"[yellow]{number} messages on {topic} are lost: the journal had no room[/]",
            highlight=False,
            soft_wrap=True,
        )
