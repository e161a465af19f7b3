# SPDX-License-Identifier: Apache-2.0
"""`bt-agents replay`: repeats the contents of a journal without ROS and compares the results."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import printable
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.table import print_json

with loading():
    from bt_agents_lab.cli.journal import (
        damage_reported,
        files_argument,
        read_files,
        show_problems,
    )
    from bt_agents_lab.replay import decisions, replay_learning
    from bt_agents_lab.replay.findings import FindingCounts, ReplayVerdict
    from bt_agents_lab.replay.recording_index import RecordingIndex

_MOST_SHOWN = 10
_NAMES = 15
_COLUMN = 14
_KINDS = ((decisions.KIND, "decisions"), (replay_learning.KIND, "profile changes"))


@click.command()
@files_argument
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def replay(files: tuple[Path, ...], as_json: bool) -> None:
    """Decide and learn again what the FILES of a journal hold.

    The exit code is 1 if something differs, else 2 if a part could not be read or is lost.
    Without FILES it takes the newest day of the trees folder here.
    """
    recording = read_files(files)
    with damage_reported():
        found = FindingCounts(
            [
                *decisions.replay_decisions(recording.rounds),
                *replay_learning.replay_feedback(recording.feedbacks),
            ]
        )
    if as_json:
        print_json(_as_data(recording, found))
    else:
        _show(Console(highlight=False, soft_wrap=True), recording, found)
    if not found.counts:
        raise BtAgentsError("there is nothing to do again: no round and no feedback was recorded")
    if found.different:
        sys.exit(1)
    sys.exit(0 if recording.whole else 2)


def _show(console: Console, recording: RecordingIndex, found: FindingCounts) -> None:
    show_problems(console, recording)
    heads = "".join(f"{verdict.value:>{_COLUMN}}" for verdict in ReplayVerdict)
    console.print(f"{'':{_NAMES}}{heads}")
    for kind, title in _KINDS:
        numbers = "".join(f"{found.counts[kind, verdict]:>{_COLUMN}}" for verdict in ReplayVerdict)
        console.print(f"{title:{_NAMES}}{numbers}")
    for verdict, style in (
        (ReplayVerdict.DIFFERENT, "red"),
        (ReplayVerdict.NOT_RECORDED, "yellow"),
    ):
        unequal = [finding for finding in found.unequal if finding.verdict is verdict]
        for one in unequal[:_MOST_SHOWN]:
            text = escape(printable(f"{one.where}: {one.text}"))
            console.print(f"[{style}]{verdict.value}[/] {one.kind}, {text}")
        if len(unequal) > _MOST_SHOWN:
            console.print(f"… and {len(unequal) - _MOST_SHOWN} more, {verdict.value}")
    if found.different:
        console.print("[red]not equal[/]")
    elif found.counts and not recording.whole:
        text = "all that could be read is equal; a part of it could not, or is lost"
        console.print(f"[yellow]{text}[/]")
    elif found.unequal or (found.counts and not recording.is_counted):
        console.print("[green]all that was recorded is equal[/]")
    elif found.counts:
        console.print("[green]everything is equal[/]")


def _as_data(recording: RecordingIndex, found: FindingCounts) -> dict[str, object]:
    return {
        "counts": {
            title: {verdict.value: found.counts[kind, verdict] for verdict in ReplayVerdict}
            for kind, title in _KINDS
        },
        "findings": [
            {"kind": one.kind, "where": one.where, "verdict": one.verdict.value, "words": one.text}
            for one in found.unequal
        ],
        "problems": [*recording.hints, *recording.problems],
        "lost": dict(recording.lost),
    }
