# SPDX-License-Identifier: Apache-2.0
"""The command that shows the trace of a recorded run; what all commands print of its texts."""

from __future__ import annotations

import copy
import csv
import json
from pathlib import Path
from typing import Any

import pytest
from click import Command
from click.testing import CliRunner, Result

from bt_agents_interfaces.msg import Auction, TreeStatus
from bt_agents_lab.cli.journal import journal, recorded_rounds
from bt_agents_lab.cli.replay import replay
from bt_agents_lab.cli.trace import trace
from bt_agents_lab.cli.what_if import what_if
from bt_agents_tools.cli.commands.why import why
from command_results import split_runner
from hostile_texts import HOSTILE
from journal_fixture import JournaledSystem


@pytest.fixture
def path(journaled: JournaledSystem, tmp_path: Path) -> Path:
    return journaled.write(tmp_path / "a.mcap")


def shown(path: Path, *options: str) -> Result:
    return split_runner().invoke(trace, ["--journal", str(path), *options])


def test_each_element_has_its_status_and_values(path: Path) -> None:
    rows = json.loads(shown(path, "1", "--json").stdout)
    told = [(one["tick"], one["path"], one["status"], one["values"]) for one in rows]
    assert told[:4] == [
        (1, "tree/0.say", "running", {}),
        (1, "tree", "running", {}),
        (4, "tree/0.say", "success", {"answer": "'kind'"}),
        (4, "tree/1.mood", "success", {}),
    ]
    assert told[-1][1:] == ("tree", "success", {})


def test_people_and_tables_get_the_values_as_text(path: Path) -> None:
    lines = shown(path, "1", "--wide").stdout.splitlines()
    assert lines[0] == "bert, round 1"
    assert any("success" in line and "answer = 'kind'" in line for line in lines)
    rows = list(csv.DictReader(shown(path, "1", "--csv").stdout.splitlines()))
    assert rows[2]["values"] == "answer = 'kind'"


def test_without_a_round_it_is_the_last_run(path: Path) -> None:
    assert shown(path).stdout == shown(path, "4").stdout
    assert shown(path).stdout.splitlines()[0].endswith("round 4")


def test_a_round_without_a_run_is_named(path: Path) -> None:
    told = str(shown(path, "9").exception)
    assert told == "no run of round 9 is in the journal; there are rounds 1, 2, 3 and 4"


def test_a_round_of_several_starts_is_named(journaled: JournaledSystem, tmp_path: Path) -> None:
    def alter(_: int, message: Any) -> Any:
        if getattr(message, "round", 0) == 2:
            message = copy.deepcopy(message)
            message.epoch, message.round = "later", 1
        return message

    path = str(journaled.write(tmp_path / "a.mcap", alter))
    for command in (why, trace):
        result = split_runner().invoke(command, ["1", "--journal", path])
        assert "2 times with a round 1; this is the last" in result.stderr


def test_lost_messages_are_counted(journaled: JournaledSystem, tmp_path: Path) -> None:
    numbers = [
        n for n, one in enumerate(journaled.published) if isinstance(one.message, TreeStatus)
    ]
    path = journaled.write(tmp_path / "a.mcap", lambda n, m: None if n == numbers[1] else m)
    assert "1 messages about trees are lost" in shown(path, "1").stderr


@pytest.mark.parametrize("options", [[], ["--json"], ["--csv"]])
def test_commands_name_what_a_torn_journal_lacks(path: Path, options: list[str]) -> None:
    path.write_bytes(path.read_bytes()[:-3000])
    for command, asked in (
        (what_if, [str(path)]),
        (why, ["--journal", str(path)]),
        (trace, ["--journal", str(path)]),
    ):
        result = split_runner().invoke(command, [*asked, *options])
        assert "ends in the middle of a record" in result.stdout + result.stderr
        if options:
            assert "ends in the middle" not in result.stdout


def test_trace_of_an_unreadable_file_says_why(path: Path) -> None:
    path.write_text("no journal")
    assert "can be read to byte 8 only" in shown(path).stderr


def test_raw_journal_text_is_never_printed(journaled: JournaledSystem, tmp_path: Path) -> None:
    def alter(_: int, message: Any) -> Any:
        message = copy.deepcopy(message)
        if isinstance(message, Auction):
            message.winner = message.scene.label = message.reason = message.explanation = HOSTILE
        if isinstance(message, TreeStatus):
            message.agent = HOSTILE
            for change in message.changes:
                change.name = change.message = change.path = HOSTILE
                for value in change.values:
                    value.name = value.value = HOSTILE
        return message

    path = journaled.write(tmp_path / "a.mcap", alter)
    of_journal: tuple[Command, ...] = (journal, replay, what_if)
    for command, options in (
        *((one, [str(path)]) for one in of_journal),
        (what_if, ["--csv", str(path)]),
        (trace, ["--journal", str(path)]),
        (trace, ["--csv", "--journal", str(path)]),
    ):
        output = CliRunner().invoke(command, options).output
        assert "title" in output
        assert not [one for one in output if not one.isprintable() and one != "\n"]
    decision = recorded_rounds([path])[-1].auction
    assert decision.winner.isprintable()
    assert decision.scene.label.isprintable()
    assert len(decision.explanation.splitlines()) == 2
