# SPDX-License-Identifier: Apache-2.0
"""The table of `bt-agents moods`."""

from __future__ import annotations

import io
import math
from types import SimpleNamespace

from rich.console import Console

from bt_agents_tools.cli.commands.moods import mood_table


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
