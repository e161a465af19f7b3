# SPDX-License-Identifier: Apache-2.0
"""`bt-agents journal`: shows the contents of journals; also reads them for other commands."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import scene_name
from bt_agents_core.text import printable, printable_lines
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.formatting import moment_text
from bt_agents_tools.cli.trees_choice import kept_state

with loading():
    from bt_agents_lab.recorder.daily_recorder import newest_files
    from bt_agents_lab.replay.recording_index import RecordingIndex, Round, read
    from bt_agents_lab.results import ResultFile, ResultRow, row_of_feedback, rows_of_auction
    from marketplace_node.strategies.plugins import add_installed

files_argument = click.argument("files", nargs=-1, type=click.Path(path_type=Path))


@click.command()
@files_argument
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Write every round, bid and feedback to FILE.csv or FILE.parquet.",
)
def journal(files: tuple[Path, ...], out: Path | None) -> None:
    """Show what the FILES of a journal hold: topics, time, rounds and who won them.

    Without FILES it takes the newest day of the trees folder here. A bag of 'ros2 bag
    record' is one, too.
    """
    results = ResultFile(out) if out is not None else None
    recording = read_files(files)
    console = Console(highlight=False, soft_wrap=True)
    for path in recording.files:
        console.print(f"{escape(str(path))}  {path.stat().st_size / 1e6:.2f} MB")
    show_problems(console, recording)
    total = sum(recording.counts.values())
    first, last = moment_text(recording.first_ns / 1e9), moment_text(recording.last_ns / 1e9)
    console.print(f"{first} to {last}, {total} messages")
    for one in recording.recordings.values():
        if one.label or one.notes:
            console.print(_escaped(f"{one.file}: {_described(one)}"))
    for one in recording.bookmarks:
        console.print(_escaped(f"{moment_text(one.header.stamp.sec)}  marked: {_described(one)}"))
    digits = len(str(max(recording.counts.values())))
    for topic, number in sorted(recording.counts.items()):
        console.print(f"{number:>{digits}}  {_escaped(topic)}")
    with damage_reported():
        for one in recording.rounds:
            winner = f"{one.auction.winner} wins" if one.auction.winner else "nobody"
            text = _escaped(f"{scene_name(one.auction.scene)}: {winner}")
            console.print(f"round {one.auction.round}  {text}")
        if results is not None:
            results.write(_parameters(recording), _result_rows(recording))
            console.print(f"written to {escape(str(out))}")


def _result_rows(recording: RecordingIndex) -> Iterator[ResultRow]:
    for one in recording.rounds:
        yield from rows_of_auction(one.auction)
    for feedback in recording.feedbacks:
        yield row_of_feedback(feedback.feedback)


def _parameters(recording: RecordingIndex) -> list[str]:
    """Return all parameters of scenes and feedback, in order of appearance."""
    of_rounds = (value.name for one in recording.rounds for value in one.auction.scene.values)
    of_feedback = (name for one in recording.feedbacks for name in one.feedback.parameters)
    return list(dict.fromkeys([*of_rounds, *of_feedback]))


def read_files(files: Sequence[Path]) -> RecordingIndex:
    """Return the contents of journals and bags, by default of the newest day here.

    Raises:
        BtAgentsError: There is no file, one is unreadable, or they hold several systems.
    """
    paths = files or newest_journal(kept_state().journal)
    recording = read(paths, os.environ.get("ROS_NAMESPACE", ""))
    recording.hints += add_installed()
    if not recording.counts:
        reasons = "; ".join([*recording.hints, *recording.problems]) or "it is empty"
        raise BtAgentsError(f"nothing can be read of the journal: {reasons}")
    return recording


@contextmanager
def damage_reported() -> Iterator[None]:
    """Report a decodable message whose fields differ from its type as damage.

    Raises:
        BtAgentsError: There is such a message.
    """
    try:
        yield
    except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise BtAgentsError(
            f"the journal holds a message that makes no sense ({type(error).__name__}: {error}); "
            "it is damaged, or of another version of bt-agents"
        ) from error


def recorded_rounds(files: Sequence[Path]) -> list[Round]:
    """Return the rounds of journals and bags, the oldest first.

    Their texts are made printable, because a journal may hold messages from anybody. What is
    unreadable or lost is printed to standard error.

    Raises:
        BtAgentsError: There is no journal, or it is unreadable.
    """
    recording = read_files(files)
    show_problems(Console(stderr=True, highlight=False, soft_wrap=True), recording)
    rounds = recording.rounds
    for one in rounds:
        printable_message([one.auction, *one.run_events])
    return rounds


def printable_message(value: Any) -> Any:
    """Return a recorded message or a part of it with printable texts."""
    match value:
        case str():
            return printable(value)
        case list():
            return list(map(printable_message, value))
        case SimpleNamespace():
            for name in value.__slots__:
                part = getattr(value, name)
                # This is the only text of a decision with several lines.
                shown = printable_lines(part) if name == "explanation" else printable_message(part)
                setattr(value, name, shown)
    return value


def _escaped(text: str) -> str:
    return escape(printable(text))


def newest_journal(folder: Path) -> list[Path]:
    """Return the files of the newest day in the folder of a journal.

    Raises:
        BtAgentsError: There is none.
    """
    found = newest_files(folder)
    if not found:
        raise BtAgentsError(
            f"there is no journal in {folder}; 'bt-agents up --journal' records one, or name a "
            "file"
        )
    return found


def show_problems(console: Console, recording: RecordingIndex) -> None:
    """Print unreadable and lost parts."""
    for text in (*recording.hints, *recording.problems):
        console.print(f"[yellow]{_escaped(text)}[/]")
    for topic, number in sorted(recording.lost.items()):
        console.print(f"[yellow]{number} messages on {_escaped(topic)} are lost[/]")


def _described(one: Any) -> str:
    """Return the label, notes and author of a recording or a bookmark, if any."""
    author = f" ({one.author})" if one.author else ""
    notes = f" - {one.notes}" if one.notes else ""
    return f"{one.label or 'no label'}{notes}{author}"
