# SPDX-License-Identifier: Apache-2.0
"""`bt-agents journal`: what a journal holds."""

from __future__ import annotations

import time
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bt_agents_ros.signals import loading

with loading():
    from bt_agents_lab.cli.journals import (
        chosen,
        files_argument,
        read_story,
        sense_of_it,
        show_problems,
    )
    from bt_agents_lab.replay.recording_index import RecordingIndex
    from bt_agents_lab.replay.scenes import named


@click.command()
@files_argument
def journal(files: tuple[Path, ...]) -> None:
    """Show what the FILES of a journal hold: topics, time, rounds and who won them.

    Without FILES it takes the newest of the usual folder.
    """
    paths = chosen(files)
    story = read_story(paths)
    console = Console()
    for path in paths:
        size = path.stat().st_size
        console.print(f"{escape(str(path))}  {size / 1e6:.2f} MB", highlight=False, soft_wrap=True)
    show_problems(console, story)
    total = sum(story.counts.values())
    console.print(
        f"{_moment(story.first_ns)} to {_moment(story.last_ns)}, {total} messages",
        highlight=False,
    )
    _show_topics(console, story)
    with sense_of_it():
        _show_rounds(console, story)


def _show_topics(console: Console, story: RecordingIndex) -> None:
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(justify="right")
    table.add_column()
    for topic, number in sorted(story.counts.items()):
        table.add_row(str(number), escape(topic))
    console.print(table)


def _show_rounds(console: Console, story: RecordingIndex) -> None:
    for one in story.rounds:
        auction = one.auction
        winner = f"{auction.winner} wins" if auction.winner else "nobody"
        console.print(
            f"round {auction.round}  {escape(named(auction.scene))}: {escape(winner)}",
            highlight=False,
            soft_wrap=True,
        )


def _moment(nanoseconds: int) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(nanoseconds / 1e9))
