# SPDX-License-Identifier: Apache-2.0
"""The command `bt-agents` as a whole: its imports, lists and refusals."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from bt_agents_tools.cli.main import _MEANT, TASKS, all_commands, bt_agents
from programs import printed_by

LOADED = """
import sys
from bt_agents_tools.cli.main import bt_agents
bt_agents({arguments!r}, standalone_mode=False)
print(sorted(n for n in sys.modules if n.startswith("bt_agents") and "." in n))
"""


def test_every_command_belongs_to_one_task() -> None:
    assert sorted(name for names in TASKS.values() for name in names) == sorted(all_commands())


def test_help_repeats_own_summary_of_each_command() -> None:
    context = click.Context(bt_agents)
    formatter = click.HelpFormatter(width=1000)
    bt_agents.format_commands(context, formatter)
    lines = formatter.getvalue().splitlines()
    shown = dict(line.split(maxsplit=1) for line in lines if line.startswith("  "))
    assert shown.keys() == all_commands().keys()
    for name, text in shown.items():
        command = bt_agents.get_command(context, name)
        assert command is not None
        assert text == command.get_short_help_str(1000)


def test_argument_that_is_not_utf8_is_refused() -> None:
    command = [sys.executable, "-m", "bt_agents_tools.cli", "answer", "caf\udce9"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 1
    assert "error: the argument 'caf\\udce9' is not UTF-8" in ended.stderr


def test_help_loads_no_command() -> None:
    loaded = ast.literal_eval(printed_by(LOADED.format(arguments=["--help"]))[-1])
    assert not {entry.module for entry in all_commands().values()} & {*loaded}
    assert "bt_agents_tools.cli.main" in loaded


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("dance", "No such command 'dance'"),
        ("sense", "--no-person"),
        ("statsu", "no command 'statsu'; did you mean 'status'?"),
        ("undo", "no command 'undo'; there is 'tune --undo' for tuning"),
        ("up --memory l.sqlite --ledger l.sqlite", "--memory names the ledger"),
        ("up --robot browser --no-studio", "--robot browser needs the robot and the studio"),
        ("up --robot browser --no-robot", "--robot browser needs the robot and the studio"),
        ("status --json --csv", "--json and --csv do not go together"),
        ("up --only market,seen", "robot, with commas between; did you mean 'scene'?"),
        ("demo --browser --script a.yaml", "who is the visitor?"),
    ],
)
def test_impossible_command_line_is_refused_with_reason(line: str, words: str) -> None:
    result = CliRunner().invoke(bt_agents, line.split())
    assert result.exit_code == 2
    assert words in result.output


def test_suggested_commands_exist_and_hide_no_command() -> None:
    for word, meant in _MEANT.items():
        assert word not in all_commands()
        for command in re.findall("'([^']+)'", meant):
            name, *rest = command.split()
            loaded = bt_agents.get_command(click.Context(bt_agents), name)
            assert loaded is not None, command
            known = {option for one in loaded.params for option in one.opts}
            known |= set(getattr(loaded, "commands", {}))
            assert {one for one in rest if not one.isupper()} <= known, command


def test_version_loads_no_command() -> None:
    version, loaded = printed_by(LOADED.format(arguments=["--version"]))
    assert version.startswith("bt-agents, version ")
    assert ast.literal_eval(loaded) == [
        "bt_agents_core.diagnostic",
        "bt_agents_core.errors",
        "bt_agents_core.gc_pause",
        "bt_agents_core.optional_packages",
        "bt_agents_core.refusal_codes",
        "bt_agents_core.text",
        "bt_agents_ros.signals",
        "bt_agents_ros.workarounds",
        "bt_agents_ros.workarounds.bounded_end",
        "bt_agents_tools.cli",
        "bt_agents_tools.cli.main",
        "bt_agents_tools.cli.terminal",
    ]


def test_commands_load_ros_only_when_called():
    printed_by(
        "import sys\n"
        "from bt_agents_tools.cli.main import all_commands\n"
        "for name, command in all_commands().items():\n"
        "    command.load()\n"
        "    assert 'rclpy' not in sys.modules, name\n"
    )


@pytest.fixture
def their_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the module of the command ``dance`` of another package, still without a file."""
    found = [EntryPoint("dance", "their_command:tango.dance", "bt_agents.commands")]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: found)
    monkeypatch.syspath_prepend(tmp_path)
    all_commands.cache_clear()
    yield tmp_path / "their_command.py"
    all_commands.cache_clear()
    sys.modules.pop("their_command", None)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise RuntimeError('first\\nsecond')", "RuntimeError: first second"),
        ("import nobody_has_this", "ModuleNotFoundError: No module named 'nobody_has_this'"),
        ("class tango: dance = 3", "TypeError: it is a int, expected a click.Command"),
    ],
)
def test_broken_command_of_a_package_stops_nothing(
    their_command: Path, code: str, words: str
) -> None:
    their_command.write_text(code)
    assert "  dance " in CliRunner().invoke(bt_agents, ["--help"]).output
    refused = str(CliRunner().invoke(bt_agents, ["dance"]).exception)
    assert refused.startswith("this command cannot be loaded from their_command: ")
    assert words in refused
