# SPDX-License-Identifier: Apache-2.0
"""Which files of the journal a command reads, and what they hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_core.errors import BtAgentsError
from bt_agents_lab.replay.recording_index import RecordingIndex, read
from bt_agents_tools.launcher.components import journal_folder
from marketplace_node.strategies.plugins import add_installed

Command = TypeVar("Command", bound=Callable[..., object])


def files_argument(command: Command) -> Command:
    """Add the argument FILES to a command."""
    files = click.argument("files", nargs=-1, type=click.Path(path_type=Path))
    return files(command)


def read_story(files: Sequence[Path]) -> RecordingIndex:
    """Return what some files hold.

    Args:
        files: Files, or folders of the journal; none takes the newest file of the usual folder.

    Raises:
        BtAgentsError: There is no file, or one cannot be read at all.
    """
    story = read(chosen(files))
    story.hints += add_installed()
    if not story.counts:
        words = "; ".join([*story.hints, *story.problems]) or "it is empty"
        raise BtAgentsError(f"nothing can be read of the journal: {words}")
    return story


@contextmanager
def sense_of_it() -> Iterator[None]:
    """Say in words that a message, though it can be decoded, has not the fields of its type."""
    try:
        yield
    except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise BtAgentsError(
            f"the journal holds a message that makes no sense ({type(error).__name__}: {error}); "
            "it is damaged, or of another version of bt-agents"
        ) from error


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


def show_problems(console: Console, story: RecordingIndex) -> None:
    """Print what cannot be read and what is lost."""
    for words in (*story.hints, *story.problems):
        console.print(f"[yellow]{escape(words)}[/]", highlight=False, soft_wrap=True)
    for topic, number in sorted(story.lost.items()):
        console.print(
            f"[yellow]{number} messages on {escape(topic)} are lost[/]",
            highlight=False,
            soft_wrap=True,
        )
