# SPDX-License-Identifier: Apache-2.0
"""Commands that print a table, also in formats for programs."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner
from rich.console import Console

from bt_agents_tools.cli.commands import preset, strategy
from bt_agents_tools.cli.commands.moods import mood_table
from bt_agents_tools.cli.main import bt_agents

WITHOUT_TABLE = {
    *("allow", "answer", "award", "cancel", "check", "demo", "experiment plot", "explain"),
    *("export groot", "feedback", "fleet join", "fleet leave", "fleet run"),
    *("host", "robot"),
    *("import groot", "journal"),
    *("forget", "keep", "new", "pin", "preset apply", "preset forget", "preset save", "press"),
    *(f"profile {what}" for what in ("check", "expire", "export", "import", "recover")),
    *("profile", "profile reset", "profile undo", "publish", "rehearse", "reload"),
    *("record mark", "record start", "record stop"),
    *("replay", "scene", "schema", "sense", "show", "test", "trigger", "unpin"),
    *("security", "studio", "up", "veto", "visit", "watch"),
    *("pause", "resume", "step"),
}
"""Commands whose output is not a table: words, a document, a picture, a file.

``profile`` passes its options to ``profile show``.
"""


def leaves(group: click.Group, path: str = "") -> Iterator[tuple[str, click.Command]]:
    """Yield every command with an action, by its words, including groups."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from leaves(command, f"{path}{name} ")
            if not command.invoke_without_command:
                continue
        yield f"{path}{name}", command


def test_every_table_has_machine_readable_form() -> None:
    found = {
        name: {option for one in command.params for option in one.opts}
        for name, command in leaves(bt_agents)
    }
    tables = {name for name, options in found.items() if {"--json", "--csv"} <= options}
    assert tables | WITHOUT_TABLE == found.keys()
    assert not tables & WITHOUT_TABLE


def test_presets_and_their_values_are_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    one = SimpleNamespace(name="morning", names=["a.x", "a.y", "b.x"], values=["1", "2 s", "3"])
    monkeypatch.setattr(preset, "connect", lambda: None)
    monkeypatch.setattr(preset, "_presets", lambda _: [one])
    every = CliRunner().invoke(preset.preset, ["--csv"]).output
    assert every == "preset,values,agents\nmorning,3,2\n"
    values = CliRunner().invoke(preset.preset, ["show", "morning", "--json"]).output
    assert json.loads(values)[1] == {"name": "a.y", "value": "2 s"}


def test_strategy_table_has_row_per_option() -> None:
    option = SimpleNamespace(value=1.0, minimum=0.0, maximum=9.0, description="how much")
    found = SimpleNamespace(
        current="ucb", shadow="", descriptions={"ucb": "d"}, options={"ucb": {"c": option}}
    )
    assert list(strategy._rows(found)) == [
        ("ucb", True, False, None, None, None, None, "d"),
        ("ucb", True, False, "c", 1.0, 0.0, 9.0, "how much"),
    ]


def test_each_node_row_shows_time_mood_and_change():
    trace = SimpleNamespace(
        leaves=["tree/0.say", "tree/1.ask", "tree/2.[bold]log"],
        seconds=[2.04, 10.0, 0.0],
        mean=[3.25, 4.0, math.nan],
        change=[-1.5, 0.0, math.nan],
        values=[SimpleNamespace(path="tree/1.ask", name="answer", value="[b]no")],
    )
    out = io.StringIO()
    table = mood_table(trace, {"tree/0.say": "say", "tree/1.ask": "[red]ask"})
    Console(file=out, width=80).print(table)
    assert [line.rstrip() for line in out.getvalue().splitlines()] == [
        "node        time  mood  change  changed         path",
        "say        2.0 s  3.25    -1.5                  tree/0.say",
        "[red]ask  10.0 s     4       0  answer = [b]no  tree/1.ask",
        "?          0.0 s     –       –                  tree/2.[bold]log",
    ]
