# SPDX-License-Identifier: Apache-2.0
"""Tables of commands and tuned values: no width cuts text, and programs get plain values."""

from __future__ import annotations

import csv
import fcntl
import io
import json
import math
import pty
import re
import select
import string
import struct
import termios

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from bt_agents.host.tuning.tunable import TICK_RATE, Setting, TunableParameter, parameters_of
from bt_agents_tools.cli.formatting import print_line
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_lines
from bt_agents_tools.cli.tune_table import table
from bt_agents_tools.client.write_back import ParameterState
from tree_harness import agent

COLUMNS = (
    Column(key="agent"),
    Column(key="age", text="{:.1f}".format, right=True),
    Column(key="seem_wrong", title="seem wrong", text="{:.0%}".format, right=True),
    Column(key="why"),
)
ROWS = (
    ("attentive_guide", 4.25, 0.5, "she smiled at the second picture"),
    ("express", 3.0, None, ""),
)

words = st.text(string.ascii_letters, min_size=1, max_size=30)
texts = st.lists(words, max_size=4).map(" ".join)


def test_unlimited_width_gives_single_lines_and_aligned_numbers() -> None:
    assert list(table_lines(COLUMNS, ROWS, None)) == [
        "agent            age  seem wrong  why",
        "attentive_guide  4.2         50%  she smiled at the second picture",
        "express          3.0",
    ]


def test_overflowing_columns_move_below_row_with_headings() -> None:
    assert list(table_lines(COLUMNS, ROWS, 30)) == [
        "agent            age",
        "attentive_guide  4.2",
        "    seem wrong 50% · why she",
        "    smiled at the second",
        "    picture",
        "express          3.0",
    ]


@given(rows=st.lists(st.tuples(texts, texts, texts), max_size=4), width=st.integers(20, 90))
def test_only_single_words_exceed_width(rows: list[tuple[str, str, str]], width: int) -> None:
    lines = list(table_lines([Column(key=key) for key in ("one", "two", "three")], rows, width))
    shown = " ".join(lines).split()
    for row in rows:
        assert all(word in shown for cell in row for word in cell.split())
    assert all(cell_len(line) <= width or len(line.split()) == 1 for line in lines)


@pytest.mark.parametrize(("asked", "width"), [("80", 60), ("40", 40)])
def test_table_fits_terminal_regardless_of_columns_variable(
    asked: str, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 60, 0, 0))
    with open(controller, "rb", buffering=0) as screen, open(terminal, "w") as stdout:
        monkeypatch.setattr("sys.stdout", stdout)
        monkeypatch.setenv("COLUMNS", asked)
        print_table([Column(key="why")], [("word " * 30,)])
        stdout.flush()
        shown = ""
        # A terminal passes on the incomplete line.
        while shown.count("word") < 30 and select.select([screen], [], [], 10.0)[0]:
            shown += screen.read(4096).decode()
    longest = max(map(len, re.sub(r"\x1b\[\d*m", "", shown).splitlines()))
    assert width - len("word ") < longest <= width


def test_control_characters_are_escaped() -> None:
    assert list(table_lines([Column(key="a")], [("x\n\x1b[2J",)], None))[1] == r"x\n\x1b[2J"


def test_further_lines_of_text_are_indented() -> None:
    file = io.StringIO()
    print_line(Console(file=file), "host  ", "on body\nhost  /forged")
    assert file.getvalue() == "host  on body\n      host  /forged\n"


def test_programs_receive_unformatted_values(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [*ROWS, ("Zoë", math.nan, None, 'a "quote", and more')]
    print_table(COLUMNS, rows, TableForm.CSV)
    header, first, _, last = csv.reader(io.StringIO(capsys.readouterr().out))
    assert header == ["agent", "age", "seem_wrong", "why"]
    assert first == ["attentive_guide", "4.25", "0.5", ROWS[0][3]]
    assert last == ["Zoë", "nan", "", 'a "quote", and more']
    print_table(COLUMNS, rows, TableForm.JSON)
    out = capsys.readouterr().out
    assert out.isascii()
    assert json.loads(out)[2] == {
        "agent": "Zoë",
        "age": None,
        "seem_wrong": None,
        "why": 'a "quote", and more',
    }


WORDS = "how long to wait for an answer, in the eyes of the person before the robot"
TUNABLES = f"""
tunables:
  patience: {{default: 8 s, min: 2 s, max: 30 s, description: '{WORDS}'}}
  place: {{default: '', description: '{WORDS}'}}
"""
PATIENCE, PLACE, _ = parameters_of(
    agent("sequence: [wait: '${patience}', log: '${place}']", TUNABLES)
)


def state(parameter: TunableParameter, value: Setting) -> ParameterState:
    return ParameterState(parameter=parameter, value=value)


STATES = (state(PATIENCE, 8.0), state(TICK_RATE, 20.0), state(PLACE, ""))


def test_agent_rows_follow_host_rows() -> None:
    assert list(table(STATES, 10_000)) == [
        "tick_rate   20   1 to 200     ticks of the running tree [1/s]",
        "a",
        f"  patience  8 s  2 s to 30 s  {WORDS}",
        f"  place     ''                {WORDS}",
    ]


@pytest.mark.parametrize("width", [50, 60, 80, 120])
def test_rows_fit_terminal_without_losing_words(width: int) -> None:
    rows = list(table((*STATES, state(PATIENCE, 12.0)), width))
    assert max(map(len, rows)) <= width
    assert " ".join(" ".join(rows).split()).count(WORDS.split()[-1]) == 3
    assert all(row == "a" or row.startswith(("  ", "tick_rate")) for row in rows)


def test_overlong_description_moves_to_own_lines() -> None:
    assert list(table((state(PATIENCE, 8.0),), 50))[:3] == [
        "a",
        "  patience  8 s  2 s to 30 s",
        "      how long to wait for an answer, in the eyes",
    ]
