# SPDX-License-Identifier: Apache-2.0
"""The table of tuned values, on wide and narrow terminals."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bt_agents.host.tuning.tunable import TICK_RATE, Setting, TunableKind, TunableParameter
from bt_agents_core.field_types import FieldType
from bt_agents_tools.cli.tune_table import table
from bt_agents_tools.client.write_back import ParameterState

WORDS = "how long to wait for an answer, in the eyes of the person before the robot"
PATIENCE = TunableParameter(
    name="ann.patience",
    agent="ann",
    key="patience",
    kind=TunableKind.TUNABLE,
    type=FieldType.DURATION,
    default=8.0,
    minimum=2.0,
    maximum=30.0,
    description=WORDS,
)
PLACE = replace(
    PATIENCE,
    name="ann.place",
    key="place",
    type=FieldType.TEXT,
    default="",
    minimum=None,
    maximum=None,
)


def state(parameter: TunableParameter, value: Setting) -> ParameterState:
    return ParameterState(parameter=parameter, value=value)


STATES = (state(PATIENCE, 8.0), state(TICK_RATE, 20.0), state(PLACE, ""))


def test_agent_rows_follow_host_rows() -> None:
    assert list(table(STATES, 10_000)) == [
        "tick_rate   20   1 to 200     ticks of the running tree [1/s]",
        "ann",
        f"  patience  8 s  2 s to 30 s  {WORDS}",
        f"  place     ''                {WORDS}",
    ]


def test_file_default_column_appears_only_for_differing_values() -> None:
    rows = list(table((state(PATIENCE, 12.0),), 10_000))
    assert rows[1] == f"  patience  12 s  file: 8 s  2 s to 30 s  {WORDS}"


@pytest.mark.parametrize("width", [50, 60, 80, 120])
def test_rows_fit_terminal_without_losing_words(width: int) -> None:
    rows = list(table((*STATES, state(PATIENCE, 12.0)), width))
    assert max(map(len, rows)) <= width
    assert " ".join(" ".join(rows).split()).count(WORDS.split()[-1]) == 3
    assert all(row == "ann" or row.startswith(("  ", "tick_rate")) for row in rows)


def test_overlong_description_moves_to_own_lines() -> None:
    rows = list(table((state(PATIENCE, 8.0),), 50))
    assert rows[:3] == [
        "ann",
        "  patience  8 s  2 s to 30 s",
        "      how long to wait for an answer, in the eyes",
    ]
